#pragma once
/// @file Products of mixtures over groups of coordinates that hardly depend on each other.
#include <Eigen/Core>
#include <functional>
#include <initializer_list>
#include <vector>

#include "knothe/posterior/draws/mixture.hpp"

namespace knothe::posterior {

/// Π_g q_g(x_g), each q_g a mixture over its own coordinates. Where groups are independent a few components
/// for each do what one mixture over all coordinates needs the product of their numbers for.
class MixtureProduct {
 public:
  struct Factor {
    std::vector<Eigen::Index> coordinates;  ///< one for each of the mixture's, each in one factor
    Mixture mixture;
  };

  /// Errors: UsageError if the factors' coordinates are not 0 … d − 1, each once.
  explicit MixtureProduct(std::vector<Factor> factors);

  [[nodiscard]] Eigen::Index dimension() const { return dimension_; }
  /// n × d; each factor's points are stratified and in an order of their own.
  void sample(Eigen::Index n, RandomNumbers& random, Eigen::MatrixXd& points) const;
  /// n log-densities.
  void log_density(const Eigen::Ref<const Eigen::MatrixXd>& points, Eigen::VectorXd& out) const;

 private:
  std::vector<Factor> factors_;
  Eigen::Index dimension_ = 0;
};

/// Some columns of a matrix.
[[nodiscard]] Eigen::MatrixXd columns_of(const Eigen::Ref<const Eigen::MatrixXd>& points,
                                         const std::vector<Eigen::Index>& columns);

/// Coordinates in groups: two are in one where in one of the samples their ranks, cut into quarters, depend
/// on each other (mean square contingency above 0.04), or both depend on a third. Each in ascending order.
[[nodiscard]] std::vector<std::vector<Eigen::Index>> dependent_groups(
    std::initializer_list<std::reference_wrapper<const Eigen::MatrixXd>> samples);

}  // namespace knothe::posterior
