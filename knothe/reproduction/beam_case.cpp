#include "knothe/reproduction/beam_case.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <optional>

#include "knothe/base/error.hpp"
#include "knothe/base/version.hpp"
#include "knothe/mechanics/snapshot_runs.hpp"
#include "knothe/reduction/compression.hpp"
#include "knothe/reduction/crack_modes.hpp"
#include "knothe/reproduction/published.hpp"

namespace knothe::reproduction {
namespace {

namespace fs = std::filesystem;
constexpr std::uint64_t k_seed = 1;  // of the random starts of the decomposition

/// Everything that the model depends on; a file with another text is of another case.
std::string description(const BeamCase& c, const std::string& form) {
  const mechanics::BeamOptions& b = c.problem.beam;
  const mechanics::SolverOptions& s = c.problem.solver;
  return fmt::format(
      "{}, knothe reproduce: {}\nbeam {} x {} x {} m, element {}, layers {}, notch {} x {}, support {}, load {}, "
      "refined {}, protected {} x {}, growth {}, largest {}, {}\nE {} nu {} Y0 {} Ad {}\n{} steps to {} m, "
      "tolerance {}\n{} x {} parameter grid on [0.5, 1.5]^2\n{}, seed {}\n",
      k_created_by, c.what, b.length, b.height, 2 * b.half_thickness, b.element, b.layers, b.notch_width,
      b.notch_depth, b.support, b.load_half_width, b.refined_half_width, b.protected_half_width,
      b.protected_depth, b.growth, b.largest_element,
      b.left_support == mechanics::LeftSupport::left_face ? "left face" : "support line",
      c.problem.elastic.young_modulus, c.problem.elastic.poisson_ratio, c.problem.reference.threshold,
      c.problem.reference.brittleness, s.steps, s.displacement, s.tolerance, c.nodes, c.nodes, form, k_seed);
}

/// The model of that file, if it is there, whole, and of this description.
std::optional<reduction::SeparatedModel> kept_model(const std::string& path, const std::string& text) {
  if (!fs::exists(path)) return std::nullopt;
  try {
    reduction::ModelContents contents = reduction::read_model(path);
    if (contents.project != text) return std::nullopt;
    return reduction::SeparatedModel(std::move(contents), path);
  } catch (const DataError&) {
    return std::nullopt;  // of another version, or spoilt: it is built anew
  }
}

reduction::SeparatedModel keep(reduction::ModelContents contents, const std::string& path,
                               const std::string& text) {
  contents.project = text;
  reduction::write_model(contents, path);
  return reduction::SeparatedModel(std::move(contents), path);
}

std::string parts_folder(const BeamCase& chosen, const std::string& folder) {
  return (fs::path(folder) / (chosen.name + ".parts")).string();
}

reduction::Snapshots runs_of(const BeamCase& chosen, const std::string& folder, int processes) {
  mechanics::SnapshotGrid grid;
  grid.axes = axes_of(chosen);
  grid.parts_folder = parts_folder(chosen, folder);
  grid.processes = processes;
  mechanics::SnapshotRuns runs = mechanics::run_snapshots(chosen.problem, grid);
  for (const mechanics::RunSummary& run : runs.runs) {
    if (run.steps_without_equilibrium.empty()) continue;
    fmt::print(stderr, "knothe: {}: at ({:g}) {} steps are not in equilibrium to 1e-8\n", chosen.what,
               fmt::join(run.parameters, ", "), run.steps_without_equilibrium.size());
  }
  return std::move(runs.snapshots);
}

/// Crack solutions as modes (Eq. 32): all 80 lengths are kept, in the coordinates of a basis made of themselves.
reduction::CrackSolutions crack_solutions(const BeamCase& chosen, const reduction::Dofs& dofs) {
  const mechanics::CrackTable table = mechanics::crack_table(chosen.problem, {}, dofs);
  return reduction::crack_modes(table.lengths, table.values);
}

}  // namespace

BeamCase reference_case() {
  return {"reference", "elements and notch 5 mm, line supports", {}, 9};
}

BeamCase soft_coarse_case() {
  BeamCase c{"coarse_soft", "elements and notch 20 mm, 0.18 of the 0.4 mm reach the beam", {}, 5};
  c.problem.beam.element = 0.02;
  c.problem.solver.displacement = 1.8e-4;
  return c;
}

std::vector<BeamCase> other_cases() {
  std::vector<BeamCase> cases;
  const auto add = [&](const char* name, const char* what) -> mechanics::BeamOptions& {
    cases.push_back({name, what, {}, 5});
    return cases.back().problem.beam;
  };
  add("elements_10", "elements and notch 10 mm").element = 0.01;
  add("elements_20", "elements and notch 20 mm").element = 0.02;
  add("notch_10", "notch 10 mm wide, two columns of 5 mm").notch_width = 0.01;
  add("layers_2", "two layers of elements over the half thickness").layers = 2;
  add("left_face", "u_x = 0 on the whole left face").left_support = mechanics::LeftSupport::left_face;
  add("span_700", "supports 700 mm apart instead of 800 mm").support = 0.35;
  mechanics::BeamOptions& fine = add("elements_2", "elements and notch 2.5 mm");
  fine.element = fine.notch_width = 0.0025;
  return cases;
}

std::vector<reduction::Axis> axes_of(const BeamCase& chosen) {
  std::vector<reduction::Axis> axes(2);
  axes[0].name = "Y0";
  axes[0].reference = chosen.problem.reference.threshold;
  axes[0].long_name = "damage threshold Y0, multiple of its reference [J/m3]";
  axes[1].name = "Ad";
  axes[1].reference = chosen.problem.reference.brittleness;
  axes[1].long_name = "brittleness Ad, multiple of its reference [m3/J]";
  for (reduction::Axis& axis : axes)
    for (int i = 0; i < chosen.nodes; ++i) axis.nodes.push_back(0.5 + 1.0 * i / (chosen.nodes - 1));
  return axes;
}

BeamModels prepare(const BeamCase& chosen, const std::string& folder, int processes) {
  const std::string paper_path = (fs::path(folder) / (chosen.name + "_m6.h5")).string();
  const std::string three_path = (fs::path(folder) / (chosen.name + "_m3.h5")).string();
  const std::string paper_text = description(chosen, "canonical, lift and 5 modes");
  const std::string three_text = description(chosen, "canonical, lift and 2 modes");
  auto paper = kept_model(paper_path, paper_text);
  auto three = kept_model(three_path, three_text);
  if (paper && three) return {chosen, std::move(*paper), std::move(*three), true};
  const reduction::Snapshots snapshots = runs_of(chosen, folder, processes);
  reduction::CompressionOptions options;
  options.form = reduction::Form::canonical;
  options.seed = k_seed;
  const std::vector<std::size_t> modes = {published::k_few_modes - 1, published::k_modes - 1};
  auto studied = reduction::compression_study(snapshots, options, modes);
  for (reduction::StudiedModel& s : studied) {
    s.model.relative_error = std::max(s.row.training.relative, s.row.training.plain_relative);
    s.model.max_error_m = s.row.training.max;
  }
  studied[1].model.crack = crack_solutions(chosen, snapshots.dofs);
  return {chosen, keep(std::move(studied[1].model), paper_path, paper_text),
          keep(std::move(studied[0].model), three_path, three_text), false};
}

reduction::SeparatedModel prepare_accurate(const BeamCase& chosen, const std::string& folder, int processes) {
  const std::string path = (fs::path(folder) / (chosen.name + "_tree.h5")).string();
  const std::string text = description(chosen, "tree, 50 modes");
  if (auto kept = kept_model(path, text)) return std::move(*kept);
  const reduction::Snapshots snapshots = runs_of(chosen, folder, processes);
  reduction::CompressionOptions options;
  options.modes = std::min<std::size_t>(50, snapshots.grid_size() - 1);
  options.seed = k_seed;
  return keep(reduction::compress(snapshots, options), path, text);
}

reduction::SeparatedModel truncated(const reduction::SeparatedModel& canonical, int m) {
  reduction::ModelContents c = canonical.contents();
  const auto modes = static_cast<std::size_t>(m - 1);
  if (c.form != reduction::Form::canonical || m < 2 || modes > c.parameter_modes)
    throw UsageError(fmt::format("{}: {} modes of a canonical model with {} beside its lift cannot be taken",
                                 canonical.where(), m, c.parameter_modes));
  const auto keep_rows = [&](std::vector<double>& values) {
    values.resize(values.size() / c.parameter_modes * modes);
  };
  keep_rows(c.space);
  keep_rows(c.temporal);
  for (auto& functions : c.parameters) keep_rows(functions);
  c.space_modes = c.parameter_modes = modes;
  return reduction::SeparatedModel(std::move(c), canonical.where());
}

reduction::SeparatedModel with_lift_as_mode(const reduction::SeparatedModel& canonical) {
  reduction::ModelContents c = canonical.contents();
  const std::size_t n = c.dof_count(), steps = c.time.size();
  const double* last = &c.lift[(steps - 1) * n];
  double norm = 0;
  for (std::size_t i = 0; i < n; ++i) norm += last[i] * last[i];
  norm = std::sqrt(norm);
  std::vector<double> shape(last, last + n), amplitude(steps);
  for (double& v : shape) v /= norm;
  for (std::size_t t = 0; t < steps; ++t) {
    for (std::size_t i = 0; i < n; ++i) amplitude[t] += shape[i] * c.lift[t * n + i];
  }
  c.space.insert(c.space.begin(), shape.begin(), shape.end());
  c.temporal.insert(c.temporal.begin(), amplitude.begin(), amplitude.end());
  for (std::size_t k = 0; k < c.axes.size(); ++k)
    c.parameters[k].insert(c.parameters[k].begin(), c.axes[k].nodes.size(), 1.0);
  ++c.space_modes, ++c.parameter_modes;
  std::fill(c.lift.begin(), c.lift.end(), 0.0);
  return reduction::SeparatedModel(std::move(c), canonical.where());
}

}  // namespace knothe::reproduction
