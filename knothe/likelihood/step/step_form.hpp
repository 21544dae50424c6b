#pragma once
/// @file What one datum says about w: a quadratic form.
#include <Eigen/Core>
#include <cstddef>
#include <vector>

namespace knothe::likelihood {

/// What one datum says about w: its quadratic form, kept per step so that a step can be taken out again.
struct StepForm {
  Eigen::MatrixXd quadratic;  ///< G_t, r × r
  Eigen::VectorXd linear;     ///< g_t, r
  double constant = 0;        ///< c_t
  double log_normaliser = 0;  ///< n_t log 2π + log det R_t
  Eigen::Index used = 0;      ///< values used
  Eigen::Index missing = 0;   ///< values missing (NaN)
  double discounted = 0;      ///< of the values used, how many no longer count (`raise`)

  /// Makes a form of r functions that says nothing.
  [[nodiscard]] static StepForm zero(Eigen::Index r);
  void add(const StepForm& other);
  /// The likelihood to the power `power`; of n values then n · `power` count.
  void raise(double power);
};

/// The forms of successive steps, summed up in blocks of equally many steps (the last may have fewer): the
/// data before a time can be compared with those after it, at a cost that does not grow with their number.
class FormBlocks {
 public:
  static constexpr std::size_t k_max_blocks = 16;  ///< then two each become one

  void add(const StepForm& form);
  [[nodiscard]] const std::vector<StepForm>& forms() const { return forms_; }  ///< in the order of the steps
  [[nodiscard]] std::size_t steps_per_block() const { return steps_per_block_; }

 private:
  std::vector<StepForm> forms_;
  std::size_t steps_per_block_ = 1, steps_in_last_ = 0;
};

/// The form of a datum given those before it where steps share an error and the model has a discrepancy, as a
/// function of (v, u, z_1 … z_G), each but v of s numbers: the datum is predicted by C v + u in place of C v
/// in the space modes, and of the data before it those of group g by terms whose sum is z_g. A group has the
/// same noise and the same dofs; the datum joins `group`, which may be a new one (= groups).
struct MovedForm {
  StepForm form;
  Eigen::Index groups = 0, group = 0;
};

/// More groups share the last z: the data of those are taken to have come as most of them did.
inline constexpr Eigen::Index k_max_moved_groups = 6;

}  // namespace knothe::likelihood
