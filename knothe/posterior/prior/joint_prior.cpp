#include "knothe/posterior/prior/joint_prior.hpp"

#include <Eigen/Cholesky>
#include <cmath>
#include <utility>

#include "knothe/base/error.hpp"
#include "knothe/numerics/statistics/weighted_statistics.hpp"
#include "knothe/posterior/draws/mixture_fit.hpp"

namespace knothe::posterior {

using Eigen::Index;

namespace {

/// In coordinates in which the points have covariance I, so that no part is thinner than what they can show.
std::vector<MixtureComponent> fitted(const Eigen::Ref<const Eigen::MatrixXd>& points,
                                     const Eigen::Ref<const Eigen::VectorXd>& weights) {
  Eigen::VectorXd mean;
  Eigen::MatrixXd covariance;
  numerics::mean_and_covariance(points, weights, mean, covariance);
  const Eigen::LLT<Eigen::MatrixXd> factor(covariance);
  if (points.rows() < 2 || factor.info() != Eigen::Success)
    throw DataError("the points of a posterior have no spread: they cannot be a prior");
  const Eigen::MatrixXd white =
      factor.matrixL().solve((points.rowwise() - mean.transpose()).transpose()).transpose();
  // Of few parameters points are nodes of a quadrature or of a map, whose weights have all but no error.
  const double worth = points.cols() <= 3 ? 1e6 : 0;
  std::vector<MixtureComponent> parts = fit_mixture(
      white, weights, {}, {.max_iterations = 1000, .min_gain = 1e-7, .min_std = 0.3, .worth = worth});
  for (MixtureComponent& part : parts) {
    part.centre = mean + factor.matrixL() * part.centre;
    part.lower = factor.matrixL() * part.lower;
  }
  return parts;
}

}  // namespace

JointPrior::JointPrior(const Eigen::Ref<const Eigen::MatrixXd>& points,
                       const Eigen::Ref<const Eigen::VectorXd>& weights, std::string origin)
    : components_(fitted(points, weights)), origin_(std::move(origin)) {
  set_moments();
}

JointPrior::JointPrior(std::vector<MixtureComponent> components, std::string origin)
    : components_(Mixture(std::move(components)).components()), origin_(std::move(origin)) {
  set_moments();
}

void JointPrior::set_moments() {
  const Index d = components_.front().centre.size();
  mean_.setZero(d);
  covariance_.setZero(d, d);
  double total = 0;
  for (const MixtureComponent& c : components_) total += c.weight;
  for (const MixtureComponent& c : components_) mean_ += c.weight / total * c.centre;
  for (const MixtureComponent& c : components_)
    covariance_ += c.weight / total *
                   (c.lower * c.lower.transpose() + (c.centre - mean_) * (c.centre - mean_).transpose());
}

Mixture JointPrior::marginal(const std::vector<Index>& columns) const {
  std::vector<MixtureComponent> parts;
  for (const MixtureComponent& c : components_) {
    const Eigen::MatrixXd covariance = (c.lower * c.lower.transpose())(columns, columns);
    parts.push_back({c.weight, c.centre(columns), covariance.llt().matrixL()});
  }
  return Mixture(std::move(parts));
}

Prior marginal_of(std::shared_ptr<const JointPrior> joint, Index column) {
  const double mean = joint->mean()[column], std = std::sqrt(joint->covariance()(column, column));
  return Prior::normal(mean, std).with_joint(std::move(joint), column);
}

}  // namespace knothe::posterior
