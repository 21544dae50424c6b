#pragma once
/// @file What an assimilation left in its results folder: steps.jsonl and summary.json
/// (docs/reference/formats.md).
#include <cstddef>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "knothe/assimilation/decide/decision.hpp"
#include "knothe/assimilation/engine/input_errors.hpp"
#include "knothe/assimilation/update/update_result.hpp"

namespace knothe::record {

/// A density of one number on increasing points.
struct DensityCurve {
  std::vector<double> points;
  std::vector<double> values;
  [[nodiscard]] bool empty() const { return points.empty(); }
};

/// One forecast at one step, in the unit of the quantity.
struct StepForecast {
  double mean = 0.0;
  double std = 0.0;
  double maximum_a_posteriori = 0.0;
  double probability_above_threshold = 0.0;
  std::string units;  ///< empty if not said
  std::optional<double>
      bridge_residual_rms;  ///< m; how far the elastic crack is from the predicted field, dof by dof
  std::vector<double> levels;
  std::vector<double> values;
  std::vector<double> published;  ///< quantiles by Eq. 33 (crack length only); may be empty
  bool published_agrees = true;   ///< they say what the forecast says
  bool is_past = false;           ///< the horizon was before the step's time
  DensityCurve density;           ///< empty if not written
};

/// One of several models run side by side, after a step.
struct StepModel {
  double probability = 0.0, log_evidence = 0.0, log_bayes_factor = 0.0;
};

/// A scalar series and what the posterior that has it predicts in the mean, in `units`.
struct SeriesFit {
  std::string units;
  double std = 0.0;          ///< of its noise
  std::vector<double> step;  ///< where it was measured
  std::vector<double> measured, predicted;
};

/// Data less the mean prediction of the posterior that has them, m.
struct Residuals {
  std::map<std::string, SeriesFit> series;  ///< by name; the rest is about displacements, empty without
  std::vector<std::size_t> step;
  std::vector<double> step_rms;    ///< over all sensors, per step
  std::vector<double> noise_rms;   ///< of the noise of the same values, per step; empty in files before 0.2
  std::vector<char> component;     ///< 'x', 'y', 'z', per sensor
  std::vector<double> x, y, mean;  ///< per sensor: place, and mean over the last `averaged` steps
  std::size_t averaged = 0;
  std::vector<double> measured, predicted;  ///< m, of the last step where measured; empty before 0.2
};

/// One assimilated step as its line says it, without points; parameters in the order of the project file.
struct Step : assimilation::UpdateResult {
  std::vector<double> levels;               ///< of the quantiles
  std::map<std::string, StepModel> models;  ///< by file; empty without candidates
  std::vector<assimilation::EstimatedError> lasting_errors;
  std::optional<assimilation::Decision> decision;  ///< of projects that ask
  double update_us = 0.0, forecast_us = 0.0, total_us = 0.0;
  std::map<std::string, DensityCurve> marginals;  ///< by parameter; may be empty
  std::map<std::string, StepForecast> forecast;   ///< by the forecast's name
};

struct ParameterSummary {
  std::string name;
  std::string prior;  ///< in words: "normal(0.9, 0.447)"; empty if unknown
  std::optional<double> lower, upper;
  std::optional<double> reference;  ///< physical value of 1.0
  std::string units;                ///< of the physical value; "1" or empty: none
  std::optional<double> truth;      ///< of synthetic data
};

/// What a forecast is about, if summary.json says so under "forecasts".
struct ForecastSummary {
  std::string quantity;             ///< "crack_length", "displacement", "output"
  std::optional<double> horizon;    ///< model time
  std::optional<double> threshold;  ///< in the unit of the quantity
  std::string unit;                 ///< of the numbers in the file; empty if unknown
};

/// The full-order model was asked, and the model refined.
struct RefinementSummary {
  double full_order_runs = 0, version = 0;
  double moved_std = 0;  ///< how far that moved the posterior at the last step it was asked at
};

struct Results {
  std::string folder;
  bool summary_found = false;
  std::string created_by, project, project_file, model, data;
  std::string model_path;   ///< of the model, where it lies now if it moved together with the results
  std::string computed_at;  ///< of the last step: UTC, ISO 8601; empty in files before 0.2
  std::string seed;
  std::vector<ParameterSummary> parameters;
  std::map<std::string, DensityCurve> prior_marginals;
  std::map<std::string, ForecastSummary> forecasts;  ///< by name; may be empty
  std::string time_units;            ///< of the model's time; empty where the solver states none
  std::vector<double> curve_time;    ///< model times of the load–displacement curve; may be empty
  std::vector<double> displacement;  ///< m, of the load–displacement curve; may be empty
  std::vector<double> force;         ///< N
  std::optional<double> elapsed_s;
  std::vector<std::pair<std::string, std::string>> machine;
  Residuals residuals;                     ///< may be empty
  std::vector<std::vector<double>> draws;  ///< of the last posterior, by parameter; empty before 0.2
  assimilation::Verdict verdict;  ///< of the run; `judged` false: written by a version that made none
  bool judged = false;
  std::optional<RefinementSummary> refinement;
  std::vector<assimilation::InputShift> input_shifts;  ///< may be empty
  bool monitored = false;                              ///< every step has the monitor's record
  std::vector<Step> steps;                             ///< at least one

  [[nodiscard]] std::vector<double> step_numbers() const;
  [[nodiscard]] std::vector<std::size_t> untrusted() const;
  /// Whether the posterior of a step was by a transport map.
  [[nodiscard]] bool has_maps() const;
  /// Names of all forecasts that the last step has.
  [[nodiscard]] std::vector<std::string> forecast_names() const;
};

/// A verdict from what `verdict_record` made of it. `where` names the file in messages. Errors: DataError.
[[nodiscard]] assimilation::Verdict read_verdict(const nlohmann::json& record, const std::string& where);

/// Reads FOLDER/steps.jsonl and, if it is there, FOLDER/summary.json. Errors: DataError with file and line
/// for a missing folder or file, a line that is not JSON, lacks a key or has a value of the wrong kind or
/// shape.
[[nodiscard]] Results read_results(const std::string& folder);

}  // namespace knothe::record
