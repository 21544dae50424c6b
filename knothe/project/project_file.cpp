#include "knothe/project/project_file.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "knothe/base/error.hpp"
#include "knothe/base/text.hpp"
#include "knothe/project/data_options.hpp"
#include "knothe/project/inference_options.hpp"
#include "knothe/project/method_options.hpp"
#include "knothe/project/project_values.hpp"

namespace knothe::project {
namespace {

std::vector<std::string> children(const Values& values, const std::string& table) {
  const auto it = values.children.find(table);
  return it == values.children.end() ? std::vector<std::string>() : it->second;
}

/// Complains unless exactly the keys `needed` of the prior are given.
void check_prior_keys(Values& values, const std::string& path, const std::vector<std::string>& needed) {
  const std::vector<std::string> given = children(values, path);
  for (const std::string& key : needed) {
    if (std::find(given.begin(), given.end(), key) == given.end()) {
      values.complain(
          path, fmt::format("[{}]: a {} prior needs \"{}\"", path, values.text(path + ".prior", ""), key));
    }
  }
  for (const std::string& key : given) {
    if (key != "prior" && std::find(needed.begin(), needed.end(), key) == needed.end()) {
      values.complain(path + "." + key,
                      fmt::format("\"{}\" does not belong to a {} prior, which takes {}", key,
                                  values.text(path + ".prior", ""), fmt::join(needed, " and ")));
    }
  }
}

assimilation::Prior read_prior(Values& values, const std::string& path) {
  using assimilation::Prior;
  const std::string kind = values.text(path + ".prior", "");
  const auto at = [&](const char* key, double otherwise) {
    return values.number(path + "." + key, otherwise);
  };
  if (kind == "normal") {
    check_prior_keys(values, path, {"mean", "std"});
    return Prior::normal(at("mean", 0), at("std", 1));
  }
  if (kind == "lognormal") {
    check_prior_keys(values, path, {"mu", "sigma"});
    return Prior::lognormal(at("mu", 0), at("sigma", 1));
  }
  if (kind == "uniform") {
    check_prior_keys(values, path, {"lower", "upper"});
    if (at("upper", 1) > at("lower", 0)) return Prior::uniform(at("lower", 0), at("upper", 1));
    values.complain(path + ".upper", fmt::format("[{}]: \"upper\" must be greater than \"lower\"", path));
  }
  return Prior::normal(0, 1);
}

KnownParameter read_known(Values& values, const std::string& name) {
  const std::string path = "parameters." + name;
  for (const std::string& key : children(values, path)) {
    if (key != "prior" && key != "value") {
      values.complain(path + "." + key,
                      fmt::format("\"{}\" does not belong to a known parameter, which takes value", key));
    }
  }
  KnownParameter known{name, std::nullopt};
  if (values.has(path + ".value")) known.value = values.number(path + ".value", 0);
  return known;
}

OfflineParameter read_offline_parameter(Values& values, const std::string& name) {
  const std::string path = "offline.parameters." + name;
  static const std::vector<std::string> k_known = {"Y0", "Ad", "E", "support_stiffness", "load_offset"};
  if (std::find(k_known.begin(), k_known.end(), name) == k_known.end()) {
    values.complain(
        path,
        fmt::format("the beam has no parameter \"{}\"{}; it has Y0, Ad, E, support_stiffness and load_offset",
                    name, did_you_mean(name, k_known)));
  }
  values.at_least(path + ".nodes", 2);
  OfflineParameter p;
  p.name = name;
  p.reference = values.number(path + ".reference", p.reference);
  p.lower = values.number(path + ".lower", p.lower);
  p.upper = values.number(path + ".upper", p.upper);
  p.nodes = static_cast<int>(values.integer(path + ".nodes", p.nodes));
  if (!(p.lower > 0) && name != "load_offset") {
    values.complain(path + ".lower", fmt::format("[{}]: \"lower\" must be positive", path));
  }
  if (!(p.upper > p.lower)) {
    values.complain(path + ".upper", fmt::format("[{}]: \"upper\" must be greater than \"lower\"", path));
  }
  return p;
}

OfflineOptions read_offline(Values& values, const std::string& folder) {
  for (const char* key : {"mesh.layers", "steps", "processes", "modes", "latin.window", "latin.terms"}) {
    values.at_least(std::string("offline.") + key, 1);
  }
  OfflineOptions o;
  o.method = values.text("offline.method", o.method);
  o.latin_accuracy = values.number("offline.latin.accuracy", o.latin_accuracy);
  o.latin_window = static_cast<int>(values.integer("offline.latin.window", o.latin_window));
  if (values.has("offline.latin.start")) {
    o.latin_start = (std::filesystem::path(folder) / values.text("offline.latin.start", "")).string();
  }
  o.latin_full = values.text("offline.latin.separation", "joint") == "full";
  o.latin_terms = static_cast<int>(values.integer("offline.latin.terms", o.latin_terms));
  o.element = values.number("offline.mesh.element", o.element);
  o.layers = static_cast<int>(values.integer("offline.mesh.layers", o.layers));
  if (values.has("offline.mesh.gmsh")) {
    o.gmsh = (std::filesystem::path(folder) / values.text("offline.mesh.gmsh", "")).string();
  }
  o.regularisation = values.text("offline.damage.regularisation", o.regularisation);
  o.reference_size = values.number("offline.damage.reference_size", o.reference_size);
  o.internal_length = values.number("offline.damage.internal_length", o.internal_length);
  if (o.regularisation == "gradient" && o.gmsh.empty() && o.internal_length < 1.999 * o.element)
    values.complain(
        "offline.damage",
        fmt::format("gradient damage: \"internal_length\" is {:g} m, less than two elements of {:g} m: "
                    "the averaged strain cannot be resolved",
                    o.internal_length, o.element));
  if (o.regularisation == "gradient" && o.method == "latin")
    values.complain(
        "offline.damage",
        "LATIN-PGD cannot do gradient damage, which couples all points: take method = \"snapshots\", "
        "or regularisation = \"crack-band\"");
  o.steps = static_cast<int>(values.integer("offline.steps", o.steps));
  o.displacement = values.number("offline.displacement", o.displacement);
  o.young_modulus = values.number("offline.young_modulus", o.young_modulus);
  o.poisson_ratio = values.number("offline.poisson_ratio", o.poisson_ratio);
  if (!(o.poisson_ratio > -1 && o.poisson_ratio < 0.5)) {
    values.complain("offline.poisson_ratio", "\"offline.poisson_ratio\" must be between -1 and 0.5");
  }
  o.left_support = values.text("offline.left_support", o.left_support);
  o.processes = static_cast<int>(values.integer("offline.processes", o.processes));
  o.form = values.text("offline.form", o.form);
  o.modes = static_cast<int>(values.integer("offline.modes", o.modes));
  if (o.latin_full && o.form != "canonical")
    values.complain("offline.latin.separation",
                    "separation = \"full\" finds the solution in the canonical form: it goes with form = "
                    "\"canonical\" in [offline]; for the tree form leave it away");
  o.sparse_level = static_cast<int>(values.integer("offline.sparse_level", o.sparse_level));
  if (o.sparse_level >= 0 && o.method == "latin")
    values.complain("offline.sparse_level",
                    "\"sparse_level\" leaves out full-order runs: it goes with method = \"snapshots\"");
  o.adaptive_error = values.number("offline.adaptive.error", 0);
  o.adaptive_shift = values.number("offline.adaptive.posterior_shift", 0);
  o.adaptive_grid_error = values.number("offline.adaptive.grid_error", 0);
  o.adaptive_runs = static_cast<int>(values.integer("offline.adaptive.runs", o.adaptive_runs));
  if (o.adaptive_error > 0 && o.adaptive_shift > 0)
    values.complain("offline.adaptive",
                    "[offline.adaptive]: give \"error\" or \"posterior_shift\", not both");
  if (o.adaptive_grid_error > 0 && o.method == "latin")
    values.complain("offline.adaptive.grid_error",
                    "\"grid_error\" adds full-order runs: it goes with method = \"snapshots\"");
  o.crack_lengths = static_cast<int>(values.integer("offline.crack_lengths", o.crack_lengths));
  if (o.crack_lengths > 80)
    values.complain("offline.crack_lengths", "the ligament is 80 mm high: at most 80 lengths");
  for (const std::string& name : children(values, "offline.parameters")) {
    o.parameters.push_back(read_offline_parameter(values, name));
  }
  const auto has = [&](const char* name) {
    return std::any_of(o.parameters.begin(), o.parameters.end(),
                       [&](const auto& p) { return p.name == name; });
  };
  if (!has("Y0") || !has("Ad")) {
    values.complain("offline", "[offline.parameters] must have both parameters of the damage law, Y0 and Ad");
  }
  if (o.parameters.size() > 2 && o.method == "latin") {
    values.complain(
        "offline.method",
        "LATIN-PGD solves for Y0 and Ad, on one elastic body: other parameters take method = \"snapshots\"");
  }
  return o;
}

std::optional<std::array<double, 2>> read_range(Values& values, const std::string& path) {
  if (!values.has(path)) return std::nullopt;
  const std::vector<double> v = values.numbers(path);
  if (v.size() != 2 || v[0] > v[1]) {
    values.complain(path, fmt::format("\"{}\" must be [from, to]", path));
    return std::nullopt;
  }
  return std::array<double, 2>{v[0], v[1]};
}

CameraSimulation read_camera(Values& values) {
  const auto integer = [&](const char* key, int otherwise) {
    const std::string path = std::string("simulate.camera.") + key;
    values.at_least(path, 1);
    return static_cast<int>(values.integer(path, otherwise));
  };
  CameraSimulation c;
  c.width = integer("width", 64), c.height = integer("height", 64);
  for (const char* key : {"width", "height"})
    if (const auto size = values.integer(std::string("simulate.camera.") + key, 64);
        size < 64 || size > 20000)
      values.complain(std::string("simulate.camera.") + key,
                      fmt::format("a picture's {} must be from 64 to 20000 px", key));
  c.bit_depth = integer("bit_depth", c.bit_depth);
  if (c.bit_depth < 8 || c.bit_depth > 16)
    values.complain("simulate.camera.bit_depth", "\"simulate.camera.bit_depth\" must be from 8 to 16");
  c.noise = values.number("simulate.camera.noise", c.noise);
  c.dot_radius = values.number("simulate.camera.dot_radius", c.dot_radius);
  c.gain = values.number("simulate.camera.gain", c.gain);
  c.references = integer("references", c.references);
  c.every = integer("every", c.every);
  c.supersampling = integer("supersampling", c.supersampling);
  return c;
}

SimulateOptions read_simulate(Values& values) {
  values.at_least("simulate.dofs.random", 1);
  SimulateOptions s;
  for (const std::string& name : children(values, "simulate.truth")) {
    s.truth[name] = values.number("simulate.truth." + name, 1);
  }
  s.random_nodes = static_cast<int>(values.integer("simulate.dofs.random", 0));
  s.face = values.text("simulate.dofs.face", s.face);
  s.x_range = read_range(values, "simulate.dofs.x");
  s.y_range = read_range(values, "simulate.dofs.y");
  if (values.has("simulate.dofs.components")) {
    s.components.clear();
    for (const std::string& c : values.texts("simulate.dofs.components")) {
      if (c != "x" && c != "y" && c != "z") {
        values.complain("simulate.dofs.components",
                        fmt::format("a component is \"x\", \"y\" or \"z\", not \"{}\"", c));
      } else {
        s.components.push_back(c[0] - 'x');
      }
    }
  }
  s.noise_std = values.number("simulate.noise_std", s.noise_std);
  s.seed = static_cast<std::uint64_t>(values.integer("simulate.seed", 1));
  if (values.has_table("simulate.camera")) s.camera = read_camera(values);
  if (!s.camera && !values.has_table("simulate.dofs"))
    values.complain(
        "simulate",
        "[simulate] lacks \"dofs\": which degrees of freedom are observed; or, for pictures, \"camera\"");
  return s;
}

SelectOptions read_select(Values& values) {
  values.at_least("select.count", 1);
  SelectOptions s;
  s.criterion = values.text("select.criterion", s.criterion);
  s.count = static_cast<int>(values.integer("select.count", s.count));
  s.min_distance = values.number("select.min_distance", s.min_distance);
  s.candidates = values.text("select.candidates", s.candidates);
  for (const std::string& name : children(values, "select.at"))
    s.at[name] = values.number("select.at." + name, 1);
  if (values.has("select.step")) s.step = static_cast<std::size_t>(values.integer("select.step", 0));
  if (values.has("select.noise_std")) s.noise_std = values.number("select.noise_std", 1e-6);
  return s;
}

forecast::ForecastSpecification read_forecast(Values& values, const std::string& name) {
  const std::string path = "forecast." + name;
  using Quantity = forecast::ForecastSpecification::Quantity;
  forecast::ForecastSpecification f;
  f.name = name;
  const std::string quantity = values.text(path + ".quantity", "");
  f.quantity = quantity == "output"         ? Quantity::output
               : quantity == "displacement" ? Quantity::displacement
                                            : Quantity::crack_length;
  f.horizon = values.number(path + ".horizon", 0);
  if (values.has(path + ".threshold")) f.threshold = values.number(path + ".threshold", 0);
  f.prior_mean = values.number(path + ".prior.mean", f.prior_mean);
  f.prior_std = values.number(path + ".prior.std", f.prior_std);
  f.discrepancy_std = values.number(path + ".discrepancy_std", f.discrepancy_std);
  f.length_offset = values.number(path + ".length_offset", f.length_offset);
  const std::vector<double> point = values.numbers(path + ".point");
  if (f.quantity == Quantity::displacement) {
    if (point.size() != 3) values.complain(path, fmt::format("[{}] needs \"point\" = [x, y, z]", path));
    if (!values.has(path + ".component"))
      values.complain(path, fmt::format("[{}] needs \"component\"", path));
  }
  if (point.size() == 3) std::copy(point.begin(), point.end(), f.point.begin());
  f.component = values.text(path + ".component", "x")[0] - 'x';
  f.output = values.text(path + ".output", "");
  if (f.quantity == Quantity::output && f.output.empty()) {
    values.complain(path, fmt::format("[{}] needs \"output\", the name of one of the model's outputs", path));
  }
  return f;
}

std::string resolve(const Values& values, const std::string& key, const std::string& folder) {
  const std::string path = values.text(key, "");
  return path.empty() ? path : (std::filesystem::path(folder) / path).lexically_normal().string();
}

[[noreturn]] void throw_complaints(std::vector<Complaint> complaints, const std::string& path) {
  std::stable_sort(complaints.begin(), complaints.end(), [](const Complaint& a, const Complaint& b) {
    return a.line != b.line ? a.line < b.line : a.column < b.column;
  });
  std::string text;
  for (const Complaint& c : complaints) {
    text += fmt::format("{}{}:{}:{}: error: {}", text.empty() ? "" : "\n", path, c.line, c.column, c.text);
  }
  throw ProjectError(text);
}

}  // namespace

ProjectError Project::error_at(std::string key, const std::string& text) const {
  std::array<int, 2> position = {1, 1};
  for (;; key.erase(key.rfind('.'))) {
    if (const auto it = positions.find(key); it != positions.end()) {
      position = it->second;
      break;
    }
    if (key.find('.') == std::string::npos) break;
  }
  return ProjectError(fmt::format("{}:{}:{}: error: {}", path, position[0], position[1], text));
}

void Project::require(bool present, const std::string& what) const {
  if (!present) throw ProjectError(fmt::format("{}:1:1: error: this command needs {}", path, what));
}

Project parse_project(const std::string& text, const std::string& path) {
  Values values = parse_values(text);
  Project project;
  project.path = path;
  project.folder = std::filesystem::path(path).parent_path().string();
  project.text = text;
  for (const auto& [key, where] : values.tables) project.positions[key] = {where.first, where.second};
  for (const auto& [key, value] : values.leaves) project.positions[key] = {value.line, value.column};
  project.model = resolve(values, "model.separated", project.folder);
  for (const std::string& file : values.texts("model.candidates"))
    project.candidates.push_back((std::filesystem::path(project.folder) / file).lexically_normal().string());
  project.data = resolve(values, "data.file", project.folder);
  project.clock = values.text("data.clock", "");
  for (const std::string& name : children(values, "data.sensors"))
    project.sensors.push_back(read_sensor(values, name));
  project.results = (std::filesystem::path(project.folder) / values.text("results", "results/")).string();
  for (const std::string& name : children(values, "parameters")) {
    if (values.text("parameters." + name + ".prior", "") == "known") {
      project.known.push_back(read_known(values, name));
    } else {
      project.parameters.push_back({name, read_prior(values, "parameters." + name)});
    }
  }
  project.method = read_method(values);
  project.umbridge = read_umbridge(values);
  if (values.has_table("observations")) project.observations = read_observations(values);
  project.pictures = read_pictures(values, project.folder);
  if (values.has_table("offline")) project.offline = read_offline(values, project.folder);
  if (values.has_table("simulate")) project.simulate = read_simulate(values);
  project.select = read_select(values);
  for (const std::string& name : children(values, "forecast")) {
    project.forecasts.push_back(read_forecast(values, name));
  }
  project.serve = read_serve(values, path);
  if (!values.complaints.empty()) throw_complaints(values.complaints, path);
  return project;
}

Project read_project(const std::string& path) {
  std::error_code ignored;
  if (std::filesystem::is_directory(path, ignored)) {
    throw ProjectError(fmt::format("{}: cannot read the project file: it is a folder", path));
  }
  std::ifstream in(path, std::ios::binary);
  std::ostringstream text;
  if (!in || !(text << in.rdbuf() || in.peek() == EOF)) {
    throw ProjectError(fmt::format("{}: cannot read the project file: {}", path, std::strerror(errno)));
  }
  return parse_project(text.str(), path);
}

}  // namespace knothe::project
