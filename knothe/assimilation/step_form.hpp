#pragma once
/// @file What one datum says about w: a quadratic form.
#include <Eigen/Core>

namespace knothe::assimilation {

/// What one datum says about w: its quadratic form, kept per step so that a step can be taken out again.
struct StepForm {
  Eigen::MatrixXd quadratic;  ///< G_t, r × r
  Eigen::VectorXd linear;     ///< g_t, r
  double constant = 0;        ///< c_t
  double log_normaliser = 0;  ///< n_t log 2π + log det R_t
  Eigen::Index used = 0;      ///< values used
  Eigen::Index missing = 0;   ///< values missing (NaN)

  /// Makes a form of r functions that says nothing.
  [[nodiscard]] static StepForm zero(Eigen::Index r);
  void add(const StepForm& other);
  void subtract(const StepForm& other);
  /// The likelihood to the power `power`; the counts stay.
  void raise(double power);
};

}  // namespace knothe::assimilation
