#include "knothe/project/offline_options.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "knothe/base/text.hpp"
#include "knothe/project/option_section.hpp"

namespace knothe::project {
namespace {

using O = OfflineOptions;
using P = OfflineParameter;

void add_latin_options(Section<O>& s) {
  s.table("latin", "Options of LATIN-PGD.");
  s.add("latin.accuracy", &O::latin_accuracy,
        "Largest displacement that the out-of-balance forces left may be worth, m; 1e-7, fully separated "
        "1e-6.",
        positive);
  s.add("latin.window", &O::latin_window, "Load steps that are iterated together.", at_least(1));
  s.add(
      "latin.start", &O::latin_start,
      "Reduced model to start from, of the same mesh, steps and material, e.g. one of snapshots on a coarser "
      "grid of parameters (hybrid); otherwise the elastic solution.",
      file);
  s.choice("latin.separation", &O::latin_full, "joint", "full",
           "Space modes with joint functions of time and parameters; or every variable separated from every "
           "other while it iterates (form = \"canonical\").");
  s.add("latin.terms", &O::latin_terms, "Fully separated: terms at most while it iterates.", at_least(1));
}

void add_body_options(Section<O>& s) {
  s.table("mesh", "Mesh of the beam.");
  s.add("mesh.element", &O::element, "Element size near the notch, m.", positive);
  s.add("mesh.layers", &O::layers, "Layers of elements over the half thickness.", at_least(1));
  s.add("mesh.gmsh", &O::gmsh, "Mesh file of Gmsh (hexahedra, named groups) instead.", file);
  s.table("damage", "What makes the damage law independent of the mesh.");
  s.add("damage.regularisation", &O::regularisation,
        "The law as it is (the element size is then a material parameter); inelastic strain scaled by "
        "reference size / element size, which keeps stress against opening; or a strain averaged over an "
        "internal length (slower; not with LATIN-PGD).");
  s.add("damage.reference_size", &O::reference_size, "Crack band: element size that Y0 and Ad belong to, m.",
        positive);
  s.add("damage.internal_length", &O::internal_length,
        "Gradient: length over which strain is averaged, m; at least two elements.", positive);
  s.add("steps", &O::steps, "Number of load steps.", at_least(1));
  s.add("displacement", &O::displacement, "Final imposed displacement, m.", positive);
  s.add("young_modulus", &O::young_modulus, "Young's modulus, Pa.", positive);
  s.add("poisson_ratio", &O::poisson_ratio, "Poisson's ratio.",
        check([](double v) { return v > -1 && v < 0.5; }, "\"{}\" must be between -1 and 0.5"));
  s.add("left_support", &O::left_support, "Where u_x = 0: the line support, or the whole left face.");
}

void add_reduction_options(Section<O>& s) {
  s.add("processes", &O::processes, "Processes that compute full-order runs side by side.", at_least(1));
  s.add("form", &O::form, "Form of the separated model.");
  s.add("modes", &O::modes, "Number of modes (tree: r, canonical: m).", at_least(1));
  s.add("sparse_level", &O::sparse_level,
        "Full-order runs at the points of a sparse grid of this level only (for four parameters and more); "
        "the others of the tensor grid are interpolated. Default: all points.");
  s.table("adaptive", "Sizes of the reduced model found by its error, not given.");
  s.add("adaptive.error", &O::adaptive_error,
        "Modes are added until no observed dof is off by more at any grid point and step, m; `modes` is not "
        "used.",
        positive);
  s.add("adaptive.posterior_shift", &O::adaptive_shift,
        "Modes are added until the posterior mean of synthetic data moves by less at every step, in its "
        "standard deviation, at three truths (needs [parameters] and [simulate]); `modes` is not used.",
        positive);
  s.add("adaptive.grid_error", &O::adaptive_grid_error,
        "The level of a sparse grid rises, then nodes are added to the parameter grid, until it meets four "
        "full-order runs off the grid to this on the observed dofs, m.",
        positive);
  s.add("adaptive.runs", &O::adaptive_runs, "Largest number of grid points then.");
  s.add("crack_lengths", &O::crack_lengths, "Elastic crack solutions, 1 mm apart from 0; 0 for none.",
        check([](double v) { return v <= 80; }, "the ligament is 80 mm high: at most 80 lengths"));
}

const Section<O>& offline_section() {
  static const Section<O> k_section("offline", "How the reduced model is made.", [](Section<O>& s) {
    s.add("method", &O::method,
          "Full-order runs on a grid of parameters, or LATIN-PGD, which solves for the whole grid at once.");
    add_latin_options(s);
    add_body_options(s);
    add_reduction_options(s);
    s.table(
        "parameters",
        "One table per parameter: `Y0` and `Ad` of the damage law; `E`, `support_stiffness`, `load_offset` "
        "if wanted.");
  });
  return k_section;
}

const Section<P>& parameter_section() {
  static const Section<P> k_section("offline.parameters.*", "Axis of the parameter grid.", [](Section<P>& s) {
    s.add("reference", &P::reference,
          "Physical value of 1.0 (Y0: J/m³, Ad: m³/J, E: Pa, support_stiffness: N/m of each support, "
          "load_offset: m, at most 0.01 in all).",
          positive, required);
    s.add("lower", &P::lower, "Lower end of the axis, dimensionless; positive but for load_offset.",
          required);
    s.add("upper", &P::upper, "Upper end of the axis, dimensionless.", positive, required);
    s.add("nodes", &P::nodes, "Nodes of the axis, evenly spaced, at least 2.", at_least(2));
  });
  return k_section;
}

OfflineParameter read_parameter(Values& values, const std::string& name) {
  const std::string path = "offline.parameters." + name;
  static const std::vector<std::string> k_known = {"Y0", "Ad", "E", "support_stiffness", "load_offset"};
  if (std::find(k_known.begin(), k_known.end(), name) == k_known.end()) {
    values.complain(
        path,
        fmt::format("the beam has no parameter \"{}\"{}; it has Y0, Ad, E, support_stiffness and load_offset",
                    name, did_you_mean(name, k_known)));
  }
  OfflineParameter p = parameter_section().read(values, name);
  p.name = name;
  if (!(p.lower > 0) && name != "load_offset")
    values.complain(path + ".lower", fmt::format("[{}]: \"lower\" must be positive", path));
  if (!(p.upper > p.lower))
    values.complain(path + ".upper", fmt::format("[{}]: \"upper\" must be greater than \"lower\"", path));
  return p;
}

void check_latin(Values& values, const OfflineOptions& o) {
  const auto refuse = [&](bool when, const char* key, const char* text) {
    if (when) values.complain(std::string("offline.") + key, text);
  };
  refuse(
      o.latin_full && o.form != reduction::Form::canonical, "latin.separation",
      "separation = \"full\" finds the solution in the canonical form: it goes with form = \"canonical\" in "
      "[offline]; for the tree form leave it away");
  if (o.method != OfflineMethod::latin) return;
  refuse(o.regularisation == DamageRegularisation::gradient, "damage",
         "LATIN-PGD cannot do gradient damage, which couples all points: take method = \"snapshots\", "
         "or regularisation = \"crack-band\"");
  refuse(o.sparse_level.has_value(), "sparse_level",
         "\"sparse_level\" leaves out full-order runs: it goes with method = \"snapshots\"");
  refuse(o.adaptive_grid_error.has_value(), "adaptive.grid_error",
         "\"grid_error\" adds full-order runs: it goes with method = \"snapshots\"");
  refuse(o.parameters.size() > 2, "method",
         "LATIN-PGD solves for Y0 and Ad, on one elastic body: other parameters take method = \"snapshots\"");
}

}  // namespace

std::vector<Option> offline_option_table() {
  return joined(offline_section(), parameter_section());
}

OfflineOptions read_offline(Values& values) {
  OfflineOptions o = offline_section().read(values);
  for (const std::string& name : values.children_of("offline.parameters"))
    o.parameters.push_back(read_parameter(values, name));
  if (o.regularisation == DamageRegularisation::gradient && o.gmsh.empty() &&
      o.internal_length < 1.999 * o.element)
    values.complain(
        "offline.damage",
        fmt::format("gradient damage: \"internal_length\" is {:g} m, less than two elements of {:g} m: "
                    "the averaged strain cannot be resolved",
                    o.internal_length, o.element));
  if (o.adaptive_error && o.adaptive_shift)
    values.complain("offline.adaptive",
                    "[offline.adaptive]: give \"error\" or \"posterior_shift\", not both");
  const auto has = [&](const char* name) {
    return std::any_of(o.parameters.begin(), o.parameters.end(),
                       [&](const auto& p) { return p.name == name; });
  };
  if (!has("Y0") || !has("Ad"))
    values.complain("offline", "[offline.parameters] must have both parameters of the damage law, Y0 and Ad");
  check_latin(values, o);
  return o;
}

}  // namespace knothe::project
