#pragma once
/// @file The noise of a series of data: that of each, the same at every step or not, and what steps share.
#include <Eigen/Core>
#include <cstddef>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "knothe/likelihood/noise/gaussian_noise.hpp"

namespace knothe::likelihood {

/// An error that all steps have together, N(0, std²) in a unit of its own.
struct LastingError {
  std::string name;
  double std = 1;
};
struct LastingErrors {
  std::vector<LastingError> errors;      ///< q, each std times one standard normal number z
  std::vector<Eigen::MatrixXd> factors;  ///< B_t of z, n × q, for each step; empty: none

  /// Null where there are none.
  [[nodiscard]] const Eigen::MatrixXd* factor(std::size_t step) const {
    return factors.empty() ? nullptr : &factors.at(step);
  }
};

/// All that a measured value may be off by: the noise of the measurement, N(0, R), with the steps that have
/// another one, and errors beside it, of each step or common to all. Immutable; copies share what is large.
/// The parts have their own names, so that no caller takes one for the whole: `measurement` is R alone,
/// `StepNoise` is all that a step does not share with others.
class NoiseModel {
 public:
  NoiseModel() = default;
  NoiseModel(GaussianNoise noise) : measurement_(std::move(noise)) {}  ///< the same at each step, no more
  [[nodiscard]] static NoiseModel independent(const Eigen::VectorXd& std) {
    return GaussianNoise::independent(std);
  }
  [[nodiscard]] static NoiseModel correlated(const Eigen::SparseMatrix<double>& precision) {
    return GaussianNoise::correlated(precision);
  }

  /// The same noise with another one at step `step` (a picture with elements removed), of as many dofs.
  [[nodiscard]] NoiseModel with_step(std::size_t step, GaussianNoise noise) const;
  /// The same noise at each step, but with a part common to all steps: the noise of `pictures` ≥ 1 averaged
  /// reference pictures, e_t = own_t + shared, Cov(shared) = Cov(own_t) / pictures. R stays the covariance
  /// of one step, own and shared part together.
  [[nodiscard]] NoiseModel with_shared_reference(int pictures) const;

  /// The same noise with a constant error of each sensor besides, N(0, std²), std > 0 (m): an offset that is
  /// not known. It is not part of R.
  [[nodiscard]] NoiseModel with_offsets(double std) const;

  /// The same noise with further observations behind the others, independent of them and of each other:
  /// load cells and gauges, `std` in their units. They have no part in offsets, the reference picture or the
  /// scale.
  [[nodiscard]] NoiseModel with_scalars(const Eigen::VectorXd& std) const;
  /// The same noise with an error of step `step` besides that all its dofs have together, N(0, F Fᵀ),
  /// `factor` n × q: what the clock is off by. It is not part of R.
  [[nodiscard]] NoiseModel with_step_error(std::size_t step, Eigen::MatrixXd factor) const;

  /// The same noise with a factor 1 + ε on the values of all steps besides, ε ~ N(0, relative_std²): metres
  /// per pixel that are not known exactly. It is not part of R. It is linearised about the prediction at
  /// the centre of the parameters, so that ε (y − y₀) must be small against the noise. Further observations
  /// (`with_scalars`) have no part in it.
  [[nodiscard]] NoiseModel with_scale_error(double relative_std) const;

  /// The same noise with errors besides that all steps have together, d_t = … + B_t z with z ~ N(0, I), the
  /// same z at each step: the scatter of specimens about the curve that was measured, the offset of a clock.
  /// They are not part of R.
  [[nodiscard]] NoiseModel with_lasting_errors(LastingErrors lasting) const;

  /// Marginal noise of a step on the dofs `kept` (`GaussianNoise::restricted`), with the shared reference
  /// and the scale's error.
  [[nodiscard]] NoiseModel restricted(const std::vector<Eigen::Index>& kept) const;

  [[nodiscard]] Eigen::Index size() const { return measurement_.size(); }  ///< observations
  /// R: of a datum that has none of its own.
  [[nodiscard]] const GaussianNoise& measurement() const { return measurement_; }
  [[nodiscard]] int shared_reference() const { return shared_reference_; }   ///< 0: nothing is shared
  [[nodiscard]] double offset_std() const { return offset_std_; }            ///< 0: no offsets
  [[nodiscard]] double scale_std() const { return scale_std_; }              ///< 0: the scale is exact
  [[nodiscard]] Eigen::Index scalar_count() const { return scalar_count_; }  ///< of `with_scalars`, the last
  [[nodiscard]] const LastingErrors& lasting() const { return *lasting_; }
  [[nodiscard]] bool has_step_errors() const { return !step_errors_.empty(); }
  /// F of step `step`; null where there is none.
  [[nodiscard]] const Eigen::MatrixXd* step_error(std::size_t step) const;
  /// R of step `step`: `measurement` where no other was given.
  [[nodiscard]] const GaussianNoise& at_step(std::size_t step) const;

 private:
  GaussianNoise measurement_;
  int shared_reference_ = 0;
  double offset_std_ = 0, scale_std_ = 0;
  Eigen::Index scalar_count_ = 0;
  std::shared_ptr<const LastingErrors> lasting_ = std::make_shared<const LastingErrors>();
  std::map<std::size_t, std::shared_ptr<const Eigen::MatrixXd>> step_errors_;
  std::map<std::size_t, std::shared_ptr<const GaussianNoise>> steps_;
};

/// Whether that step has another noise than the measurement's.
[[nodiscard]] inline bool has_own_noise(const NoiseModel& noise, std::size_t step) {
  return &noise.at_step(step) != &noise.measurement();
}

/// q of `with_lasting_errors`.
[[nodiscard]] inline Eigen::Index lasting_count(const NoiseModel& noise) {
  return std::ssize(noise.lasting().errors);
}

/// Steps share an error: what one says depends on those before it.
[[nodiscard]] inline bool links_steps(const NoiseModel& noise) {
  return noise.shared_reference() > 0 || noise.offset_std() > 0 || noise.scale_std() > 0 ||
         lasting_count(noise) > 0;
}

}  // namespace knothe::likelihood
