#pragma once
/// @file Affine maps and compositions of maps (Rubio et al. 2019, Eq. 10).
#include <Eigen/Core>
#include <string>
#include <variant>
#include <vector>

#include "knothe/base/index.hpp"
#include "knothe/posterior/map/triangular_map.hpp"

namespace knothe::posterior {

/// x ↦ shift + R L x with L lower triangular, positive diagonal: the "linear map L" of section 2.2.3, from
/// the Laplace approximation; R is a rotation, in most maps none. With a rotation the map is not triangular
/// in its own coordinates but in Rᵀ z.
struct AffineMap {
  Eigen::VectorXd shift;          ///< d
  Eigen::MatrixXd lower;          ///< L, d × d
  Eigen::MatrixXd rotation = {};  ///< R, d × d, orthogonal; empty: the identity
  [[nodiscard]] bool is_triangular() const { return rotation.size() == 0; }
  [[nodiscard]] Eigen::MatrixXd matrix() const {  ///< R L
    return is_triangular() ? lower : Eigen::MatrixXd(rotation * lower);
  }

  [[nodiscard]] Index dimension() const { return shift.size(); }
  [[nodiscard]] double log_determinant() const { return lower.diagonal().array().log().sum(); }
  [[nodiscard]] static AffineMap identity(Index d);
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives, MapBatch& out) const;
  [[nodiscard]] Eigen::MatrixXd inverse(const Eigen::Ref<const Eigen::MatrixXd>& z) const;
  /// One line: the range of the shift and of the diagonal.
  [[nodiscard]] std::string describe() const;
};

/// M_1 ∘ M_2 ∘ … ∘ M_n: the map appended last acts first on the point (Eq. 10: M_1 belongs to the first
/// datum).
class ComposedMap {
 public:
  using Part = std::variant<AffineMap, TriangularMap>;

  /// The identity of R^d.
  explicit ComposedMap(Index dimension = 0) : dimension_(dimension) {}

  /// Errors: UsageError for another dimension.
  void append(Part part);
  void pop_back() { parts_.pop_back(); }
  [[nodiscard]] Index dimension() const { return dimension_; }
  [[nodiscard]] const std::vector<Part>& parts() const { return parts_; }

  /// Value, derivatives up to order 2 by the chain rule, log det.
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives, MapBatch& out) const;
  [[nodiscard]] Eigen::MatrixXd evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points) const;
  [[nodiscard]] Eigen::MatrixXd inverse(const Eigen::Ref<const Eigen::MatrixXd>& z) const;
  /// log of the density M_♯ρ at the points z, ρ = N(0, I) (Eq. 5). −∞ where the map is singular.
  [[nodiscard]] Eigen::VectorXd log_density(const Eigen::Ref<const Eigen::MatrixXd>& z) const;
  /// For a person: the parts in the order in which they act on a point, each with what it is made of.
  [[nodiscard]] std::string describe() const;

 private:
  Index dimension_ = 0;
  std::vector<Part> parts_;
};

/// log N(x; 0, I) at n points (n × d).
[[nodiscard]] Eigen::VectorXd standard_normal_log_density(const Eigen::Ref<const Eigen::MatrixXd>& points);

}  // namespace knothe::posterior
