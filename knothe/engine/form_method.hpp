#pragma once
/// @file The posterior of a set of data by their quadratic forms (docs/assimilation.md).
///
/// The form of a step is the sum of its data's in the order of their keys; the posterior after a step is that
/// of the sum of the steps' up to it, in order.
#include <map>
#include <set>

#include "knothe/engine/method.hpp"

namespace knothe::engine {

class FormMethod : public Method {
 public:
  explicit FormMethod(const MethodSetup& setup);

  void add(const assimilation::Datum& datum) override;
  void withdraw(std::size_t step, const assimilation::DatumKey& key) override;
  const assimilation::UpdateResult& conclude(std::size_t step) override;
  const assimilation::UpdateResult& preview(std::size_t step) override;
  [[nodiscard]] const assimilation::WeightedPosterior& posterior() const override {
    return update_.posterior();
  }
  [[nodiscard]] std::optional<assimilation::StepForm> form_up_to(std::size_t step) const override;
  [[nodiscard]] const assimilation::SequentialUpdate* update() const override { return &update_; }

 private:
  /// What is kept of a datum; G only where it is its own: complete data of a step with the sensors' noise
  /// share theirs.
  struct Contribution {
    assimilation::StepForm form;  ///< without G where that is shared
    Eigen::VectorXd values;       ///< kept where forms depend on the data before, or for a correction
    std::optional<assimilation::NoiseModel> noise;  ///< kept with the values
  };
  struct Step {
    std::size_t time_index = 0;
    std::map<assimilation::DatumKey, Contribution> data;
    Eigen::MatrixXd complete_quadratic;  ///< G of a datum without missing values; empty if there was none
    assimilation::StepForm sum;          ///< without G: to be made anew
    bool own_noise = false;              ///< the projector has another noise at this step than the sensors'
    /// Of the step's one datum, until it is put, where a correction wants it (steps that share an error).
    std::optional<assimilation::MovedForm> moved;
  };
  [[nodiscard]] assimilation::StepForm sum_of(const Step& step) const;
  [[nodiscard]] assimilation::StepForm project(std::size_t index, Step& step, const Eigen::VectorXd& values,
                                               const std::optional<assimilation::NoiseModel>& noise);
  void keep(Step& step, const assimilation::DatumKey& key, const assimilation::StepForm& form,
            const Eigen::VectorXd& values, const std::optional<assimilation::NoiseModel>& noise);
  void project_again();
  void put_changes();

  assimilation::NoiseModel noise_;
  assimilation::SequentialUpdate update_;
  assimilation::DatumProjector projector_;
  bool corrects_;
  std::map<std::size_t, Step> steps_;
  std::set<std::size_t> changed_;
  bool out_of_order_ = false;  ///< forms depend on data before them that were added later, or withdrawn
};

}  // namespace knothe::engine
