#pragma once
/// @file Where LATIN-PGD is between two windows, and its file: what a run that was interrupted goes on from.
#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "knothe/offline/latin/latin_basis.hpp"
#include "knothe/offline/latin/latin_pgd.hpp"

namespace knothe::offline {

/// Everything the next window depends on.
struct LatinState {
  int next_step = 0;                ///< first step of the next window
  std::vector<std::int64_t> cells;  ///< active, in the order in which they joined
  LatinBasis::Modes modes;
  Eigen::MatrixXd history;   ///< P × n_g: damage
  Eigen::MatrixXd expanded;  ///< archived modes on all dofs, n_dof × (as many as have been expanded)
  LatinSolution solution;    ///< steps before `next_step`; without `space`
};

/// Written atomically; `key` says what the run is of. IoError.
void write_state(const LatinState& state, const std::string& key, const std::string& path);
/// Nothing if there is no file, or it is damaged, or of another run.
[[nodiscard]] std::optional<LatinState> read_state(const std::string& key, const std::string& path);

}  // namespace knothe::offline
