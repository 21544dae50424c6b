#pragma once
/// @file What the accuracy tests and the accuracy table share: the problems, and one solve judged by a
/// reference answer.
#include <algorithm>
#include <chrono>

#include "knothe/posterior/map/solve/map_solver.hpp"
#include "knothe/posterior/map/testing/accuracy_references.hpp"

namespace knothe::posterior::accuracy {

/// How far the corrected answer of a solve is from the reference.
struct Accuracy {
  double mean = 0;                ///< largest |difference| in units of the reference's std
  double standard_deviation = 0;  ///< largest |ratio − 1|
  double log_evidence = 0;        ///< |difference|
  double seconds = 0;             ///< solve and correction
  MapResult result;
  ImportanceCorrection correction;
};

inline Accuracy measure(LogDensity& target, const Reference& reference,
                        const MapSolverOptions& options = {}) {
  Accuracy accuracy;
  MapSolver solver(options);
  const auto start = std::chrono::steady_clock::now();
  solver.solve(target, accuracy.result);
  solver.correct(target, accuracy.result, accuracy.correction);
  accuracy.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  const Eigen::ArrayXd std_reference = reference.standard_deviation;
  accuracy.mean = ((accuracy.correction.mean - reference.mean).array() / std_reference).abs().maxCoeff();
  accuracy.standard_deviation =
      (accuracy.correction.covariance.diagonal().array().sqrt() / std_reference - 1).abs().maxCoeff();
  accuracy.log_evidence = std::abs(accuracy.correction.log_evidence - reference.log_evidence);
  return accuracy;
}

/// Singular values from 1 to 0.05 and noise 0.1: standard deviations of the posterior from 0.1 to 0.9.
inline targets::LinearGaussian linear_gaussian(Eigen::Index d) {
  return targets::random_linear_gaussian(d, 0.05, 0.1, 2026);
}

/// Six coefficients, 60 outcomes.
inline targets::LogisticRegression logistic_regression() {
  Eigen::VectorXd z(6);
  z << 0.3, -0.8, 1.2, 0.4, -0.2, 0.9;
  return targets::synthetic_logistic_regression(60, z, 1.5, 31, 32);
}

inline MapSolverOptions logistic_regression_options() {
  MapSolverOptions options;
  options.tolerance = 1e-2;
  options.max_order = 2;
  return options;
}

inline targets::EightSchools eight_schools() {
  return {};
}
/// Ten variables: order 2 has 285 coefficients.
inline MapSolverOptions eight_schools_options() {
  MapSolverOptions options;
  options.tolerance = 1e-2;
  options.max_order = 2;
  return options;
}

inline void add_missing(std::vector<MultiIndex>& set, const std::vector<MultiIndex>& other) {
  for (const MultiIndex& index : other)
    if (std::find(set.begin(), set.end(), index) == set.end()) set.push_back(index);
}

/// 32 variables: two parameters and thirty states.
inline targets::StochasticVolatility stochastic_volatility() {
  return targets::synthetic_stochastic_volatility(30, 41);
}
/// In the principal axes of the Laplace covariance, longest first: order 1 dense; at order 2 a component
/// bends with the two longest axes and the one before its own. 860 coefficients; all of order 2 would be
/// 6,544. The same sets in the given order (μ, φ, x_{t−1}: what x_t depends on in the prior) verify at 0.27
/// instead of 0.19.
inline MapSolverOptions stochastic_volatility_options() {
  MapSolverOptions options;
  options.tolerance = 1e-2;
  options.max_order = 2;
  options.verification_points = 4096;
  options.max_points = 65536;
  options.orientation = Orientation::principal;
  options.fallback = false;
  options.family = [](Eigen::Index d, int order) {
    MapSpecification map = total_order_map(d, 1);
    if (order == 1) return map;
    Parents parents(static_cast<std::size_t>(d));
    for (int k = 1; k < d; ++k)
      for (int parent = 0; parent < k; ++parent)
        if (parent < 2 || parent == k - 1) parents[static_cast<std::size_t>(k)].push_back(parent);
    const MapSpecification sparse = sparse_map(total_order_map(d, order), parents);
    for (std::size_t k = 0; k < map.components.size(); ++k) {
      add_missing(map.components[k].constant, sparse.components[k].constant);
      add_missing(map.components[k].monotone, sparse.components[k].monotone);
    }
    return map;
  };
  return options;
}

}  // namespace knothe::posterior::accuracy
