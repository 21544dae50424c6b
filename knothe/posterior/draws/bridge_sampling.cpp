#include "knothe/posterior/draws/bridge_sampling.hpp"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "knothe/base/error.hpp"
#include "knothe/numerics/integrate/sobol.hpp"
#include "knothe/numerics/statistics/order_statistics.hpp"
#include "knothe/posterior/checked_density.hpp"

namespace knothe::posterior {
namespace {

/// Normalised Gaussian.
struct Gaussian {
  Eigen::VectorXd mean;
  Eigen::MatrixXd lower;

  [[nodiscard]] Eigen::VectorXd log_density(const Eigen::MatrixXd& z) const {
    const Eigen::MatrixXd u =
        lower.triangularView<Eigen::Lower>().solve((z.rowwise() - mean.transpose()).transpose());
    const double constant =
        lower.diagonal().array().log().sum() + 0.5 * mean.size() * std::log(2 * std::numbers::pi);
    return -0.5 * u.colwise().squaredNorm().transpose().array() - constant;
  }
};

/// Odd and even draws lie all along the chains, so each half sees all of them.
Eigen::MatrixXd every_other(const Eigen::Ref<const Eigen::MatrixXd>& draws, Eigen::Index first) {
  const Eigen::Index n = (draws.rows() - first + 1) / 2;
  return draws(Eigen::seqN(first, n, 2), Eigen::all);
}

double relative_variance(const Eigen::ArrayXd& x) {
  const double mean = x.mean();
  return (x - mean).square().mean() / (mean * mean);
}

}  // namespace

BridgeEstimate bridge_sampling(LogDensity& user_target, const Eigen::Ref<const Eigen::MatrixXd>& draws,
                               double effective_size, Eigen::Index proposals, std::uint64_t seed) {
  if (draws.rows() < 100 || proposals < 10)
    throw UsageError(fmt::format("bridge sampling: {} draws and {} proposals; at least 100 and 10 are needed",
                                 draws.rows(), proposals));
  const Eigen::MatrixXd fitted = every_other(draws, 0), used = every_other(draws, 1);
  Gaussian bridge{fitted.colwise().mean().transpose(), {}};
  const Eigen::MatrixXd centred = fitted.rowwise() - bridge.mean.transpose();
  const Eigen::LLT<Eigen::MatrixXd> cholesky(centred.transpose() * centred / fitted.rows());
  if (cholesky.info() != Eigen::Success) throw UsageError("bridge sampling: the draws have no spread");
  bridge.lower = cholesky.matrixL();
  const Eigen::MatrixXd proposed =
      (numerics::sobol_normal_points(proposals, draws.cols(), seed) * bridge.lower.transpose()).rowwise() +
      bridge.mean.transpose();

  CheckedDensity target(user_target);
  LogDensityBatch batch;
  target.evaluate(used, 0, batch);
  const Eigen::ArrayXd at_draws = batch.value - bridge.log_density(used);
  target.evaluate(proposed, 0, batch);
  const Eigen::ArrayXd at_proposals = batch.value - bridge.log_density(proposed);

  // Fixed point of r = E_g[l / (s₁ l + s₂ r)] / E_π[1 / (s₁ l + s₂ r)], l = π̄/g e^−centre, r = evidence
  // e^−centre.
  const double centre = numerics::upper_median(at_draws);
  const double n1 = std::max(1.0, 0.5 * effective_size), n2 = proposals;
  const double s1 = n1 / (n1 + n2), s2 = n2 / (n1 + n2);
  const Eigen::ArrayXd l1 = (at_draws - centre).min(600.0).exp(),
                       l2 = (at_proposals - centre).min(600.0).exp();
  double r = 1;
  Eigen::ArrayXd f1, f2;
  for (int iteration = 0; iteration < 1000; ++iteration) {
    f1 = 1 / (s1 * l1 + s2 * r);
    f2 = l2 / (s1 * l2 + s2 * r);
    const double next = f2.mean() / f1.mean();
    const bool settled = std::abs(next - r) <= 1e-10 * r;
    r = next;
    if (settled) break;
  }
  return {std::log(r) + centre, std::sqrt(relative_variance(f2) / n2 + relative_variance(f1) / n1)};
}

}  // namespace knothe::posterior
