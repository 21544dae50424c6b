#pragma once
/// @file Which crack moves the sensors most nearly as a given field does (Rubio et al. 2019, Eq. 14).
#include <Eigen/Core>
#include <vector>

#include "knothe/forecast/crack_meta_model.hpp"

namespace knothe::forecast {

/// argmin_l ½|R v(l) − t|² for many targets t. v is a spline, so R v(l) = F b(l) with four of the basis
/// functions b active at a time: once Fᵀt is known, by one product for all targets, the square and its
/// derivative cost a few multiplications at any length.
class NearestCrack {
 public:
  /// `factor`: R, N × N_SVD.
  NearestCrack(const CrackMetaModel& meta_model, const Eigen::Ref<const Eigen::MatrixXd>& factor);

  /// The length nearest to each target (N × n): n, m.
  [[nodiscard]] Eigen::VectorXd lengths(const Eigen::Ref<const Eigen::MatrixXd>& targets) const;

 private:
  /// Points of the first pass in one interval of the spline.
  struct Interval {
    Eigen::Vector4d length, half_square;  ///< l and |R v(l)|²/2
    Eigen::Matrix4d basis;                ///< b(l), a row for each
  };
  /// Of the target with these `products` Fᵀt.
  [[nodiscard]] double nearest(const double* products) const;
  [[nodiscard]] double root(const double* products, double low, double high) const;

  numerics::CubicSplineBasis basis_;
  Eigen::MatrixXd fields_;  ///< F, N × number of basis functions
  Eigen::MatrixXd gram_;    ///< FᵀF
  std::vector<Interval> intervals_;
};

}  // namespace knothe::forecast
