#pragma once
/// @file Which values can be measurements of a structure at all.
#include <Eigen/Core>
#include <string>

#include "knothe/model/observe/observed_model.hpp"
#include "knothe/model/observe/sensors.hpp"

namespace knothe::likelihood {

/// A limit of |value| for each kind of sensor: displacements along x, y and z, and each scalar series. What
/// is beyond is no measurement (a loose plug, a wrong unit), however large the noise is said to be.
class PlausibleRange {
 public:
  /// Of each kind 100 × the largest answer of the model in its box of parameters, at any of its times; or 100
  /// × the largest standard deviation of the noise (n), if that is more: what the model does not move is all
  /// noise. No limit where the box has no end.
  PlausibleRange(const model::ObservedModel& model, const model::Sensors& sensors,
                 const Eigen::VectorXd& noise_std);
  /// All limits times `factor`.
  void widen(double factor) { limits_ *= factor; }
  /// In place of the model's; of all components.
  void limit_displacements(double limit);
  /// Of scalar series `k`.
  void limit_scalar(std::size_t k, double limit);
  [[nodiscard]] double limit(Eigen::Index i) const { return limits_[i]; }

  /// The first sensor whose value is beyond its limit, that value and the limit, in words, and how many there
  /// are besides; empty if there is none. NaN is missing.
  [[nodiscard]] std::string complaint(const Eigen::Ref<const Eigen::VectorXd>& values) const;

 private:
  [[nodiscard]] std::string words_for(Eigen::Index i, double value) const;

  model::Sensors sensors_;
  Eigen::VectorXd limits_;  ///< n
};

}  // namespace knothe::likelihood
