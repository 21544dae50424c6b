#pragma once
/// @file What one does with a map: the distribution T_♯ρ of its image, ρ = N(0, I).
#include <Eigen/Core>
#include <cstdint>

#include "knothe/base/index.hpp"
#include "knothe/posterior/map/composed_map.hpp"

namespace knothe::posterior {

/// The distribution of T(x), x ~ N(0, I). Everything here is about the map; how well it stands for the
/// target, the weights tell (ImportanceCorrection).
///
/// Marginals and conditionals use that T is triangular: its first m components are a map of their own, the
/// one of the marginal of z_1 … z_m; and with z_1 … z_m given, the others are a map of x_{m+1} … x_d.
class MapDistribution {
 public:
  /// Errors: UsageError for a map without dimension.
  explicit MapDistribution(ComposedMap map);

  [[nodiscard]] Index dimension() const { return map_.dimension(); }
  [[nodiscard]] const ComposedMap& map() const { return map_; }
  /// log of the density at the points z (n × d).
  [[nodiscard]] Eigen::VectorXd log_density(const Eigen::Ref<const Eigen::MatrixXd>& z) const;
  /// The marginal distribution of the first m coordinates. Errors (of both): UsageError for m
  /// outside 1 … d, or for a map that is not triangular.
  [[nodiscard]] MapDistribution leading(Index m) const;

  /// n points of the reference whose images are independent draws of all d coordinates with the first m equal
  /// to `given`. Exact: the leading block is inverted, the other reference variables are drawn.
  [[nodiscard]] Eigen::MatrixXd conditional_reference(const Eigen::VectorXd& given, Index n,
                                                      std::uint64_t seed) const;

 private:
  ComposedMap map_;
};

}  // namespace knothe::posterior
