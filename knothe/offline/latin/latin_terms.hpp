#pragma once
/// @file The fully separated form of LATIN-PGD as numbers, and the global stage's update of its functions
/// (docs/explanation/latin.md, "Full separation").
#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "knothe/base/index.hpp"

namespace knothe::offline {

/// The tensor grid of parameters: points are numbered with the last axis fastest.
struct LatinGrid {
  std::vector<Index> sizes;              ///< nodes of each axis
  std::vector<Eigen::VectorXd> weights;  ///< of quadrature on each axis, sum 1

  [[nodiscard]] Index points() const;
  [[nodiscard]] Eigen::VectorXd point_weights() const;  ///< their products, P
  /// Node of the axis at each point.
  [[nodiscard]] std::vector<Index> nodes(std::size_t axis) const;
};

/// c(t, p) = Σ_k S_k λ_k(t) Π_i γ_ki(p_i): coordinates of a state in R space modes that are orthonormal in
/// the energy. m terms.
struct LatinTerms {
  Eigen::MatrixXd space;                    ///< S, R × m: U_k = A S_k
  Eigen::MatrixXd time;                     ///< λ, n_t × m, m
  std::vector<Eigen::MatrixXd> parameters;  ///< γ, n_i × m for each axis

  [[nodiscard]] Index count() const { return time.cols(); }
  [[nodiscard]] std::vector<Index> sizes() const;  ///< nodes of each axis
  /// Π_i γ_ki at all grid points, P × m; without axis `left_out` if one is named.
  [[nodiscard]] Eigen::MatrixXd on_grid(Index left_out = -1) const;
  /// c at a step, R × P.
  [[nodiscard]] Eigen::MatrixXd coordinates(Index step) const;
  /// One term more; `functions` as the rows of `parameters`.
  void append(const Eigen::VectorXd& mode, const Eigen::VectorXd& of_time,
              const std::vector<Eigen::VectorXd>& functions);
  /// S_k of unit norm, γ of unit mean square and positive mean: λ carries amplitude and sign.
  void normalise();
};

/// The equations of the global stage at given damage, projected on the R modes: c minimises
/// Σ_t Σ_p w_p (½ cᵀ K c − fᵀ c), K = Uᵀ K(1 − d̂(t, p)) U.
struct LatinProjection {
  std::vector<Eigen::MatrixXd> stiffness;  ///< K for each step, R² × P
  std::vector<Eigen::MatrixXd> load;       ///< f for each step, R × P
  Eigen::VectorXd weights;                 ///< w, P

  [[nodiscard]] int steps() const { return stiffness.size(); }
};

/// All λ_k(t) given the rest (m equations at each step), then all γ_ki of each axis (m equations at each
/// node), `sweeps` times. A function g becomes g + relaxation (g_new − g).
void update_functions(const LatinProjection& projection, LatinTerms& terms, int sweeps, double relaxation,
                      std::size_t threads);
/// S_k, one term after the other (R equations each).
void update_space(const LatinProjection& projection, LatinTerms& terms, double relaxation,
                  std::size_t threads);

/// Rank one in (t, p): c = λ Π γ_i that minimises Σ_t Σ_p w (½ a c² − b c), by alternating from γ = 1.
struct RankOne {
  Eigen::VectorXd time;
  std::vector<Eigen::VectorXd> parameters;
  [[nodiscard]] Eigen::MatrixXd values() const;  ///< n_t × P
};
/// `a`, `b`: n_t × P.
[[nodiscard]] RankOne rank_one_functions(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b,
                                         const LatinGrid& grid);

}  // namespace knothe::offline
