#pragma once
/// @file Products of mixtures over groups of coordinates that hardly depend on each other.
#include <Eigen/Core>
#include <functional>
#include <initializer_list>
#include <limits>
#include <vector>

#include "knothe/posterior/draws/mixture.hpp"
#include "knothe/posterior/draws/support_ends.hpp"

namespace knothe::posterior {

/// Π_g q_g(x_g), each q_g a mixture over its own coordinates. Where groups are independent a few components
/// for each do what one mixture over all coordinates needs the product of their numbers for.
class MixtureProduct {
 public:
  struct Factor {
    std::vector<Eigen::Index> coordinates;  ///< one for each of the mixture's, each in one factor
    Mixture mixture;
  };

  /// `ends`: of the support; what the mixtures draw beyond is mirrored there, but for one draw in `as_drawn`
  /// (0: none), which finds out where they are wrong. Empty: none. Errors: UsageError if the factors'
  /// coordinates are not 0 … d − 1, each once.
  explicit MixtureProduct(std::vector<Factor> factors, SupportEnds ends = {}, Eigen::Index as_drawn = 20);

  [[nodiscard]] Eigen::Index dimension() const { return dimension_; }
  /// n × d; each factor's points are stratified and in an order of their own.
  void sample(Eigen::Index n, RandomNumbers& random, Eigen::MatrixXd& points) const;
  /// n log-densities.
  void log_density(const Eigen::Ref<const Eigen::MatrixXd>& points, Eigen::VectorXd& out) const;

 private:
  [[nodiscard]] bool is_folded() const { return ends_.lower.size() > 0 && ends_.any(); }
  void folded_log_density(const Factor& factor, const Eigen::MatrixXd& points, Eigen::VectorXd& out) const;

  std::vector<Factor> factors_;
  SupportEnds ends_;
  Eigen::Index as_drawn_;
  Eigen::Index dimension_ = 0;
};

/// Some columns of a matrix.
[[nodiscard]] Eigen::MatrixXd columns_of(const Eigen::Ref<const Eigen::MatrixXd>& points,
                                         const std::vector<Eigen::Index>& columns);

/// Coordinates in groups: two are in one where in one of the samples their ranks, cut into quarters, depend
/// on each other (mean square contingency above 0.04, and above what as many independent points as the
/// samples are `worth` would hardly show), or both depend on a third. Each in ascending order.
[[nodiscard]] std::vector<std::vector<Eigen::Index>> dependent_groups(
    std::initializer_list<std::reference_wrapper<const Eigen::MatrixXd>> samples,
    double worth = std::numeric_limits<double>::infinity());

}  // namespace knothe::posterior
