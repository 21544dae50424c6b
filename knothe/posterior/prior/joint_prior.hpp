#pragma once
/// @file What several parameters are known to be together: a posterior that is the prior of what comes next.
#include <Eigen/Core>
#include <memory>
#include <string>
#include <vector>

#include "knothe/posterior/draws/mixture.hpp"
#include "knothe/posterior/prior/prior.hpp"

namespace knothe::posterior {

/// A density of some parameters, as a mixture of Gaussians: correlations and shape, which independent priors
/// do not have.
class JointPrior {
 public:
  /// Fitted to weighted points (n × d and n, sum 1) of a posterior. `origin`: what it is, in messages.
  /// Errors: DataError for points without spread.
  JointPrior(const Eigen::Ref<const Eigen::MatrixXd>& points,
             const Eigen::Ref<const Eigen::VectorXd>& weights, std::string origin);
  JointPrior(std::vector<MixtureComponent> components, std::string origin);

  [[nodiscard]] const std::vector<MixtureComponent>& components() const { return components_; }
  [[nodiscard]] const std::string& origin() const { return origin_; }
  [[nodiscard]] const Eigen::VectorXd& mean() const { return mean_; }
  [[nodiscard]] const Eigen::MatrixXd& covariance() const { return covariance_; }
  /// That of some of its coordinates, in this order.
  [[nodiscard]] Mixture marginal(const std::vector<Eigen::Index>& columns) const;

 private:
  void set_moments();

  std::vector<MixtureComponent> components_;
  std::string origin_;
  Eigen::VectorXd mean_;
  Eigen::MatrixXd covariance_;
};

/// The prior of each coordinate: normal, with its mean and std; PriorTransform has the rest.
[[nodiscard]] Prior marginal_of(std::shared_ptr<const JointPrior> joint, Eigen::Index column);

}  // namespace knothe::posterior
