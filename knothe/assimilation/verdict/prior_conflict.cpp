#include "knothe/assimilation/verdict/prior_conflict.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "knothe/numerics/linear/symmetric_eigen.hpp"
#include "knothe/numerics/statistics/chi_squared.hpp"
#include "knothe/numerics/statistics/normal_distribution.hpp"
#include "knothe/numerics/statistics/weighted_statistics.hpp"

namespace knothe::assimilation {
namespace {

using Eigen::Index;

constexpr double k_min_information = 0.1;  // of 1 − C, from here on a direction counts
// Data that say nothing do not move a mean so far: the model is curved, and they say about so much.
constexpr double k_moved = 1, k_information_where_curved = 0.25;
constexpr double k_inaccuracy = 0.01;  // variance of a mean that is computed and of a model that is curved
constexpr double k_farthest = 8.5;     // of a point at an end of the box
constexpr double k_by_chance = 1e-3;   // probability of a caution
constexpr double k_by_chance_if_it_matters = 1.5e-2;
constexpr double k_matters = 3;                           // of the pull
constexpr double k_reject_beyond = 5;                     // distance: 6e-7
constexpr double k_correlated = 0.95, k_left_open = 0.9;  // of two parameters; of the prior's variance
constexpr double k_share_of_all = 10;  // the look at all parameters together has a tenth of the false alarms

struct Moments {
  Eigen::VectorXd mean;
  Eigen::MatrixXd covariance;
};

/// As if p(z) were linear over the posterior.
Moments linear_moments(const posterior::PriorTransform& priors, const posterior::Posterior& posterior) {
  const Index d = priors.dimension();
  Moments z{Eigen::VectorXd(d), posterior.covariance};
  for (Index a = 0; a < d; ++a) {
    z.mean[a] = std::clamp(priors.prior(a).to_standard_normal(posterior.mean[a]), -k_farthest, k_farthest);
    const double slope = priors.prior(a).from_standard_normal(z.mean[a]).first;
    z.covariance.row(a) /= slope;
    z.covariance.col(a) /= slope;
  }
  return z;
}

Moments moments_of_points(const posterior::PriorTransform& priors, const posterior::Posterior& posterior) {
  Eigen::MatrixXd points = posterior.points;
  for (Index a = 0; a < points.cols(); ++a)
    for (double& p : points.col(a))
      p = std::clamp(priors.prior(a).to_standard_normal(p), -k_farthest, k_farthest);
  Moments z;
  numerics::mean_and_covariance(points, posterior.weights, z.mean, z.covariance);
  return z;
}

/// `prior`: its covariance in z.
PriorConflict conflict_of(const Moments& z, const Eigen::MatrixXd& prior) {
  const Index d = z.mean.size();
  PriorConflict found{Eigen::VectorXd::Zero(d),
                      Eigen::VectorXd::Zero(d),
                      Eigen::VectorXd::Zero(d),
                      Eigen::VectorXd::Zero(d),
                      1,
                      z.covariance};
  for (Index a = 0; a < d; ++a) {
    const double variance = z.covariance(a, a), seen = 1 - variance;
    const bool is_seen = seen >= k_min_information;
    if (!is_seen && std::abs(z.mean[a]) < k_moved) continue;
    const double information = is_seen ? seen : k_information_where_curved;
    found.distance[a] = std::abs(z.mean[a]) / std::sqrt(information + k_inaccuracy);
    found.estimate[a] = z.mean[a] / information;
    found.std[a] = std::sqrt(variance / information);
    found.pull[a] = std::abs(found.estimate[a]) * std::sqrt(variance);
  }
  const numerics::SymmetricEigen eigen(prior - z.covariance);
  const Eigen::VectorXd along = eigen.eigenvectors().transpose() * z.mean;
  double square = 0;
  Index degrees = 0;
  for (Index k = 0; k < d; ++k) {
    if (!(eigen.eigenvalues()[k] >= k_min_information)) continue;
    square += along[k] * along[k] / (eigen.eigenvalues()[k] + k_inaccuracy);
    ++degrees;
  }
  if (degrees > 0) found.probability = numerics::chi_squared_upper(square, degrees);
  return found;
}

std::string with_space(const std::string& units) {
  return units.empty() ? "" : " " + units;
}

/// Whether mean and covariance of p cannot say that all is well: far from the prior, or the posterior so wide
/// that p(z) is not linear over it.
bool needs_points(const PriorConflict& conflict, const Moments& z) {
  const auto far =
      z.mean.array().abs() > 0.6 && (conflict.distance.array() > 2 || z.covariance.diagonal().array() > 0.5);
  return far.any() || conflict.probability < 0.05;
}

/// "1.1 ± 0.02 (238 ± 4 J/m3)": where a normal score and those a standard deviation beside it are.
std::string value_at(double z, double std, const posterior::Prior& prior, const model::Axis& axis) {
  const double value = prior.from_standard_normal(z).value;
  const double error =
      0.5 * (prior.from_standard_normal(z + std).value - prior.from_standard_normal(z - std).value);
  std::string text = fmt::format("{:.4g} ± {:.2g}", value, error);
  if (axis.reference != 1)
    text += fmt::format(" ({:.4g} ± {:.2g}{})", axis.reference * value, std::abs(axis.reference) * error,
                        with_space(reference_units(axis)));
  else if (axis.units != "1")
    text += with_space(axis.units);
  return text;
}

/// The larger eigenvalue of the covariance of two.
double largest_variance(double a, double b, double between) {
  return 0.5 * (a + b) + std::hypot(0.5 * (a - b), between);
}

/// Two-sided: how many standard deviations have this probability, shared by `count` looks.
double limit_of(double probability, Index count) {
  return -numerics::normal_quantile(0.5 * probability / count);
}

}  // namespace

PriorConflict find_prior_conflict(const posterior::PriorTransform& priors,
                                  const posterior::Posterior& posterior) {
  const Moments linear = linear_moments(priors, posterior);
  const Eigen::MatrixXd prior = priors.covariance();
  PriorConflict found = conflict_of(linear, prior);
  return needs_points(found, linear) ? conflict_of(moments_of_points(priors, posterior), prior) : found;
}

std::optional<VerdictReason> conflict_reason(const PriorConflict& conflict,
                                             const posterior::PriorTransform& priors,
                                             std::span<const model::Axis> axes) {
  const Index d = conflict.distance.size();
  // It can matter only where the prior says more than the data.
  const Index dominated = (conflict.std.array() > 1).count();
  Index worst = 0;
  double value = 0, limit = 1;
  for (Index a = 0; a < d; ++a) {
    const bool matters = conflict.pull[a] > k_matters;
    const double own = matters ? limit_of(k_by_chance_if_it_matters, std::max<Index>(1, dominated))
                               : limit_of(k_by_chance, d);
    if (conflict.distance[a] * limit > value * own) worst = a, value = conflict.distance[a], limit = own;
  }
  std::string together;
  if (value < limit) {
    if (!(k_share_of_all * conflict.probability < k_by_chance)) return {};
    together = "taken together, ";
    value = limit_of(conflict.probability, 1);
    limit = limit_of(k_by_chance / k_share_of_all, 1);
  }
  std::string message = together + "prior and data contradict each other";
  if (conflict.distance[worst] > 0) {
    const posterior::Prior& prior = priors.prior(worst);
    message += fmt::format(
        ": the prior of {}, {}, is {:.2g} of its standard deviations away from what the data alone give, {}",
        axes[worst].name, value_at(0, 1, prior, axes[worst]), std::abs(conflict.estimate[worst]),
        value_at(conflict.estimate[worst], conflict.std[worst], prior, axes[worst]));
  }
  const bool matters = conflict.pull[worst] > k_matters;
  message += matters ? "; the answer is a compromise that neither supports: correct or widen the prior, or "
                       "find out what is wrong with the data"
                     : "; correct or widen the prior, or find out what is wrong with the data";
  return VerdictReason{VerdictPart::prior,
                       matters && value > k_reject_beyond ? VerdictLevel::reject : VerdictLevel::caution,
                       value,
                       limit,
                       std::move(message),
                       {}};
}

std::optional<VerdictReason> not_told_apart(const PriorConflict& conflict,
                                            const posterior::PriorTransform& priors,
                                            std::span<const model::Axis> axes) {
  const Index d = conflict.covariance.rows();
  const Eigen::LLT<Eigen::MatrixXd> prior(priors.covariance());
  Eigen::MatrixXd c = prior.matrixL().solve(conflict.covariance);
  c = prior.matrixL().solve(c.transpose()).eval();
  const auto is_open = [&](Index a, Index b) {
    return std::abs(c(a, b)) >= k_correlated * std::sqrt(c(a, a) * c(b, b)) &&
           largest_variance(c(a, a), c(b, b), c(a, b)) >= k_left_open;
  };
  Index widest = -1;  // of those that cannot be told from another
  for (Index a = 0; a < d; ++a)
    for (Index b = 0; b < d; ++b)
      if (a != b && is_open(a, b) && (widest < 0 || c(a, a) > c(widest, widest))) widest = a;
  if (widest < 0) return {};
  std::vector<std::string> others;
  double variance = 0;
  for (Index b = 0; b < d; ++b) {
    if (b == widest || !is_open(widest, b)) continue;
    others.push_back(axes[b].name);
    variance = std::max(variance, largest_variance(c(widest, widest), c(b, b), c(widest, b)));
  }
  return VerdictReason{
      VerdictPart::prior,
      VerdictLevel::caution,
      std::sqrt(variance),
      std::sqrt(k_left_open),
      fmt::format(
          "{0} cannot be told apart from {1}: the data determine a combination of them and leave {0} "
          "{2:.0f} % of the standard deviation of its prior, which decides the rest: add a sensor that "
          "tells them apart (a force beside displacements), or give {0} as known",
          axes[widest].name, fmt::join(others, ", "), 100 * std::sqrt(c(widest, widest))),
      {}};
}

}  // namespace knothe::assimilation
