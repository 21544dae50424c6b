#pragma once
/// @file What one does with a map: the distribution T_♯ρ of its image, ρ = N(0, I).
#include <Eigen/Core>
#include <cstdint>
#include <span>

#include "knothe/numerics/integrate/quadrature.hpp"
#include "knothe/numerics/statistics/weighted_statistics.hpp"
#include "knothe/transport/map/composed_map.hpp"

namespace knothe::transport {

/// The distribution of T(x), x ~ N(0, I). Everything here is about the map; how well it stands for the
/// target, the weights tell (ImportanceCorrection).
///
/// Marginals and conditionals use that T is triangular: its first m components are a map of their own, the
/// one of the marginal of z_1 … z_m; and with z_1 … z_m given, the others are a map of x_{m+1} … x_d.
class MapDistribution {
 public:
  /// Errors: UsageError for a map without dimension.
  explicit MapDistribution(ComposedMap map);

  [[nodiscard]] Eigen::Index dimension() const { return map_.dimension(); }
  [[nodiscard]] const ComposedMap& map() const { return map_; }
  /// False for maps with a rotation: of the solver's, ask for Orientation::given.
  [[nodiscard]] bool is_triangular() const;

  /// log of the density at the points z (n × d).
  [[nodiscard]] Eigen::VectorXd log_density(const Eigen::Ref<const Eigen::MatrixXd>& z) const;
  /// n independent draws, n × d.
  [[nodiscard]] Eigen::MatrixXd sample(Eigen::Index n, std::uint64_t seed) const;
  /// Nodes T(x_i) with the weights of a rule of the reference: Σ w_i f(T(x_i)) ≈ ∫ f d(T_♯ρ) (Rubio et al.
  /// 2019, Eq. 4).
  [[nodiscard]] numerics::PointRule push_forward(const numerics::PointRule& rule) const;
  /// Of the map's distribution: by a Gauss–Hermite rule in up to three dimensions (exact for the moments of a
  /// polynomial map of order ≤ 9), beyond by scrambled Sobol points with matched moments (mean and covariance
  /// exact for affine maps; fourth moments want many points).
  [[nodiscard]] numerics::Moments moments(Eigen::Index points = 16384, std::uint64_t seed = 1) const;

  /// The marginal distribution of the first m coordinates. Errors (this and all below that need it):
  /// UsageError for m outside 1 … d, or for a map that is not triangular.
  [[nodiscard]] MapDistribution leading(Eigen::Index m) const;

  /// log density of z_{m+1} … z_d (n × (d − m)) given z_1 … z_m = `given`. Exact.
  [[nodiscard]] Eigen::VectorXd conditional_log_density(const Eigen::VectorXd& given,
                                                        const Eigen::Ref<const Eigen::MatrixXd>& rest) const;
  /// n independent draws of all d coordinates with the first m equal to `given`. Exact: the leading block is
  /// inverted, the other reference variables are drawn.
  [[nodiscard]] Eigen::MatrixXd conditional_sample(const Eigen::VectorXd& given, Eigen::Index n,
                                                   std::uint64_t seed) const;
  /// The points of the reference that these draws are the images of.
  [[nodiscard]] Eigen::MatrixXd conditional_reference(const Eigen::VectorXd& given, Eigen::Index n,
                                                      std::uint64_t seed) const;
  /// The same with the coordinates named (from 0). Errors: UsageError, with what to do, if they are not the
  /// leading ones in some order: a triangular map has no other exact conditionals.
  [[nodiscard]] Eigen::MatrixXd conditional_sample(std::span<const Eigen::Index> coordinates,
                                                   const Eigen::VectorXd& given, Eigen::Index n,
                                                   std::uint64_t seed) const;

 private:
  void require_triangular(const char* what) const;
  void require_coordinate(Eigen::Index k) const;

  ComposedMap map_;
};

}  // namespace knothe::transport
