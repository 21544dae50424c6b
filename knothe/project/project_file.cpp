#include "knothe/project/project_file.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "knothe/base/error.hpp"
#include "knothe/project/data_options.hpp"
#include "knothe/project/forecast_options.hpp"
#include "knothe/project/option_section.hpp"

namespace knothe::project {
namespace {

const Section<Project>& project_section() {
  using P = Project;
  static const Section<P> k_section("", "", [](Section<P>& s) {
    s.table("model", "The reduced model; `model = \"M.h5\"` is short for `[model] separated = \"M.h5\"`.");
    s.add("model.separated", &P::model,
          "Reduced model file made by `knothe offline` or `knothe model import`.", file);
    s.add("model.candidates", &P::candidates,
          "Further reduced models that `knothe assimilate` runs in parallel on the same data; every step "
          "gives the probability of each model.",
          file);
    s.table("data", "The measurements; `data = \"D.h5\"` is short for `[data] file = \"D.h5\"`.");
    s.add("data.file", &P::data,
          "Measurements, HDF5 (`.h5`) or CSV (`.csv`); beside `data.pictures` what was recorded with them "
          "(force, stroke, …), at any rate.",
          file);
    s.table("data.std", "Standard deviations of series of the data files, where these have none or another.");
    s.add("data.std.*", &P::series_std, "Standard deviation of the series of that name, in its unit.",
          positive);
    s.add("data.clock", &P::clock,
          "Output of the model whose measured series gives the model time of each datum, e.g. "
          "`\"imposed_displacement\"`; the times in the data file then only give the order "
          "(docs/explanation/assimilation.md).");
    s.table("tolerances",
            "How well the inputs are known, each as a share of itself; the results say by how much such an "
            "error shifts each parameter (docs/explanation/verdict.md).");
    s.add("tolerances.*", &P::tolerances,
          "Of `displacements` (pixel size), `clock` (model time, an imposed displacement), `youngs_modulus` "
          "(of the built-in beam) or a series by its name; 0.01 where it is not given, 0 leaves it out.",
          between(0, 0.5));
    s.add("results", &P::results, "Folder for results; `-o` overrides it.", file);
  });
  return k_section;
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

std::vector<Option> project_option_table() {
  return joined(project_section());
}

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
  const std::string folder = std::filesystem::path(path).parent_path().string();
  Values values = parse_values(text, folder);
  Project project = project_section().read(values);
  project.path = path;
  project.folder = folder;
  project.text = text;
  for (const auto& [key, where] : values.tables) project.positions[key] = {where.first, where.second};
  for (const auto& [key, value] : values.leaves) project.positions[key] = {value.line, value.column};
  project.sensors = read_sensors(values);
  read_parameters(values, project);
  project.method = read_method(values);
  project.umbridge = read_umbridge(values);
  if (values.has_table("observations")) project.observations = read_observations(values);
  project.pictures = read_pictures(values);
  project.fields = read_field_options(values);
  if (values.has_table("offline")) project.offline = read_offline(values);
  if (values.has_table("simulate")) project.simulate = read_simulate(values);
  project.select = read_select(values);
  project.forecasts = read_forecasts(values);
  if (values.has_table("decide")) project.decide = read_decide(values);
  project.serve = read_serve(values, path);
  read_sources(values, project);
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
  const std::string content = text.str();
  const bool is_utf16 = content.starts_with("\xFF\xFE") || content.starts_with("\xFE\xFF");
  if (!is_utf16 && content.find('\0') != std::string::npos)
    throw ProjectError(fmt::format("{}: error: this is a binary file{}, not a project file: give the .toml",
                                   path, content.starts_with("\x89HDF") ? " (HDF5)" : ""));
  return parse_project(content, path);
}

}  // namespace knothe::project
