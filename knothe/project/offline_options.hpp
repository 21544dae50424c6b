#pragma once
/// @file The table [offline] of a project file: how the reduced model is made.
#include <array>
#include <optional>
#include <string>
#include <vector>

#include "knothe/base/enum_names.hpp"
#include "knothe/model/reduced/form_names.hpp"
#include "knothe/model/simulator/command_simulator.hpp"
#include "knothe/model/simulator/resampled_simulator.hpp"

namespace knothe::project {

struct Values;

enum class OfflineMethod { snapshots, latin };

constexpr auto names_of(OfflineMethod /*method*/) {
  return std::to_array<Named<OfflineMethod>>(
      {{OfflineMethod::snapshots, "snapshots"}, {OfflineMethod::latin, "latin"}});
}

/// How a crack's width is kept from being that
/// of an element.
enum class DamageRegularisation {
  none,        ///< the law as it is: the element size is a material parameter
  crack_band,  ///< inelastic strain scaled by reference size / element size: stress against opening is kept
  gradient     ///< damage by a strain averaged over an internal length (Helmholtz equation)
};

constexpr auto names_of(DamageRegularisation /*regularisation*/) {
  using R = DamageRegularisation;
  return std::to_array<Named<R>>(
      {{R::none, "none"}, {R::crack_band, "crack-band"}, {R::gradient, "gradient"}});
}

/// How the stress falls while a crack opens.
enum class SofteningLaw {
  brittle,      ///< Rubio et al. 2019, Eq. 29: like 1 / opening
  exponential,  ///< f_t exp(-f_t w / G_f), of a crack band
  bilinear,     ///< two straight lines (Petersson 1981), of a crack band
};

constexpr auto names_of(SofteningLaw /*law*/) {
  return std::to_array<Named<SofteningLaw>>({{SofteningLaw::brittle, "brittle"},
                                             {SofteningLaw::exponential, "exponential"},
                                             {SofteningLaw::bilinear, "bilinear"}});
}

/// What holds the beam in x.
enum class LeftSupport {
  support_line,  ///< u_x = 0 on the left support line: a simply supported beam (the default)
  left_face      ///< u_x = 0 on the whole left end face, as the paper has it; this clamps the rotation there
};

constexpr auto names_of(LeftSupport /*support*/) {
  return std::to_array<Named<LeftSupport>>(
      {{LeftSupport::support_line, "line"}, {LeftSupport::left_face, "face"}});
}

/// Axis of the parameter grid of the offline phase.
struct OfflineParameter {
  std::string name;
  double reference = 1;   ///< physical value of 1.0
  std::string units;      ///< of the reference; of the own solver's parameters alone
  std::string long_name;  ///< likewise
  double lower = 0.5;
  double upper = 1.5;
  int nodes = 7;
};

/// A model of a UM-Bridge server as full-order model: its outputs are the quantities at each time, [n_t,
/// n_dof].
struct UmbridgeSource {
  std::string url;            ///< "http://HOST:PORT"
  std::string name;           ///< of the model; empty: the only one the server has
  std::string config = "{}";  ///< JSON, sent with every request
  double timeout = 30;        ///< s, per request
  std::vector<double> times;
  std::string time_units;                 ///< of them; empty: not said
  std::vector<std::string> names, units;  ///< of the quantities; no unit: "1"
};

struct OfflineOptions {
  std::optional<model::CommandOptions> command;  ///< another program instead of the built-in beam
  std::optional<UmbridgeSource> umbridge;        ///< or a server
  [[nodiscard]] bool is_beam() const { return !command && !umbridge; }
  OfflineMethod method = OfflineMethod::snapshots;
  double latin_accuracy = 1e-7;  ///< m
  int latin_window = 2;          ///< steps
  std::string latin_start;       ///< model file; empty: the elastic solution
  double element = 0.005;        ///< m
  int layers = 1;
  std::string gmsh;  ///< resolved; empty: structured mesh
  SofteningLaw law = SofteningLaw::brittle;
  DamageRegularisation regularisation = DamageRegularisation::none;
  double reference_size = 0.005;  ///< m
  double internal_length = 0.01;  ///< m
  int steps = 100;
  double displacement = 4e-4;  ///< m
  double young_modulus = 30e9;
  double poisson_ratio = 0.23;
  LeftSupport left_support = LeftSupport::support_line;
  model::TimeAxis time;      ///< no output: the solver's own times
  bool scaling = false;      ///< the grid from runs at a few values of A_d Y₀, by the beam's similarity
  int scaling_runs = 13;     ///< values of A_d Y₀
  int scaling_steps = 1600;  ///< load steps of these runs
  int processes = 2;
  bool leave_out_failed = false;  ///< runs that fail; else they are an error
  model::Form form = model::Form::tree;
  int modes = 30;
  std::optional<int> sparse_level;            ///< else the whole tensor grid
  std::optional<double> adaptive_error;       ///< m; else `modes` as given
  std::optional<double> adaptive_shift;       ///< posterior std; else `modes` as given
  std::optional<double> adaptive_grid_error;  ///< m; else `nodes` as given
  std::optional<double> adaptive_grid_shift;  ///< posterior std; else `nodes` as given
  int adaptive_runs = 400;
  int crack_lengths = 80;
  std::vector<OfflineParameter> parameters;
};

/// The table [offline]; complains of what is out of range or does not go together.
[[nodiscard]] OfflineOptions read_offline(Values& values);

}  // namespace knothe::project
