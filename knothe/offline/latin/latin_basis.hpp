#pragma once
/// @file The space modes of LATIN-PGD and what the global stage needs of them.
#include <Eigen/Core>

#include "knothe/base/index.hpp"
#include "knothe/offline/latin/latin_body.hpp"

namespace knothe::offline {

/// R space modes that span all states found so far (the archive), orthonormal in the elastic energy, and the
/// r ≤ R directions among them in which the global stage looks for the next states (the working modes): U = A
/// T, Tᵀ T = I. Coordinates of a state are (τ, c₁, …): row 0 belongs to the unit lift.
class LatinBasis {
 public:
  explicit LatinBasis(const LatinBody& body) : body_(body) {}

  [[nodiscard]] Index archived() const { return directions_.rows(); }  ///< R
  [[nodiscard]] Index size() const { return directions_.cols(); }      ///< r
  /// Elastic forces of the archived modes, n_a × R: their displacements anywhere follow from them.
  [[nodiscard]] const Eigen::MatrixXd& archive() const { return archive_forces_; }
  /// Elastic forces of the working modes, n_a × r.
  [[nodiscard]] const Eigen::MatrixXd& forces() const { return forces_; }
  [[nodiscard]] const Eigen::MatrixXd& directions() const { return directions_; }  ///< T
  /// Strains of lift and working modes, (r + 1) × 6 n_g.
  [[nodiscard]] const Eigen::MatrixXd& strains() const { return strains_; }
  /// Row packed(i, j), column g: w_g ε_i : C : ε_j, 0 ≤ j ≤ i, i ≥ 1. What damage d takes from the projected
  /// stiffness is one product with it, Σ_g d_g w_g ε_i : C : ε_j. Only the first packed(r + 1, 0) rows count.
  [[nodiscard]] const Eigen::MatrixXd& projected() const { return projected_; }
  [[nodiscard]] static Index packed(Index i, Index j) { return (i - 1) * (i + 2) / 2 + j; }

  /// Coordinates in the archive, (R + 1) × n, from those in the working modes, and back (the nearest ones).
  [[nodiscard]] Eigen::MatrixXd to_archive(const Eigen::MatrixXd& coordinates) const;
  [[nodiscard]] Eigen::MatrixXd to_working(const Eigen::MatrixXd& coordinates) const;

  /// A working mode along the displacement of the active dofs under the elastic force `force`; false if less
  /// than `threshold` of its energy norm is new.
  bool add(const Eigen::VectorXd& force, double threshold);
  /// Cells join the body; everything is extended.
  void join(LatinBody& body, std::span<const std::int64_t> cells);
  /// Recompression: as few working modes as represent the `states` (archive coordinates, (R + 1) × n) with a
  /// root mean square error of at most `allowed` (Euclidean norm over the active dofs, m).
  void recompress(const Eigen::MatrixXd& states, double allowed);

  /// What it consists of: the rest follows from it and the body.
  struct Modes {
    Eigen::MatrixXd displacements, forces;  ///< of the archive, n_a × R
    Eigen::MatrixXd directions;             ///< T, R × r
  };
  [[nodiscard]] Modes modes() const { return {archive_displacements_, archive_forces_, directions_}; }
  /// As it was when `modes` were taken; the body's active cells must be those of then.
  void restore(const Modes& modes);

 private:
  void append(const Eigen::VectorXd& direction);
  void rebuild();
  void project(Index mode);

  const LatinBody& body_;
  Eigen::MatrixXd archive_displacements_, archive_forces_;  ///< n_a × R
  Eigen::MatrixXd directions_;                              ///< T, R × r
  Eigen::MatrixXd forces_, strains_, projected_;            ///< of the working modes
};

}  // namespace knothe::offline
