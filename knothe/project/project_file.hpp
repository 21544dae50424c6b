#pragma once
/// @file A project file: what to compute, from what, and how.
#include <array>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "knothe/assimilation/decide/decision.hpp"
#include "knothe/assimilation/forecast/forecast_specification.hpp"
#include "knothe/base/error.hpp"
#include "knothe/model/observe/scalar_observations.hpp"
#include "knothe/posterior/prior/prior.hpp"
#include "knothe/project/field_options.hpp"
#include "knothe/project/inference_options.hpp"
#include "knothe/project/method_options.hpp"
#include "knothe/project/offline_options.hpp"
#include "knothe/project/picture_options.hpp"
#include "knothe/project/serve_options.hpp"
#include "knothe/project/simulation_options.hpp"

namespace knothe::project {

struct NamedPrior {
  std::string name;
  posterior::Prior prior;
  std::string posterior;   ///< results whose posterior it is, resolved (`priors_of`); empty: `prior` says all
  std::string name_there;  ///< of the parameter in these results; empty: the same
};

/// A parameter of the model that is not inferred: a series of the data has its value at each time.
struct KnownParameter {
  std::string name;
  std::optional<double> value;  ///< for forecasts and fields; else the last one measured
};

/// A file recorded beside the pictures, the fields or the first data file, by a clock of its own.
struct DataSource {
  std::string name;  ///< empty: `data.file` beside pictures or fields
  std::string file;  ///< resolved
  double time_offset_std = 0, time_drift_std = 0;
};

struct Project {
  std::string path;                     ///< as given
  std::string folder;                   ///< paths are relative to it
  std::string text;                     ///< the file's text, written into every result
  std::string model;                    ///< separated model file, resolved; empty if none
  std::vector<std::string> candidates;  ///< further models to compare it with, resolved
  std::string data;                     ///< measurements (or the fields), resolved; empty if none
  std::string clock;                    ///< output that tells the time of the data; empty: their own times
  std::map<std::string, double> series_std;       ///< of series of all files, in their units
  std::vector<DataSource> sources;                ///< what was recorded beside these
  std::vector<model::ScalarObservation> sensors;  ///< made of displacements
  std::string results = "results/";               ///< resolved
  std::vector<NamedPrior> parameters;             ///< those that are inferred
  std::vector<KnownParameter> known;              ///< and those that are not
  std::map<std::string, double> tolerances;       ///< of the inputs by name, relative
  MethodOptions method;
  UmbridgeOptions umbridge;
  std::optional<ObservationOptions> observations;
  std::optional<OfflineOptions> offline;
  std::optional<SimulateOptions> simulate;
  PictureOptions pictures;  ///< [dic] and [data] pictures
  FieldOptions fields;      ///< [data.fields]
  SelectOptions select;
  std::vector<assimilation::ForecastSpecification> forecasts;
  std::optional<assimilation::DecisionOptions> decide;
  ServeOptions serve;

  /// Line and column of every table and key of the file, by its path ("parameters.Y0").
  std::map<std::string, std::array<int, 2>> positions;

  /// `file:line:column: error: text`, at the table or key of that path or its nearest parent that is there.
  [[nodiscard]] ProjectError error_at(std::string key, const std::string& text) const;
  /// Throws a ProjectError that names the file and the missing table unless `present`.
  void require(bool present, const std::string& what) const;
};

/// Reads and validates a file completely. All its errors at once, each as `file:line:column: error: …`, in
/// one ProjectError. Does not look whether the files it names exist.
[[nodiscard]] Project read_project(const std::string& path);

/// The same for a text; `path` is for messages and relative paths.
[[nodiscard]] Project parse_project(const std::string& text, const std::string& path);

}  // namespace knothe::project
