#pragma once
/// @file A project file: what to compute, from what, and how.
#include <array>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "knothe/assimilation/update/prior.hpp"
#include "knothe/base/error.hpp"
#include "knothe/forecast/forecaster.hpp"
#include "knothe/project/picture_options.hpp"
#include "knothe/project/serve_options.hpp"
#include "knothe/reduction/observe/scalar_observations.hpp"

namespace knothe::project {

struct NamedPrior {
  std::string name;
  assimilation::Prior prior;
};

/// A parameter of the model that is not inferred: a series of the data has its value at each time.
struct KnownParameter {
  std::string name;
  std::optional<double> value;  ///< for forecasts and fields; else the last one measured
};

struct MethodOptions {
  std::string kind = "transport";
  std::string form = "collapsed";
  double tolerance = 1e-3;
  int max_order = 8;
  std::string minimiser = "newton";
  std::string mode_search = "tempered";  ///< of `knothe infer`
  std::string likelihood = "gaussian";
  double degrees_of_freedom = 4;
  double gate = 0;
  bool unknown_noise_level = false;
  double noise_level_shape = 2, noise_level_scale = 1;
  double offset_std = 0;          ///< m
  bool truncation_error = false;  ///< the model's own error is added to the noise
  int samples = 10000;
  int verification_points = 1024;
  std::uint64_t seed = 1;
  double forgetting = 1;
  std::vector<std::size_t> change_points;
  double change_retention = 0;
  bool restart_on_alarm = false;
  std::string bias_correction = "off";
  int bias_rank = 2;
  std::string bias_extrapolation = "joint";
  double bias_memory = 20;
  int bias_order = 1;
  int bias_window = 2;
};

/// A model behind a UM-Bridge server ([model] umbridge).
struct UmbridgeOptions {
  std::string url;   ///< empty: the model is a separated one
  std::string name;  ///< empty: the only one the server has
  std::string config = "{}";
  double timeout = 30;  ///< s
  int connections = 1;
  bool density = false;  ///< it returns the complete log posterior density
  std::string derivatives = "all";
  double difference_step = 1e-4;  ///< in units of the prior's scale
};

/// What `knothe infer` compares the model's outputs with.
struct ObservationOptions {
  std::vector<double> values;
  std::vector<double> std;                      ///< as many, or empty
  std::vector<std::vector<double>> covariance;  ///< rows; or empty
  std::vector<std::size_t> dofs, steps;         ///< of a separated model
  std::string output;                           ///< of a separated model
};

/// Axis of the parameter grid of the offline phase.
struct OfflineParameter {
  std::string name;
  double reference = 1;  ///< physical value of 1.0
  double lower = 0.5;
  double upper = 1.5;
  int nodes = 7;
};

struct OfflineOptions {
  std::string method = "snapshots";
  double latin_accuracy = 0;  ///< m; 0: 1e-7, fully separated 1e-6
  int latin_window = 2;       ///< steps
  std::string latin_start;    ///< model file; empty: the elastic solution
  bool latin_full = false;    ///< fully separated form
  int latin_terms = 100;      ///< of it, at most
  double element = 0.005;     ///< m
  int layers = 1;
  std::string gmsh;  ///< absolute path, empty: structured mesh
  std::string regularisation = "none";
  double reference_size = 0.005;  ///< m
  double internal_length = 0.01;  ///< m
  int steps = 100;
  double displacement = 4e-4;  ///< m
  double young_modulus = 30e9;
  double poisson_ratio = 0.23;
  std::string left_support = "line";
  int processes = 2;
  std::string form = "tree";
  int modes = 30;
  int sparse_level = -1;           ///< −1: the whole tensor grid
  double adaptive_error = 0;       ///< m; 0: `modes` as given
  double adaptive_shift = 0;       ///< posterior std; 0: `modes` as given
  double adaptive_grid_error = 0;  ///< m; 0: `nodes` as given
  int adaptive_runs = 400;
  int crack_lengths = 80;
  std::vector<OfflineParameter> parameters;
};

/// The camera of `knothe simulate --images`.
struct CameraSimulation {
  int width = 0, height = 0;  ///< px
  int bit_depth = 8;
  double noise = 2;       ///< standard deviation, grey levels of an 8-bit picture
  double dot_radius = 2;  ///< of the speckle, px
  double gain = 1;        ///< of the deformed pictures: the light changes
  int references = 1;     ///< pictures of the unloaded surface
  int every = 1;          ///< model times per picture
  int supersampling = 1;  ///< n × n points a pixel
};

struct SimulateOptions {
  std::map<std::string, double> truth;
  int random_nodes = 0;
  std::string face = "z";
  std::optional<std::array<double, 2>> x_range, y_range;  ///< m
  std::vector<int> components = {0, 1};
  double noise_std = 1e-6;  ///< m
  std::uint64_t seed = 1;
  std::optional<CameraSimulation> camera;
};

/// What `knothe select` chooses among, and how.
struct SelectOptions {
  std::string criterion = "d-optimal";
  int count = 30;
  double min_distance = 0;           ///< m
  std::string candidates;            ///< "data", "model"; empty: data where the project has them
  std::map<std::string, double> at;  ///< parameters at which the model is linearised; else the box's middle
  std::optional<std::size_t> step;   ///< of the paper's criteria; else the middle one
  std::optional<double> noise_std;   ///< of candidates of the model, m
};

struct Project {
  std::string path;                     ///< as given
  std::string folder;                   ///< paths are relative to it
  std::string text;                     ///< the file's text, written into every result
  std::string model;                    ///< separated model file, resolved; empty if none
  std::vector<std::string> candidates;  ///< further models to compare it with, resolved
  std::string data;                     ///< measurements, resolved; empty if none
  std::string clock;                    ///< output that tells the time of the data; empty: their own times
  std::vector<reduction::ScalarObservation> sensors;  ///< made of displacements
  std::string results;                                ///< resolved
  std::vector<NamedPrior> parameters;                 ///< those that are inferred
  std::vector<KnownParameter> known;                  ///< and those that are not
  MethodOptions method;
  UmbridgeOptions umbridge;
  std::optional<ObservationOptions> observations;
  std::optional<OfflineOptions> offline;
  std::optional<SimulateOptions> simulate;
  PictureOptions pictures;  ///< [dic] and [data] pictures
  SelectOptions select;
  std::vector<forecast::ForecastSpecification> forecasts;
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
