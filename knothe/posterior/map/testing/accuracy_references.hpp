#pragma once
/// @file Answers that know nothing of transport maps, for the accuracy tests and the accuracy table: closed
/// forms, quadrature, and a Hamiltonian Monte Carlo of its own.
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "knothe/numerics/integrate/sobol.hpp"
#include "knothe/numerics/statistics/normal_distribution.hpp"
#include "knothe/numerics/statistics/random.hpp"
#include "knothe/posterior/testing/model_targets.hpp"

namespace knothe::posterior::accuracy {

/// Means, standard deviations and log-evidence from elsewhere.
struct Reference {
  std::string source;
  Eigen::VectorXd mean, standard_deviation;
  double log_evidence = std::numeric_limits<double>::quiet_NaN();
  double log_evidence_error = 0;
  double mean_error = 0;  ///< standard error of the means, the worst, in units of std
  double std_error = 0;   ///< the same of the standard deviations, relative
};

/// By conjugacy.
inline Reference reference_of(const targets::LinearGaussian& target) {
  return {"conjugate formula",
          target.mean(),
          target.covariance().diagonal().cwiseSqrt(),
          target.log_evidence(),
          0,
          0,
          0};
}

/// By `targets::exact_moments`.
inline Reference reference_of(const targets::EightSchools& target) {
  const targets::ExactMoments exact = targets::exact_moments(target);
  return {"closed form given tau, quadrature over tau",
          exact.mean,
          exact.standard_deviation,
          exact.log_evidence,
          0,
          0,
          0};
}

/// The mode by Newton's method with step halving, and L with L Lᵀ the inverse of the negative Hessian there.
struct Laplace {
  Eigen::VectorXd mode;
  Eigen::MatrixXd lower;
};
inline Laplace laplace_of(LogDensity& target) {
  const Eigen::Index d = target.dimension();
  LogDensityBatch here, there;
  here.resize(1, d, 2), there.resize(1, d, 2);
  Eigen::VectorXd z = Eigen::VectorXd::Zero(d);
  Eigen::MatrixXd negative(d, d);
  for (int k = 0; k < 100; ++k) {
    target.evaluate(z.transpose(), 2, here);
    for (Eigen::Index a = 0; a < d; ++a)
      for (Eigen::Index b = 0; b < d; ++b) negative(a, b) = -here.hessian(0, packed_index(a, b));
    for (double damping = 0; negative.llt().info() != Eigen::Success; damping = 2 * damping + 0.1)
      negative.diagonal().array() += damping + 0.1;
    const Eigen::VectorXd step = negative.llt().solve(here.gradient.row(0).transpose());
    if (step.norm() < 1e-10) break;
    double length = 1;
    do {
      target.evaluate((z + length * step).transpose(), 0, there);
      length *= 0.5;
    } while (!(there.value[0] >= here.value[0]) && length > 1e-8);
    z += 2 * length * step;
  }
  return {z, negative.inverse().llt().matrixL()};
}

/// Hamiltonian Monte Carlo (R. Neal 2011) in coordinates in which the Laplace approximation is N(0, I): four
/// chains from starts twice as wide, ten leapfrog steps of random length, a tenth of the draws thrown away.
/// Errors from batch means: 25 batches a chain.
inline Reference reference_by_chains(LogDensity& target, Eigen::Index draws, std::uint64_t seed,
                                     double step_length = 0.16) {
  constexpr int k_chains = 4, k_batches = 25, k_leaps = 10;
  const Eigen::Index d = target.dimension(), warm_up = draws / 10, per_batch = draws / (k_chains * k_batches);
  const Laplace laplace = laplace_of(target);
  LogDensityBatch batch;
  batch.resize(1, d, 1);
  const auto evaluate = [&](const Eigen::VectorXd& x, Eigen::VectorXd& gradient) {
    target.evaluate((laplace.mode + laplace.lower * x).transpose(), 1, batch);
    gradient = laplace.lower.transpose() * batch.gradient.row(0).transpose();
    return batch.value[0];
  };
  Eigen::MatrixXd means(d, k_chains * k_batches), squares(d, k_chains * k_batches);
  means.setZero(), squares.setZero();
  std::int64_t accepted = 0, proposed = 0;
  for (int chain = 0; chain < k_chains; ++chain) {
    const std::uint64_t key = seed * 1000 + static_cast<std::uint64_t>(chain);
    Eigen::VectorXd x = 2 * numerics::monte_carlo_normal_points(1, d, key).row(0), gradient(d), slope(d);
    double value = evaluate(x, gradient);
    for (Eigen::Index i = -warm_up; i < per_batch * k_batches; ++i) {
      const auto counter = static_cast<std::uint64_t>(i + warm_up + 1);
      Eigen::VectorXd momentum = numerics::monte_carlo_normal_points(1, d, key, counter).row(0);
      const Eigen::MatrixXd uniform = numerics::monte_carlo_points(1, 2, key + 500, counter);
      const double step = step_length * (0.7 + 0.6 * uniform(0, 0));
      Eigen::VectorXd y = x;
      slope = gradient;
      const double energy = value - 0.5 * momentum.squaredNorm();
      double trial = value;
      for (int leap = 0; leap < k_leaps; ++leap) {
        momentum += 0.5 * step * slope;
        y += step * momentum;
        trial = evaluate(y, slope);
        momentum += 0.5 * step * slope;
      }
      if (i >= 0) ++proposed;
      if (std::log(uniform(0, 1)) < trial - 0.5 * momentum.squaredNorm() - energy) {
        x = y, value = trial, gradient = slope;
        if (i >= 0) ++accepted;
      }
      if (i < 0) continue;
      const Eigen::VectorXd z = laplace.lower * x;  // about the mode
      const Eigen::Index column = chain * k_batches + i / per_batch;
      means.col(column) += z / static_cast<double>(per_batch);
      squares.col(column) += z.cwiseAbs2() / static_cast<double>(per_batch);
    }
  }
  Reference reference;
  reference.source = "HMC";
  const Eigen::VectorXd mean = means.rowwise().mean();
  reference.mean = laplace.mode + mean;
  const Eigen::ArrayXd variance = squares.rowwise().mean().array() - mean.array().square();
  reference.standard_deviation = variance.sqrt();
  const double batches = k_chains * k_batches;
  const auto standard_error = [&](const Eigen::MatrixXd& values) -> Eigen::ArrayXd {
    return (values.colwise() - values.rowwise().mean()).array().square().rowwise().sum().sqrt() / batches;
  };
  reference.mean_error = (standard_error(means) / variance.sqrt()).maxCoeff();
  Eigen::MatrixXd central = squares;  // to first order the square of the distance from the mean
  central -= (2 * mean).asDiagonal() * means;
  reference.std_error = (standard_error(central) / (2 * variance)).maxCoeff();
  if (accepted < proposed / 2) reference.mean_error = std::numeric_limits<double>::infinity();
  return reference;
}

/// Log-evidence by importance sampling with Student's t of six degrees of freedom about the Laplace
/// approximation, 2^16 scrambled Sobol points in eight independent batches.
inline void add_evidence(LogDensity& target, std::uint64_t seed, Reference& reference) {
  constexpr Eigen::Index k_points = 8192;
  constexpr int k_batches = 8;
  constexpr double k_freedom = 6;  // even: χ² by a sum of squares of normals
  const Eigen::Index d = target.dimension();
  const Laplace laplace = laplace_of(target);
  const double size = static_cast<double>(d);
  const double constant = std::lgamma(0.5 * (k_freedom + size)) - std::lgamma(0.5 * k_freedom) -
                          0.5 * size * std::log(k_freedom * std::numbers::pi) -
                          laplace.lower.diagonal().array().log().sum();
  Eigen::VectorXd log_means(k_batches);
  LogDensityBatch batch;
  batch.resize(k_points, d, 0);
  for (int b = 0; b < k_batches; ++b) {
    const Eigen::MatrixXd normal =
        numerics::sobol_normal_points(k_points, d + 6, seed + static_cast<std::uint64_t>(b));
    const Eigen::ArrayXd scale = (normal.rightCols(6).rowwise().squaredNorm() / k_freedom).cwiseSqrt();
    const Eigen::MatrixXd x = normal.leftCols(d).array().colwise() / scale;
    const Eigen::MatrixXd z = (x * laplace.lower.transpose()).rowwise() + laplace.mode.transpose();
    target.evaluate(z, 0, batch);
    const Eigen::ArrayXd log_weight =
        batch.value.array() - constant +
        0.5 * (k_freedom + size) * (x.rowwise().squaredNorm().array() / k_freedom).log1p();
    const double top = log_weight.maxCoeff();
    log_means[b] = top + std::log((log_weight - top).exp().mean());
  }
  reference.log_evidence = log_means.mean();
  reference.log_evidence_error = std::sqrt((log_means.array() - reference.log_evidence).square().sum() /
                                           (k_batches * (k_batches - 1.0)));
  reference.source += ", importance sampling with Student's t";
}

}  // namespace knothe::posterior::accuracy
