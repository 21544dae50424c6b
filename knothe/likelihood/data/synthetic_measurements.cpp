#include "knothe/likelihood/data/synthetic_measurements.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <random>

#include "knothe/base/error.hpp"
#include "knothe/numerics/statistics/normal_distribution.hpp"

namespace knothe::likelihood {
namespace {

/// Two independent streams from one seed.
std::mt19937_64 stream(std::uint64_t seed, std::uint64_t purpose) {
  std::seed_seq sequence{seed & 0xffffffffu, seed >> 32, purpose};
  return std::mt19937_64(sequence);
}

/// In (0, 1), never an end, the same on every standard library.
double uniform(std::mt19937_64& random) {
  return ((random() >> 11) + 0.5) * 0x1.0p-53;
}

bool inside(const std::optional<std::array<double, 2>>& range, double value) {
  constexpr double k_slack = 1e-9;  // m
  return !range || (value >= (*range)[0] - k_slack && value <= (*range)[1] + k_slack);
}

}  // namespace

std::vector<std::size_t> choose_dofs(const model::Dofs& dofs, const DofSelection& selection,
                                     std::uint64_t seed) {
  if (dofs.empty()) throw DataError("the model has no dof positions: its field is not a displacement");
  double outermost = -1e300;
  for (std::size_t i = 0; i < dofs.components.size(); ++i) {
    outermost = std::max(outermost, dofs.points[3 * i + selection.face]);
  }
  // Nodes of the face by rounded position, each with its dof per component.
  std::map<std::array<long long, 3>, std::array<long long, 3>> nodes;
  for (std::size_t i = 0; i < dofs.components.size(); ++i) {
    const double* point = &dofs.points[3 * i];
    if (std::abs(point[selection.face] - outermost) > 1e-9 || !inside(selection.x_range, point[0]) ||
        !inside(selection.y_range, point[1])) {
      continue;
    }
    std::array<long long, 3> key;
    for (int c = 0; c < 3; ++c) key[c] = std::llround(point[c] * 1e9);
    nodes.try_emplace(key, std::array<long long, 3>{-1, -1, -1}).first->second[dofs.components[i]] = i;
  }
  std::vector<std::array<long long, 3>> candidates;
  for (const auto& [position, node] : nodes) {
    const bool complete = std::all_of(selection.components.begin(), selection.components.end(),
                                      [&](int component) { return node[component] >= 0; });
    if (complete) candidates.push_back(node);
  }
  if (std::ssize(candidates) < selection.nodes) {
    throw ProjectError(fmt::format(
        "simulate.dofs.random = {}, but the model has only {} nodes with these components on that "
        "part of the face: ask for fewer, or widen x and y",
        selection.nodes, candidates.size()));
  }
  std::mt19937_64 random = stream(seed, 1);
  std::vector<std::size_t> chosen;
  for (int k = 0; k < selection.nodes; ++k) {
    const std::size_t left = candidates.size() - k;
    const std::size_t pick = k + static_cast<std::size_t>(uniform(random) * left);
    std::swap(candidates[k], candidates[pick]);
    for (int component : selection.components) chosen.push_back(candidates[k][component]);
  }
  return chosen;
}

Measurements add_noise(std::vector<double> time, const Eigen::MatrixXd& exact, const Eigen::VectorXd& std,
                       std::uint64_t seed) {
  Measurements m;
  m.time = std::move(time);
  m.values = exact;
  std::mt19937_64 random = stream(seed, 2);
  for (Eigen::Index t = 0; t < m.values.cols(); ++t) {
    for (Eigen::Index j = 0; j < m.values.rows(); ++j) {
      m.values(j, t) += std[j] * numerics::normal_quantile(uniform(random));
    }
  }
  m.noise = NoiseModel::independent(std);
  return m;
}

Measurements add_noise(const model::Dofs& dofs, std::span<const std::size_t> chosen, std::vector<double> time,
                       const Eigen::MatrixXd& exact, double noise_std, std::uint64_t seed) {
  Measurements m =
      add_noise(std::move(time), exact, Eigen::VectorXd::Constant(exact.rows(), noise_std), seed);
  for (const std::size_t dof : chosen) m.sensors.add(dofs.point(dof), dofs.components[dof]);
  return m;
}

}  // namespace knothe::likelihood
