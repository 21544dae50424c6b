#pragma once
/// @file The tables [simulate] and [select] of a project file.
#include <cstdint>
#include <map>
#include <optional>
#include <string>

#include "knothe/assimilation/select/selection_study.hpp"
#include "knothe/likelihood/data/synthetic_measurements.hpp"

namespace knothe::project {

struct Values;

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
  likelihood::DofSelection dofs{.nodes = 0, .x_range = {}, .y_range = {}};  ///< 0: pictures alone
  double noise_std = 1e-6;                                                  ///< m
  std::map<std::string, double> noise;  ///< of quantities without a place, which are measured by that
  std::uint64_t seed = 1;
  std::optional<CameraSimulation> camera;
};

/// What `knothe select` chooses among, and how.
struct SelectOptions {
  using Criterion = assimilation::SelectionProblem::Criterion;
  Criterion criterion = Criterion::d_optimal;
  std::size_t count = 30;
  double min_distance = 0;           ///< m
  std::optional<bool> from_model;    ///< else from the data where the project has them
  std::map<std::string, double> at;  ///< parameters at which the model is linearised; else the box's middle
  std::optional<std::size_t> step;   ///< of the paper's criteria; else the middle one
  std::optional<double> noise_std;   ///< of candidates of the model, m
};

/// The table [simulate] with its camera; complains of what is out of range.
[[nodiscard]] SimulateOptions read_simulate(Values& values);
/// The table [select].
[[nodiscard]] SelectOptions read_select(Values& values);

}  // namespace knothe::project
