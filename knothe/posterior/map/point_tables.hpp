#pragma once
/// @file Everything about a map at fixed points that does not depend on its coefficients, laid out for speed.
///
/// With the factors in x_1 … x_{k−1} collected in `prefix` (one column per product), component k of a map is,
/// for all points at once (columns over points, ∘ elementwise),
///   b_j = prefix a_{e,j},   h = Σ_j b_j ∘ ψ_j,   M = constant_prefix a_c + V(b),   V = ∫₀^{x_k} r(Σ_j b_j
///   ψ_j) dθ,
/// a_{e,j} being the coefficients of products whose degree in x_k is j. All derivatives of M and of log r(h)
/// in the coefficients are prefix ⊗ those in b:
///   square:      g_j = ∂V/∂b_j = 2 Σ_l I_jl ∘ b_l,   ∂²V/∂b_j∂b_l = 2 I_jl,   I_jl = ∫₀^{x_k} ψ_j ψ_l dθ,
///   any other r: sums over a Gauss–Legendre rule on [0, x_k] with r, r' ψ_j, r'' ψ_j ψ_l.
#include <Eigen/Core>
#include <vector>

#include "knothe/base/index.hpp"
#include "knothe/posterior/map/triangular_map.hpp"

namespace knothe::posterior {

/// Coefficients in the order of the tables: per component a_c, then a_{e,0}, a_{e,1}, …
class MapLayout {
 public:
  /// The coefficients of one degree in x_k: where they begin in a_e, and the column of prefix of each.
  struct Group {
    Index begin = 0;
    std::vector<Index> column;
    [[nodiscard]] Index size() const { return std::ssize(column); }
  };
  struct Component {
    Index offset = 0;                  ///< of a_c
    Index constant_count = 0;          ///< n_c
    Index monotone_count = 0;          ///< n_e
    std::vector<Group> groups;         ///< by degree in x_k, from 0
    std::vector<MultiIndex> constant;  ///< the products of constant_prefix
    std::vector<MultiIndex> prefix;    ///< those of prefix; the first is 1
    [[nodiscard]] Index monotone_begin() const { return offset + constant_count; }
    [[nodiscard]] Index count() const { return constant_count + monotone_count; }
    [[nodiscard]] Index degrees() const { return std::ssize(groups); }
  };

  MapLayout() = default;
  explicit MapLayout(const TriangularMap& map);
  [[nodiscard]] const std::vector<Component>& components() const { return components_; }
  [[nodiscard]] const Component& component(Index k) const { return components_[k]; }
  [[nodiscard]] Index size() const { return std::ssize(to_map_); }
  /// From the order of TriangularMap::coefficients() to that of the tables, and back.
  void gather(const Eigen::VectorXd& map_coefficients, Eigen::VectorXd& table_order) const;
  void scatter(const Eigen::VectorXd& table_order, Eigen::VectorXd& map_coefficients) const;

 private:
  std::vector<Component> components_;
  std::vector<Index> to_map_;  ///< index in the map of each entry in table order
};

/// The tables at fixed points for maps of one layout.
class PointTables {
 public:
  /// A stretch of θ with its part of the Gauss–Legendre rule, for the points that reach it.
  struct Piece {
    std::vector<Index> rows;  ///< those points, increasing
    Index nodes = 0;
    Eigen::MatrixXd weight;  ///< rows × nodes
    Eigen::MatrixXd psi;     ///< rows × (nodes · m), ψ_j at node q in column q m + j
  };

  PointTables() = default;
  PointTables(Eigen::MatrixXd points, const TriangularMap& map, const MapLayout& layout);

  [[nodiscard]] const Eigen::MatrixXd& points() const { return points_; }  ///< n × d
  [[nodiscard]] Rectifier rectifier() const { return rectifier_; }
  /// ψ_0 … ψ_{m−1} of Φ_e in variable k, n × m.
  [[nodiscard]] const Eigen::MatrixXd& psi(Index k) const { return psi_[k]; }
  /// I_jl of variable k, n × m(m + 1)/2 by packed_index; square only.
  [[nodiscard]] const Eigen::MatrixXd& integrals(Index k) const { return integrals_[k]; }
  /// The rule on [0, x_k]; any other rectifier.
  [[nodiscard]] const std::vector<Piece>& pieces(Index k) const { return pieces_[k]; }
  /// The products that span Φ_c of component k, n × n_c.
  [[nodiscard]] const Eigen::MatrixXd& constant_prefix(Index k) const { return constant_prefix_[k]; }
  /// The products of the functions of Φ_e in the variables before k, n × their number.
  [[nodiscard]] const Eigen::MatrixXd& prefix(Index k) const { return prefix_[k]; }

 private:
  void tabulate_integrals(const OneVariableBasis& basis, Index k, Index degrees);
  void tabulate_pieces(const OneVariableBasis& basis, Index k, Index degrees);

  Eigen::MatrixXd points_;
  Rectifier rectifier_ = Rectifier::square;
  std::vector<Eigen::MatrixXd> psi_, integrals_, constant_prefix_, prefix_;
  std::vector<std::vector<Piece>> pieces_;
};

/// One component at the points of a table, with its derivatives in b. Keeps its memory.
class ComponentValues {
 public:
  Eigen::MatrixXd b;          ///< n × m
  Eigen::MatrixXd g;          ///< n × m: ∂V/∂b_j
  Eigen::MatrixXd curvature;  ///< n × m(m + 1)/2: ∂²V/∂b_j∂b_l, packed; empty for the square: 2 I_jl
  Eigen::VectorXd h, value;
  Eigen::VectorXd log_slope, log_slope_first, log_slope_second;  ///< log r(h) and its derivatives in h

  /// b and h alone.
  void evaluate_slope(const PointTables& tables, const MapLayout& layout, Index k,
                      const Eigen::VectorXd& coefficients);
  /// All that derivatives of this order (0, 1, 2) of the objective need. False where the square has h ≤ 0 at
  /// a point: then the map is no longer in the feasible set of the objective.
  bool evaluate(const PointTables& tables, const MapLayout& layout, Index k,
                const Eigen::VectorXd& coefficients, int derivatives);

 private:
  void square(const PointTables& tables, Index k);
  void integrate(const PointTables& tables, Index k, int derivatives);
  void logarithm(Rectifier rectifier, int derivatives);

  Eigen::MatrixXd local_b_, local_g_, local_curvature_;
  Eigen::VectorXd local_value_, node_h_, zeroth_, first_, second_;
};

}  // namespace knothe::posterior
