#pragma once
/// @file Lower triangular monotone maps R^d → R^d (Rubio et al. 2019, Eq. 7).
///
/// Component k = 1 … d is  M^k(x) = Φ_c(x_1 … x_{k−1}) a_c + ∫₀^{x_k} r(Φ_e(x_1 … x_{k−1}, θ) a_e) dθ, with
/// bases, index sets and rectifier r > 0 of a MapSpecification.
#include <Eigen/Core>
#include <memory>
#include <string>
#include <vector>

#include "knothe/base/index.hpp"
#include "knothe/posterior/map/map_kernel.hpp"

namespace knothe::posterior {

/// A map and its derivatives at n points, one column per component.
struct MapBatch {
  Eigen::MatrixXd value;     ///< n × d
  Eigen::MatrixXd jacobian;  ///< n × d², ∂M_i/∂x_j in column i d + j
  Eigen::MatrixXd hessian;  ///< n × d·d(d+1)/2, ∂²M_i/∂x_a∂x_b in column i d(d+1)/2 + packed_index(a, b)
  Eigen::VectorXd log_determinant;  ///< n, log |det ∇M|; −∞ where the map is singular

  /// Makes room for n points of R^d; log_determinant always, derivatives as asked.
  void resize(Index n, Index d, int derivatives);
};

class TriangularMap {
 public:
  TriangularMap() = default;
  /// The identity, as a map of total order `order` (1 … k_max_order) in `dimension` ≥ 1 variables. Errors:
  /// UsageError.
  TriangularMap(Index dimension, int order, TailRadii radii = {});
  /// The identity, as a map of any parametrisation and index sets. Errors: UsageError for an index with a
  /// variable that the component may not have, a degree above k_max_order, a set without the empty index, an
  /// index twice.
  explicit TriangularMap(MapSpecification specification);

  [[nodiscard]] const Parametrisation& parametrisation() const { return structure().basis.parametrisation(); }
  [[nodiscard]] MapSpecification specification() const;

  [[nodiscard]] Index dimension() const { return kernel_ ? structure().dimension() : 0; }
  [[nodiscard]] int order() const { return kernel_ ? structure().order : 0; }
  [[nodiscard]] const OneVariableBasis& basis() const { return structure().basis; }
  [[nodiscard]] const MapComponent& component(Index k) const { return structure().components[k]; }

  /// All a_c, a_e, component after component. Free to change: every choice gives a monotone map.
  [[nodiscard]] const Eigen::VectorXd& coefficients() const { return coefficients_; }
  /// Errors: UsageError for another size or values that are not finite.
  void set_coefficients(const Eigen::VectorXd& coefficients);
  /// Takes over the coefficients of a map of the same dimension and parametrisation whose index sets are
  /// subsets of this one's; the others become zero.
  void embed(const TriangularMap& lower);
  /// One line per component: rectifier, basis, number of terms, highest degree, largest coefficients.
  [[nodiscard]] std::string describe() const;

  /// M(x), its derivatives in x up to `derivatives` (0, 1, 2) and log det, at n points (n × d).
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives, MapBatch& out) const;
  [[nodiscard]] Eigen::MatrixXd evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points) const;
  [[nodiscard]] Eigen::VectorXd log_determinant(const Eigen::Ref<const Eigen::MatrixXd>& points) const;

  /// x with M(x) = z, component by component: bracketing, then Newton inside the bracket; |M(x) − z| ≤ 1e-12
  /// (1 + |z|) wherever the slope allows. Finite for every finite z unless M^k is bounded, which a map with h
  /// ≡ 0 beyond some point is; there the last point of the search, finite too.
  [[nodiscard]] Eigen::MatrixXd inverse(const Eigen::Ref<const Eigen::MatrixXd>& z) const;

 private:
  [[nodiscard]] const MapStructure& structure() const { return kernel_->structure(); }

  std::shared_ptr<const MapKernel> kernel_;  ///< never changed: copies of a map share it
  Eigen::VectorXd coefficients_;
};

}  // namespace knothe::posterior
