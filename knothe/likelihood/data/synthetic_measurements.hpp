#pragma once
/// @file Measurements made from a model: which dofs, and what noise.
#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "knothe/likelihood/data/measurements.hpp"
#include "knothe/model/compress/snapshots.hpp"

namespace knothe::likelihood {

/// Which displacement dofs of a model a synthetic camera sees.
struct DofSelection {
  int nodes = 30;  ///< drawn at random, without repetition
  int face = 2;    ///< outer face: where coordinate 0, 1 or 2 is largest
  std::optional<std::array<double, 2>> x_range, y_range;  ///< m
  std::vector<int> components = {0, 1};
};

/// Indices of the chosen dofs: for each node, its components in the order asked for. The draw depends on the
/// seed and the nodes alone. Throws ProjectError if there are too few nodes, with their number.
[[nodiscard]] std::vector<std::size_t> choose_dofs(const model::Dofs& dofs, const DofSelection& selection,
                                                   std::uint64_t seed);

/// `exact` (n_obs × n_t) plus independent Gaussian noise of standard deviations `std`; sensors are left out.
[[nodiscard]] Measurements add_noise(std::vector<double> time, const Eigen::MatrixXd& exact,
                                     const Eigen::VectorXd& std, std::uint64_t seed);
/// Exact displacements (n_obs × n_t) plus independent Gaussian noise of standard deviation `noise_std`, at
/// the dofs chosen.
[[nodiscard]] Measurements add_noise(const model::Dofs& dofs, std::span<const std::size_t> chosen,
                                     std::vector<double> time, const Eigen::MatrixXd& exact, double noise_std,
                                     std::uint64_t seed);

}  // namespace knothe::likelihood
