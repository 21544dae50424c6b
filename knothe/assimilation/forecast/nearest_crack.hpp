#pragma once
/// @file The crack whose sensor displacements are closest to a given field (Rubio et al. 2019, Eq. 14).
#include <Eigen/Core>
#include <vector>

#include "knothe/assimilation/forecast/crack_meta_model.hpp"
#include "knothe/base/index.hpp"

namespace knothe::assimilation {

/// argmin_l ½|R v(l) − t|² for many targets t. v is a spline, so R v(l) = F b(l) with four of the basis
/// functions b active at a time: once Fᵀt is known, by one product for all targets, the square is a
/// polynomial on each piece of the spline.
class NearestCrack {
 public:
  /// `factor`: R, N × N_SVD.
  NearestCrack(const CrackMetaModel& meta_model, const Eigen::Ref<const Eigen::MatrixXd>& factor);

  /// The length nearest to each target (N × n): n, m.
  [[nodiscard]] Eigen::VectorXd lengths(const Eigen::Ref<const Eigen::MatrixXd>& targets) const;

 private:
  /// One piece of the spline, b(l) = C (1, s, s², s³) with s = l − left.
  struct Piece {
    double left, width;
    Eigen::Vector2d places, half_square;    ///< of the first pass: s, and |R v|²/2 there
    Eigen::Matrix<double, 2, 4> basis;      ///< b there, a row for each
    Eigen::Matrix<double, 3, 4> slope;      ///< of b: its coefficients of 1, s, s²
    Eigen::Matrix<double, 6, 1> own_slope;  ///< of |R v|²/2: its coefficients of 1 … s⁵
  };
  /// The minimum next to place `best` of the first pass, counted over all pieces. `products`: Fᵀt.
  using Products = Eigen::Ref<const Eigen::RowVectorXd, 0, Eigen::InnerStride<>>;
  [[nodiscard]] double minimum_near(Index best, const Products& products) const;

  Eigen::MatrixXd fields_;  ///< F, N × number of basis functions
  std::vector<Piece> pieces_;
};

}  // namespace knothe::assimilation
