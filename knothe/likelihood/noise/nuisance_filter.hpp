#pragma once
/// @file What a datum depends on beside the parameters, integrated out.
#include <Eigen/Core>
#include <memory>

#include "knothe/likelihood/noise/conditional_filter.hpp"
#include "knothe/likelihood/noise/shared_error.hpp"

namespace knothe::likelihood {

/// The linear-Gaussian nuisances of a noise model (docs/explanation/assimilation.md): d_t = y_t(p) + B_t ν_t
/// + e_t with, in ν,
/// - s, an error of each dof that all steps share (`SharedError`): reference pictures, offsets;
/// - ε ~ N(0, σ²): a measured displacement is too large by 1 + ε, all of them by the same. Its B_t is the
///   prediction y_t at the centre (about the measured values, their noise would bias it);
/// - z ~ N(0, I), whose B_t is given for each step: errors that last, of known size;
/// - φ_t ~ N(0, I), of step t alone, whose B_t is F_t: an error of the clock.
/// First s goes, given v and x = (ε, z, φ), then x. Without s a φ_t is forgotten with its step; beside it all
/// stay, for what was learnt of s depends on them.
class NuisanceFilter {
 public:
  /// Whether there is any.
  [[nodiscard]] static bool is_in(const NoiseModel& noise) {
    return SharedError::is_in(noise) || noise.scale_std() > 0 || lasting_count(noise) > 0 ||
           noise.has_step_errors();
  }
  NuisanceFilter(std::shared_ptr<const model::ObservedModel> model, const NoiseModel& noise);

  /// Whether the form of a datum depends on the data before it.
  [[nodiscard]] bool links_steps() const {
    return shared_ != nullptr || scale_std_ > 0 || lasting_count_ > 0;
  }
  void restart();
  void set_noise(const NoiseModel& noise);  ///< the same, with further steps

  /// z, given the data so far.
  [[nodiscard]] ConditionalStates lasting_errors() const {
    return states_.states(scale_std_ > 0 ? 1 : 0, lasting_count_);
  }
  /// The form of the next datum given those before it; takes the datum, if the form is finite. `residual`
  /// and `predicted` (y_t at the centre, where there is ε): of the dofs that `group` keeps; `lasting` (B_t of
  /// z) and `step_error` (F_t): of all dofs, or null. `moved` (may be null; without ε and z, and without φ
  /// beside s): the form in (v, u, z) too.
  [[nodiscard]] StepForm condition(const NoiseGroup& group, const Eigen::MatrixXd& core,
                                   const Eigen::VectorXd& residual, const Eigen::VectorXd& predicted,
                                   const Eigen::MatrixXd* lasting, const Eigen::MatrixXd* step_error,
                                   MovedForm* moved);

 private:
  double scale_std_;
  Eigen::Index lasting_count_;           ///< of z
  Eigen::Index first_scalar_;            ///< observations from here on are no displacements
  std::unique_ptr<SharedError> shared_;  ///< null: no s
  ConditionalFilter states_;             ///< x
  Eigen::Index kept_ = 0;                ///< states that data to come may depend on
};

}  // namespace knothe::likelihood
