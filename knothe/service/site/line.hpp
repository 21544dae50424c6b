#pragma once
/// @file A step's posterior as the service publishes it.
#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "knothe/assimilation/engine/step_result.hpp"
#include "knothe/service/journal/served_model.hpp"
#include "knothe/service/site/log.hpp"

namespace knothe::service {

/// A step's posterior as it is published. Immutable.
struct Line {
  std::int64_t event = 0;  ///< id, increasing for ever
  std::size_t step = 0;
  double time = 0;
  bool withdrawn = false;                         ///< no line: its step no longer has a datum
  std::string json;                               ///< the line of a step (docs/reference/formats.md)
  Eigen::VectorXd mean, std;                      ///< d
  Eigen::MatrixXd samples;                        ///< at most 400 × d, equally weighted
  std::vector<bool> missing;                      ///< per sensor, of the last datum of the step
  Eigen::VectorXd residual;                       ///< measured − predicted at the mean; 0 where missing
  std::map<std::string, double> above_threshold;  ///< P(q > threshold) by forecast
  bool trusted = true;
  std::string remark;
  assimilation::VerdictLevel verdict = assimilation::VerdictLevel::ok;
  std::string verdict_message;  ///< the first reason of that level; empty for `ok`
  assimilation::Misfit misfit;  ///< of the step's data, given those before
  std::string misfit_message;   ///< the verdict's: the data do not fit the model; empty where they do
  bool monitor_alarm = false, bias_corrected = false;
  std::vector<Eigen::Index> stuck, absent;  ///< sensors that have stopped
  std::string notice;                       ///< what the monitor found or did at this step
  /// The correction of the bias, where it is on.
  assimilation::EstimatedBias bias;
  bool model_doubted = false;                ///< the verdict doubts the reduced model
  std::shared_ptr<const ServedModel> model;  ///< that it was made with

  /// Whether the verdict says that the data do not fit the model, and nothing corrects for it.
  [[nodiscard]] bool is_biased() const { return !bias_corrected && !misfit_message.empty(); }
};

/// Whether the data have told the line's parameters from their priors: before, a forecast is the priors'.
[[nodiscard]] bool is_informed(const Line& line, const std::vector<posterior::Prior>& priors);

/// As /v1/status and the page show it.
[[nodiscard]] Json misfit_record(const assimilation::Misfit& misfit);

/// The line of a result, without event and JSON; `values` are those of the step's last datum (NaN: missing).
[[nodiscard]] std::shared_ptr<Line> make_line(const assimilation::StepResult& step,
                                              std::shared_ptr<const ServedModel> model,
                                              const Eigen::VectorXd& values);

}  // namespace knothe::service
