#pragma once
/// @file Sequential assimilation of data that may hold values which belong to no noise: gating, or a
/// Student-t likelihood; innovations and test ratios of every sensor.
#include <memory>
#include <optional>
#include <vector>

#include "knothe/assimilation/update/sequential_update.hpp"
#include "knothe/assimilation/update/student_update.hpp"
#include "knothe/likelihood/data/sensor_watch.hpp"
#include "knothe/likelihood/step/robust_options.hpp"

namespace knothe::assimilation {

/// What a datum says about the sensors, all n.
struct SensorReport {
  Eigen::VectorXd innovation;  ///< value − mean of the prediction from the data before, m; NaN where missing
  Eigen::VectorXd test_ratio;  ///< |innovation| / √(noise + prediction variance); NaN where missing
  Eigen::VectorXd weight;      ///< expected precision factor of a Student-t value; 1 for Gaussian, 0 rejected
  std::vector<Eigen::Index> rejected, stuck, absent;
};

/// Every value is judged by what the data before predict. Gating: those too far off are rejected, and the
/// rest is Gaussian (`SequentialUpdate`). Student-t: `StudentUpdate`. Stuck sensors are rejected.
class RobustUpdate {
 public:
  /// As SequentialUpdate's. Errors: UsageError for a Student-t likelihood with noise that is correlated in
  /// space or shared in time.
  RobustUpdate(std::shared_ptr<const model::ObservedModel> model, likelihood::NoiseModel noise,
               std::vector<posterior::Prior> priors, UpdateOptions options, likelihood::RobustOptions robust);

  /// Takes a datum, measured at model time index `time_index`, and gives the posterior of all data so far.
  /// UsageError for one that comes, by step and key, before the last, and for a Student-t likelihood of
  /// correlated noise.
  const UpdateResult& update(const likelihood::Datum& datum, std::size_t time_index);
  /// The only datum of a step.
  const UpdateResult& update(std::size_t step, std::size_t time_index,
                             const Eigen::Ref<const Eigen::VectorXd>& values) {
    return update({{}, step, time_index, values, std::nullopt}, time_index);
  }
  [[nodiscard]] const UpdateResult& result() const { return result_; }
  [[nodiscard]] const SensorReport& sensors() const { return sensors_; }
  [[nodiscard]] const posterior::Posterior& posterior() const { return result_; }
  /// Changes of the structure, known or found so far.
  [[nodiscard]] const StructureChanges& changes() const {
    return student_ ? student_->changes() : gaussian_->changes();
  }
  /// The update of what was accepted; null for a Student-t likelihood.
  [[nodiscard]] const SequentialUpdate* gaussian() const { return gaussian_ ? &*gaussian_ : nullptr; }
  /// The form of the last datum given those before; null before the first.
  [[nodiscard]] const likelihood::StepForm* latest_form() const {
    if (!last_) return nullptr;
    return student_ ? &student_->latest_form() : gaussian_->form_of(last_->first);
  }

 private:
  struct Prediction {
    Eigen::VectorXd mean, variance;  ///< n, without the noise of the measurement
  };
  [[nodiscard]] Prediction predict(std::size_t step, std::size_t time_index) const;
  void check_sensors(const Prediction& before, const Eigen::Ref<const Eigen::VectorXd>& values);
  void assimilate(const likelihood::Datum& datum, std::size_t time_index);

  std::shared_ptr<const model::ObservedModel> model_;
  likelihood::NoiseModel noise_;
  likelihood::RobustOptions robust_;
  std::optional<SequentialUpdate> gaussian_;  ///< one of the two
  std::optional<StudentUpdate> student_;
  likelihood::SensorWatch watch_;
  Eigen::VectorXd noise_std_;   ///< of the step at hand
  posterior::Posterior prior_;  ///< draws of the prior: the posterior before the first datum
  std::optional<std::pair<std::size_t, likelihood::DatumKey>> last_;
  Eigen::Index rejected_ = 0;  ///< values of the data of the last step
  UpdateResult result_;
  SensorReport sensors_;
};

}  // namespace knothe::assimilation
