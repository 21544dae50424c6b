#pragma once
/// @file The results folder of an assimilation: steps.jsonl, summary.json, posterior.nc, fields/ for
/// ParaView.
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "knothe/assimilation/engine/input_errors.hpp"
#include "knothe/assimilation/engine/step_result.hpp"
#include "knothe/likelihood/data/measurements.hpp"
#include "knothe/model/reduced/separated_model.hpp"
#include "knothe/project/project_file.hpp"
#include "knothe/project/refinement.hpp"
#include "knothe/record/posterior_file.hpp"

namespace knothe::record {

/// Processor, cores, system and compiler, for files that hold times.
[[nodiscard]] nlohmann::ordered_json machine_record();

/// Collects the steps of an assimilation in memory and writes the folder at the end (or when interrupted),
/// every file atomically.
class ResultsWriter {
 public:
  /// `priors` are those truncated to the model's box, in the project file's order, as is the model.
  /// `observed`: the model at the times of the data where these are not its own; its first rows are the
  /// displacements.
  ResultsWriter(const project::Project& project, const model::SeparatedModel& model,
                const likelihood::Measurements& measurements, std::vector<posterior::Prior> priors,
                std::shared_ptr<const model::ObservedModel> observed = nullptr);

  /// Keeps what the files need of a step. `datum`: its last, with the noise that it was measured with;
  /// `published`: the crack lengths by Eq. 33, beside the forecasts.
  void add_step(const assimilation::StepResult& result,
                const std::vector<assimilation::NamedForecast>& published, const likelihood::Datum& datum);

  /// The model has been refined: from now on fields and residuals, those of the steps before too, are of this
  /// one.
  void use(const project::Refinement& refinement);

  /// What errors of the inputs would do to the posterior after the last step.
  void set_input_shifts(std::vector<assimilation::InputShift> shifts) { input_shifts_ = std::move(shifts); }

  /// Writes everything. Errors: IoError.
  void write(const std::string& folder, double elapsed_s) const;
  /// Of the steps so far.
  [[nodiscard]] assimilation::Verdict verdict() const { return run_.verdict(); }

 private:
  void write_steps(const std::string& path) const;
  void write_summary(const std::string& path, double elapsed_s) const;
  void write_posterior(const std::string& path) const;
  void write_fields(const std::string& folder) const;
  [[nodiscard]] nlohmann::ordered_json parameter_summaries() const;
  [[nodiscard]] nlohmann::ordered_json load_displacement() const;
  [[nodiscard]] Eigen::VectorXd expected_at(const KeptStep& step) const;
  [[nodiscard]] Eigen::VectorXd error_beside(const assimilation::StepResult& result,
                                             const likelihood::Datum& datum) const;
  [[nodiscard]] nlohmann::ordered_json residuals() const;
  void add_series(nlohmann::ordered_json& record, const KeptStep& step,
                  const Eigen::VectorXd& expected) const;
  [[nodiscard]] nlohmann::ordered_json last_draws() const;

  project::Project project_;
  model::SeparatedModel model_;
  likelihood::Measurements measurements_;
  std::vector<posterior::Prior> priors_;
  std::shared_ptr<const model::ObservedModel> observed_;
  std::vector<KeptStep> steps_;
  assimilation::RunVerdict run_;
  std::vector<std::string> lines_;
  std::vector<assimilation::ScoredForecast> scores_;
  nlohmann::ordered_json refinement_;
  std::vector<assimilation::InputShift> input_shifts_;
};

}  // namespace knothe::record
