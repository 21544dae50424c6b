#pragma once
/// @file Simulation-based calibration: parameters from the prior, data from the model, posterior by the
/// solver; the rank of the true parameters in their posterior is uniform if, and only if, posteriors are
/// right on average (S. Talts, M. Betancourt, D. Simpson, A. Vehtari, A. Gelman, arXiv 1804.06788).
#include <Eigen/Core>
#include <algorithm>
#include <span>

#include "knothe/numerics/statistics/random.hpp"
#include "knothe/numerics/testing/ecdf_band.hpp"
#include "knothe/posterior/map/solve/map_solver.hpp"
#include "knothe/posterior/testing/model_targets.hpp"

namespace knothe::posterior::accuracy {

struct Calibration {
  Eigen::MatrixXd ranks;        ///< data sets × d, each in [0, 1]: posterior probability below the truth
  Eigen::MatrixXd wrong_ranks;  ///< the same with every posterior made `wrong_spread` times as wide
  int trusted = 0;              ///< data sets whose posterior was called trusted
  double lowest_ess = 1;
};

/// Weighted share of the points below `truth` once they are spread about `centre`.
inline double rank_of(const Eigen::VectorXd& points, const Eigen::VectorXd& weights, double centre,
                      double spread, double truth) {
  double below = 0;
  for (Eigen::Index i = 0; i < points.size(); ++i)
    if (centre + spread * (points[i] - centre) < truth) below += weights[i];
  return std::clamp(below, 0.0, 1.0);
}

/// `make(z, index, seed)` gives the posterior of data simulated at z ~ N(0, I).
template <class Make>
Calibration calibrate(int data_sets, Eigen::Index d, std::uint64_t seed, const Make& make,
                      double wrong_spread = 1.3, const MapSolverOptions& options = {}) {
  Calibration calibration;
  calibration.ranks.resize(data_sets, d);
  calibration.wrong_ranks.resize(data_sets, d);
  const Eigen::MatrixXd truths = numerics::monte_carlo_normal_points(data_sets, d, seed);
  MapSolver solver(options);
  MapResult result;
  ImportanceCorrection correction;
  for (int i = 0; i < data_sets; ++i) {
    auto target = make(Eigen::VectorXd(truths.row(i)), static_cast<std::uint64_t>(i), seed);
    solver.solve(target, result);
    solver.correct(target, result, correction);
    calibration.trusted += correction.trust.trusted;
    calibration.lowest_ess = std::min(calibration.lowest_ess, correction.ess);
    for (Eigen::Index k = 0; k < d; ++k) {
      const Eigen::VectorXd column = correction.points.col(k);
      calibration.ranks(i, k) = rank_of(column, correction.weights, correction.mean[k], 1, truths(i, k));
      calibration.wrong_ranks(i, k) =
          rank_of(column, correction.weights, correction.mean[k], wrong_spread, truths(i, k));
    }
  }
  return calibration;
}

/// Largest excess over the simultaneous 95 % band, which is for all d coordinates together (Bonferroni).
inline double worst_excess(const Eigen::MatrixXd& ranks) {
  const auto n = static_cast<int>(ranks.rows());
  const auto band = numerics::simultaneous_ecdf_band(n, 50, 1 - 0.05 / static_cast<double>(ranks.cols()));
  double worst = -1;
  for (Eigen::Index k = 0; k < ranks.cols(); ++k)
    worst = std::max(worst, band.excess({ranks.col(k).data(), static_cast<std::size_t>(n)}));
  return worst;
}

/// Five measurements of a saturating curve, noise 0.0316: posteriors from narrow and bent to that of the
/// prior.
inline targets::OxygenDemandDensity simulated_oxygen_demand(const Eigen::VectorXd& z, std::uint64_t index,
                                                            std::uint64_t seed) {
  targets::OxygenDemandDensity target;
  target.data = targets::OxygenDemandDensity::model(z[0], z[1]);
  const Eigen::MatrixXd noise = numerics::monte_carlo_normal_points(1, 5, seed + (1u << 20), index);
  for (std::size_t t = 0; t < 5; ++t)
    target.data[t] += target.noise_std * noise(0, static_cast<Eigen::Index>(t));
  return target;
}

/// Three coefficients, 20 outcomes, new covariates each time.
inline targets::LogisticRegression simulated_logistic_regression(const Eigen::VectorXd& z,
                                                                 std::uint64_t index, std::uint64_t seed) {
  const std::uint64_t own = (seed << 24) + index;
  return targets::synthetic_logistic_regression(20, z, 1.5, own + (1u << 22), own + (1u << 23));
}

}  // namespace knothe::posterior::accuracy
