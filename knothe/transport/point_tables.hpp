#pragma once
/// @file Everything about a map at fixed points that does not depend on its coefficients, laid out for speed.
///
/// With the factors in x_1 … x_{k−1} collected in `prefix` (one column per product, by increasing degree),
/// component k of a map is, for all points at once (columns over points, ∘ elementwise),
///   b_j = prefix a_{e,j},   h = Σ_j b_j ∘ ψ_j,   g_j = Σ_l I_jl ∘ b_l,   M = prefix a_c + Σ_j b_j ∘ g_j,
/// a_{e,j} being the coefficients of products whose degree in x_k is j, and I_jl = ∫₀^{x_k} ψ_j ψ_l dθ. The
/// columns of prefix that belong to a_{e,j} are the first ones, those of degree ≤ p − 1 − j.
#include <Eigen/Core>
#include <vector>

#include "knothe/transport/triangular_map.hpp"

namespace knothe::transport {

/// Coefficients in the order of the tables: per component a_c, then a_{e,0}, a_{e,1}, …
class MapLayout {
 public:
  struct Component {
    Eigen::Index offset = 0;          ///< of a_c
    Eigen::Index constant_count = 0;  ///< n_c, also the number of prefix columns
    Eigen::Index monotone_count = 0;  ///< n_e
    std::vector<Eigen::Index>
        group_begin;  ///< of a_{e,j}, counted from the start of a_e; one more entry for the end
    [[nodiscard]] Eigen::Index group_size(Eigen::Index j) const {
      return group_begin[static_cast<std::size_t>(j) + 1] - group_begin[static_cast<std::size_t>(j)];
    }
    [[nodiscard]] Eigen::Index monotone_begin() const { return offset + constant_count; }
    [[nodiscard]] Eigen::Index count() const { return constant_count + monotone_count; }
  };

  MapLayout() = default;
  MapLayout(Eigen::Index dimension, int order);
  [[nodiscard]] const std::vector<Component>& components() const { return components_; }
  [[nodiscard]] Eigen::Index size() const { return static_cast<Eigen::Index>(to_map_.size()); }
  /// From the order of TriangularMap::coefficients() to that of the tables, and back.
  void gather(const Eigen::VectorXd& map_coefficients, Eigen::VectorXd& table_order) const;
  void scatter(const Eigen::VectorXd& table_order, Eigen::VectorXd& map_coefficients) const;

 private:
  std::vector<Component> components_;
  std::vector<Eigen::Index> to_map_;  ///< index in the map of each entry in table order
};

/// The tables at fixed points, for maps up to some order.
class PointTables {
 public:
  PointTables() = default;
  PointTables(Eigen::MatrixXd points, int order, const TailedHermite& basis);

  [[nodiscard]] const Eigen::MatrixXd& points() const { return points_; }  ///< n × d
  [[nodiscard]] int order() const { return order_; }
  /// ψ_0 … ψ_{p} of variable k, n × (p + 1).
  [[nodiscard]] const Eigen::MatrixXd& psi(Eigen::Index k) const { return psi_[static_cast<std::size_t>(k)]; }
  /// I_jl of variable k, n × p(p + 1)/2 by sampling::packed_index.
  [[nodiscard]] const Eigen::MatrixXd& integrals(Eigen::Index k) const {
    return integrals_[static_cast<std::size_t>(k)];
  }
  /// The products of tangent-tailed functions that span Φ_c of component k, n × their number.
  [[nodiscard]] const Eigen::MatrixXd& constant_prefix(Eigen::Index k) const {
    return constant_prefix_[static_cast<std::size_t>(k)];
  }
  /// The same products of the level-tailed functions of Φ_e.
  [[nodiscard]] const Eigen::MatrixXd& prefix(Eigen::Index k) const {
    return prefix_[static_cast<std::size_t>(k)];
  }

 private:
  Eigen::MatrixXd points_;
  int order_ = 0;
  std::vector<Eigen::MatrixXd> psi_, integrals_, constant_prefix_, prefix_;
};

/// b, g, h and M of one component at the points of a table. Keeps its memory.
struct ComponentValues {
  Eigen::MatrixXd b, g;  ///< n × p
  Eigen::VectorXd h, value;

  /// `order` ≤ tables.order(): the order of the map that `coefficients` (in table order) belong to.
  void evaluate(const PointTables& tables, const MapLayout& layout, int order, Eigen::Index k,
                const Eigen::VectorXd& coefficients);
  /// h alone, of which only `b` and `h` are filled.
  void evaluate_slope(const PointTables& tables, const MapLayout& layout, int order, Eigen::Index k,
                      const Eigen::VectorXd& coefficients);
};

}  // namespace knothe::transport
