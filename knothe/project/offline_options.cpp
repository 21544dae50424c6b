#include "knothe/project/offline_options.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <functional>

#include "knothe/base/text.hpp"
#include "knothe/project/option_section.hpp"

namespace knothe::project {
namespace {

using O = OfflineOptions;
using P = OfflineParameter;

void add_latin_options(Section<O>& s) {
  s.table("latin", "Options of LATIN-PGD.");
  s.add("latin.accuracy", &O::latin_accuracy,
        "Tolerance on the remaining out-of-balance forces, as the displacement that they would cause, m.",
        positive);
  s.add("latin.window", &O::latin_window, "Number of load steps that are iterated together.", at_least(1));
  s.add("latin.start", &O::latin_start,
        "Reduced model to start from, of the same mesh, steps and material, e.g. one of snapshots on a "
        "coarser grid of parameters (hybrid); otherwise the elastic solution.",
        file);
}

void add_body_options(Section<O>& s) {
  s.table("mesh", "Mesh of the beam.");
  s.add("mesh.element", &O::element, "Element size near the notch, m.", positive);
  s.add("mesh.layers", &O::layers, "Layers of elements over the half thickness.", at_least(1));
  s.add("mesh.gmsh", &O::gmsh, "Mesh file of Gmsh (hexahedra, named groups) instead.", file);
  s.table("damage", "The damage law, and what makes it independent of the mesh.");
  s.add("damage.law", &O::law,
        "Brittle as in the paper, with the parameters `Y0` and `Ad`: stress falls like 1 / opening; or "
        "exponentially or along two straight lines (Petersson), `Y0` and `Gf`, with regularisation = "
        "\"crack-band\" (not with LATIN-PGD).");
  s.add("damage.regularisation", &O::regularisation,
        "The law as it is (the element size is then a material parameter); inelastic strain scaled by "
        "reference size / element size, which keeps stress against opening; or a strain averaged over an "
        "internal length (slower; not with LATIN-PGD).");
  s.add("damage.reference_size", &O::reference_size, "Crack band: element size that Y0 and Ad belong to, m.",
        positive);
  s.add("damage.internal_length", &O::internal_length,
        "Gradient: length over which strain is averaged, m; at least two elements.", positive);
  s.add("time", in(&O::time, &model::TimeAxis::output),
        "Output of the solver that replaces time, e.g. `\"crack_mouth_opening\"`: it must grow in every run, "
        "which is then resampled at `time_values` (docs/explanation/mechanics.md).");
  s.add("time_values", in(&O::time, &model::TimeAxis::values),
        "Values of that output that are the model's times, increasing, in its unit (SI).");
  s.add("steps", &O::steps, "Number of load steps.", at_least(1));
  s.add("displacement", &O::displacement, "Final imposed displacement, m.", positive);
  s.add("young_modulus", &O::young_modulus, "Young's modulus, Pa.", positive);
  s.add("poisson_ratio", &O::poisson_ratio, "Poisson's ratio.",
        check([](double v) { return v > -1 && v < 0.5; }, "\"{}\" must be between -1 and 0.5"));
  s.add("left_support", &O::left_support, "Where u_x = 0: the line support, or the whole left face.");
}

void add_reduction_options(Section<O>& s) {
  s.choice("scaling", &O::scaling, "off", "on",
           "On: the grid is filled from full-order runs at a few values of Y0 Ad, by the beam's exact "
           "similarity; E needs none. The number of nodes costs no run.");
  s.add("scaling_runs", &O::scaling_runs, "With `scaling`: values of Y0 Ad at which the beam is solved.",
        at_least(4));
  s.add("scaling_steps", &O::scaling_steps, "With `scaling`: load steps of these runs.", at_least(10));
  s.add("processes", &O::processes, "Number of processes that compute full-order runs in parallel.",
        at_least(1));
  s.choice("failed_runs", &O::leave_out_failed, "stop", "leave-out",
           "What happens if a full-order run fails: no model is made; or the run is reported and left out, "
           "together with the grid nodes that depend on it, or with the degrees of `grid_shift` that build "
           "on it.");
  s.add("form", &O::form, "Form of the separated model.");
  s.add("modes", &O::modes, "Number of modes (tree: r, canonical: m).", at_least(1));
  s.add("sparse_level", &O::sparse_level,
        "Full-order runs at the points of a sparse grid of this level only (for four parameters and more); "
        "the others of the tensor grid are interpolated. Default: all points.");
  s.table("adaptive", "Sizes of the reduced model chosen by its error instead of being given.");
  s.add("adaptive.error", &O::adaptive_error,
        "Modes are added until no observed dof is off by more than this at any grid point and step, m; "
        "`modes` is not used.",
        positive);
  s.add("adaptive.posterior_shift", &O::adaptive_shift,
        "Modes are added until the error of the model shifts the posterior mean of synthetic data by less "
        "than this at every step, in posterior standard deviations, for three sets of true parameters (needs "
        "[parameters] and [simulate]); `modes` is not used.",
        positive);
  s.add("adaptive.grid_error", &O::adaptive_grid_error,
        "The level of a sparse grid rises, then nodes are added to the parameter grid, until the model "
        "agrees with four full-order runs off the grid to within this value at the observed dofs, m.",
        positive);
  s.add("adaptive.grid_shift", &O::adaptive_grid_shift,
        "Full-order runs are chosen in rounds, until the error of the model between them shifts the "
        "posterior of the planned sensors by less than this, in posterior standard deviations "
        "(docs/explanation/adaptive-runs.md; needs [parameters] and [simulate]); `nodes` is not used.",
        positive);
  s.add("adaptive.runs", &O::adaptive_runs,
        "With `grid_error`, maximum number of grid points; with `grid_shift`, maximum number of runs.");
  s.add("crack_lengths", &O::crack_lengths, "Elastic crack solutions, 1 mm apart from 0; 0 for none.",
        check([](double v) { return v <= 80; }, "the ligament is 80 mm high: at most 80 lengths"));
}

constexpr const char* k_time_units =
    "Unit of these times, for reports and axes; a known one is converted to s.";

const Section<model::CommandOptions>& command_section() {
  using C = model::CommandOptions;
  using R = model::ResultOptions;
  static const Section<C> k_section(
      "offline.command",
      "Another program as full-order model, instead of the beam (docs/tutorials/own-solver.md).",
      [](Section<C>& s) {
        s.add("run", &C::run,
              "Program and arguments, run in a separate working folder for each solution. In these words and "
              "in the templates `{{NAME}}` is replaced by the parameter's physical value, `{{NAME:.8e}}` by "
              "the same in that format.",
              required);
        s.add("templates", &C::templates,
              "Files whose placeholders are filled in and that are then put into the working folder.", file);
        s.add("files", &C::files, "Files that are linked into the working folder as they are.", file);
        s.add("field", in(&C::result, &R::field),
              "File in which the run leaves its solution: `.csv` (a column `time`, one for each quantity), "
              "`.npy` [times, dofs] or `.h5` (snapshots of one point).",
              required);
        s.add("quantity", in(&C::result, &R::quantity),
              "Field to be read, if the file has several; the displacement otherwise.");
        s.add("outputs", in(&C::result, &R::outputs),
              "CSV file in which the run leaves further scalars: a column `time`, one for each.");
        s.add("times", in(&C::result, &R::times), "Model times, if the file has none.");
        s.add("time_units", in(&C::result, &R::time_units), k_time_units);
        s.add("names", in(&C::result, &R::names),
              "`.npy`: name of each column, a quantity without a position; `.dat`: the quantities to be "
              "taken, all of them if there are no names.");
        s.add("units", in(&C::result, &R::units),
              "Unit of each of these names; known ones (`mm`, `kN`, …) are converted to SI.");
        s.add("points", in(&C::result, &R::points),
              "`.npy`: CSV file `x,y,z,component` with the position of each column, instead of names.", file);
        s.add("time_limit", &C::time_limit_s, "Seconds after which an attempt is killed; 0: no limit.",
              non_negative);
        s.add("retries", &C::retries, "Further attempts at a run that has failed.");
      });
  return k_section;
}

const Section<UmbridgeSource>& umbridge_section() {
  using U = UmbridgeSource;
  static const Section<U> k_section(
      "offline.umbridge",
      "A model of a UM-Bridge 1.0 server as full-order model, instead of the beam "
      "(docs/tutorials/own-solver.md). The physical parameters fill its inputs; its outputs are all "
      "quantities at the first time, at the second, …",
      [](Section<U>& s) {
        s.add("url", &U::url, "Address of the server, `\"http://HOST:PORT\"`.", required);
        s.add("name", &U::name, "Name of the model, if the server has several.");
        s.add("config", &U::config, "Passed through to the model.", free_table);
        s.add("timeout", &U::timeout, "Seconds after which a request counts as failed.", positive);
        s.add("times", &U::times, "Model times of the outputs.", required);
        s.add("time_units", &U::time_units, k_time_units);
        s.add("names", &U::names, "Name of each quantity.", required);
        s.add("units", &U::units, "Unit of each quantity.");
      });
  return k_section;
}

const Section<O>& offline_section() {
  static const Section<O> k_section("offline", "How the reduced model is made.", [](Section<O>& s) {
    s.add("method", &O::method,
          "Full-order runs on a grid of parameters, or LATIN-PGD, which solves for the whole grid at once.");
    add_latin_options(s);
    add_body_options(s);
    add_reduction_options(s);
    s.table("parameters",
            "One table per parameter: `Y0` and `Ad` of the damage law (`Y0` and `Gf` of the others); "
            "`E`, `support_stiffness`, `load_offset` if wanted.");
  });
  return k_section;
}

const Section<P>& parameter_section() {
  static const Section<P> k_section("offline.parameters.*", "Axis of the parameter grid.", [](Section<P>& s) {
    s.add("reference", &P::reference,
          "Physical value of 1.0 (Y0: J/m³, Ad: m³/J, Gf: J/m², E: Pa, support_stiffness: N/m of each "
          "support, load_offset: m, at most 0.01 in all). With another solver 1 is the default: the axis, "
          "and with it priors and truth, are then in the parameter's own unit.",
          positive, no_default);
    s.add("lower", &P::lower,
          "Lower end of the axis, in multiples of the reference; positive, except for load_offset and with "
          "another solver.",
          required);
    s.add("upper", &P::upper, "Upper end of the axis, likewise.", required);
    s.add("nodes", &P::nodes, "Nodes of the axis, evenly spaced, at least 2.", at_least(2));
    s.add("units", &P::units, "Another solver: unit of the parameter, \"N/m\".");
    s.add("long_name", &P::long_name, "Another solver: description of the parameter.");
  });
  return k_section;
}

/// A parameter of another solver than the beam.
OfflineParameter read_own_parameter(Values& values, const std::string& name) {
  const std::string path = "offline.parameters." + name;
  OfflineParameter p = parameter_section().read(values, name);
  p.name = name;
  if (!(p.upper > p.lower))
    values.complain(path + ".upper", fmt::format("[{}]: \"upper\" must be greater than \"lower\"", path));
  return p;
}

/// A parameter of the beam.
OfflineParameter read_parameter(Values& values, const std::string& name) {
  const std::string path = "offline.parameters." + name;
  static const std::vector<std::string> k_known = {"Y0", "Ad", "Gf", "E", "support_stiffness", "load_offset"};
  if (std::find(k_known.begin(), k_known.end(), name) == k_known.end()) {
    values.complain(
        path,
        fmt::format(
            "the beam has no parameter \"{}\"{}; it has Y0, Ad (or Gf), E, support_stiffness and load_offset",
            name, did_you_mean(name, k_known)));
  }
  OfflineParameter p = parameter_section().read(values, name);
  p.name = name;
  if (!(p.lower > 0) && name != "load_offset")
    values.complain(path + ".lower", fmt::format("[{}]: \"lower\" must be positive", path));
  if (!values.has(path + ".reference"))
    values.complain(path, fmt::format("[{}] lacks \"reference\": the physical value of 1.0", path));
  if (!(p.upper > std::max(p.lower, 0.0)))
    values.complain(path + ".upper",
                    fmt::format("[{}]: \"upper\" must be positive, and greater than \"lower\"", path));
  for (const char* key : {".units", ".long_name"})
    if (values.has(path + key))
      values.complain(path + key, fmt::format("[{}]: what the beam's parameters are is known: \"{}\" goes "
                                              "with another solver",
                                              path, key + 1));
  return p;
}

/// What chooses runs does not go with what else does.
void check_grid_shift(Values& values, const OfflineOptions& o) {
  if (!o.adaptive_grid_shift) return;
  const auto refuse = [&](bool when, const char* key, const char* text) {
    if (when) values.complain(std::string("offline.") + key, text);
  };
  refuse(o.adaptive_grid_error.has_value(), "adaptive",
         "[offline.adaptive]: give \"grid_error\" or \"grid_shift\", not both");
  refuse(o.sparse_level.has_value(), "sparse_level",
         "\"sparse_level\" says which runs to make, and so does \"grid_shift\": leave one away");
  refuse(o.method == OfflineMethod::latin, "adaptive.grid_shift",
         "\"grid_shift\" chooses full-order runs: it needs method = \"snapshots\"");
  refuse(o.parameters.size() > 8, "adaptive.grid_shift",
         "\"grid_shift\" chooses runs for at most 8 parameters");
}

/// What fills the grid does not go with what chooses its runs.
void check_scaling(Values& values, const OfflineOptions& o) {
  if (!o.scaling) return;
  const auto refuse = [&](bool when, const char* key) {
    if (when)
      values.complain(
          std::string("offline.") + key,
          fmt::format("[offline] scaling = \"on\" fills the grid from \"scaling_runs\" full-order "
                      "runs: leave \"{}\" away",
                      key));
  };
  refuse(o.adaptive_grid_error.has_value(), "adaptive.grid_error");
  refuse(o.adaptive_grid_shift.has_value(), "adaptive.grid_shift");
  refuse(o.sparse_level.has_value(), "sparse_level");
}

/// What goes with the beam alone.
void check_own_solver(Values& values, const OfflineOptions& o) {
  if (values.has("offline.command.units") && !values.has("offline.command.names"))
    values.complain(
        "offline.command.units",
        "[offline.command] \"units\" are those of \"names\": without names a field is a displacement "
        "in m, and a CSV file has its units in its header (\"force [kN]\")");
  if (o.parameters.empty())
    values.complain("offline", "[offline.parameters] has no parameter: one table for each of the program's");
  if (o.method == OfflineMethod::latin)
    values.complain("offline.method",
                    "LATIN-PGD solves for the built-in beam: another solver needs method = \"snapshots\"");
  for (const char* key :
       {"mesh", "damage", "latin", "steps", "displacement", "young_modulus", "poisson_ratio", "left_support",
        "crack_lengths", "scaling", "scaling_runs", "scaling_steps"}) {
    const std::string path = std::string("offline.") + key;
    if (values.has(path) || values.has_table(path))
      values.complain(path, fmt::format("[offline] {} is of the built-in beam: leave it away beside "
                                        "another solver",
                                        key));
  }
}

void check_failed_runs(Values& values, const OfflineOptions& o) {
  if (!o.leave_out_failed) return;
  if (o.sparse_level)
    values.complain("offline.failed_runs",
                    "[offline] failed_runs = \"leave-out\" does not go with \"sparse_level\": a sparse grid "
                    "needs all its runs");
  if (o.method == OfflineMethod::latin)
    values.complain(
        "offline.failed_runs",
        "[offline] failed_runs = \"leave-out\" needs method = \"snapshots\": LATIN-PGD has no runs");
}

void check_time(Values& values, const model::TimeAxis& time) {
  if (time.output.empty() != time.values.empty())
    values.complain(time.output.empty() ? "offline.time_values" : "offline.time",
                    "[offline] \"time\" and \"time_values\" go together: an output, and its values that are "
                    "the model's times");
  const auto falls = std::adjacent_find(time.values.begin(), time.values.end(), std::greater_equal<>());
  if (falls != time.values.end() || time.values.size() == 1)
    values.complain(
        "offline.time_values",
        "[offline] \"time_values\" must be at least two numbers, each greater than the one before");
}

void check_latin(Values& values, const OfflineOptions& o) {
  if (o.method != OfflineMethod::latin) return;
  const auto refuse = [&](bool when, const char* key, const char* text) {
    if (when) values.complain(std::string("offline.") + key, text);
  };
  refuse(!o.time.output.empty(), "time",
         "LATIN-PGD solves for all parameters at the same load steps: \"time\" needs method = \"snapshots\"");
  refuse(o.law != SofteningLaw::brittle, "damage.law",
         "LATIN-PGD has the brittle law only: the others need method = \"snapshots\"");
  refuse(o.regularisation == DamageRegularisation::gradient, "damage",
         "LATIN-PGD cannot do gradient damage, which couples all points: take method = \"snapshots\", "
         "or regularisation = \"crack-band\"");
  refuse(o.sparse_level.has_value(), "sparse_level",
         "\"sparse_level\" leaves out full-order runs: it needs method = \"snapshots\"");
  refuse(o.adaptive_grid_error.has_value(), "adaptive.grid_error",
         "\"grid_error\" adds full-order runs: it needs method = \"snapshots\"");
  refuse(o.scaling, "scaling", "\"scaling\" saves full-order runs: it needs method = \"snapshots\"");
  refuse(o.parameters.size() > 2, "method",
         "LATIN-PGD solves for Y0 and Ad, on one elastic body: other parameters take method = \"snapshots\"");
}

}  // namespace

std::vector<Option> offline_option_table() {
  return joined(offline_section(), command_section(), umbridge_section(), parameter_section());
}

OfflineOptions read_offline(Values& values) {
  OfflineOptions o = offline_section().read(values);
  if (values.has_table("offline.command")) o.command = command_section().read(values);
  if (values.has_table("offline.umbridge")) o.umbridge = umbridge_section().read(values);
  if (o.command && o.umbridge)
    values.complain("offline.umbridge", "[offline] has both \"command\" and \"umbridge\": choose one");
  check_time(values, o.time);
  check_failed_runs(values, o);
  const bool is_own = !o.is_beam();
  for (const std::string& name : values.children_of("offline.parameters"))
    o.parameters.push_back((is_own ? read_own_parameter : read_parameter)(values, name));
  if (o.regularisation == DamageRegularisation::gradient && o.gmsh.empty() &&
      o.internal_length < 1.999 * o.element)
    values.complain("offline.damage",
                    fmt::format("gradient damage: \"internal_length\" is {:g} m, less than two elements of "
                                "{:g} m: the averaged strain cannot be resolved",
                                o.internal_length, o.element));
  if (o.adaptive_error && o.adaptive_shift)
    values.complain("offline.adaptive",
                    "[offline.adaptive]: give \"error\" or \"posterior_shift\", not both");
  check_grid_shift(values, o);
  check_scaling(values, o);
  if (is_own) {
    check_own_solver(values, o);
    return o;
  }
  const auto has = [&](const char* name) {
    return std::any_of(o.parameters.begin(), o.parameters.end(),
                       [&](const auto& p) { return p.name == name; });
  };
  const bool is_of_opening = o.law != SofteningLaw::brittle;
  const char *second = is_of_opening ? "Gf" : "Ad", *other = is_of_opening ? "Ad" : "Gf";
  if (!has("Y0") || !has(second) || has(other))
    values.complain(
        "offline",
        fmt::format("[offline.parameters] must have both parameters of the damage law, Y0 and {}", second));
  if (is_of_opening && o.regularisation != DamageRegularisation::crack_band)
    values.complain("offline.damage.law",
                    "the law is one of stress against opening: it needs [offline] damage = { "
                    "regularisation = \"crack-band\" }");
  check_latin(values, o);
  return o;
}

}  // namespace knothe::project
