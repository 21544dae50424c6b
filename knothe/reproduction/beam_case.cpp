#include "knothe/reproduction/beam_case.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <optional>

#include "knothe/base/error.hpp"
#include "knothe/base/version.hpp"
#include "knothe/mechanics/full_order/beam_simulator.hpp"
#include "knothe/reduction/compress/compression.hpp"
#include "knothe/reduction/model/parameter_functions.hpp"
#include "knothe/reduction/observe/crack_modes.hpp"
#include "knothe/reproduction/published.hpp"

namespace knothe::reproduction {
namespace {

namespace fs = std::filesystem;
constexpr std::uint64_t k_seed = 1;  // of the random starts of the decomposition

std::string law_of(const mechanics::DamageRegularisationOptions& law) {
  switch (law.kind) {
    case mechanics::DamageRegularisation::crack_band:
      return fmt::format("crack band of {} m", law.reference_size);
    case mechanics::DamageRegularisation::gradient:
      return fmt::format("internal length {} m", law.internal_length);
    case mechanics::DamageRegularisation::none:
      break;
  }
  return "local law";
}

/// Everything that the model depends on; a file with another text is of another case.
std::string description(const BeamCase& c, const std::string& form) {
  const mechanics::BeamOptions& b = c.problem.beam;
  const mechanics::SolverOptions& s = c.problem.solver;
  const std::string spring =
      c.machine_stiffness == 0 ? "" : fmt::format("behind a spring of {} N/m\n", c.machine_stiffness);
  return fmt::format(
      "{}, knothe reproduce: {}\nbeam {} x {} x {} m, element {}, layers {}, notch {} x {}, support {}, load "
      "{}, "
      "refined {}, protected {} x {}, growth {}, largest {}, {}\nE {} nu {} Y0 {} Ad {}\n{} steps to {} m, "
      "tolerance {}, {}\n{} x {} parameter grid on [0.5, 1.5]^2\n{}{}, seed {}\n",
      k_created_by, c.what, b.length, b.height, 2 * b.half_thickness, b.element, b.layers, b.notch_width,
      b.notch_depth, b.support, b.load_half_width, b.refined_half_width, b.protected_half_width,
      b.protected_depth, b.growth, b.largest_element,
      b.left_support == mechanics::LeftSupport::left_face ? "left face" : "support line",
      c.problem.elastic.young_modulus, c.problem.elastic.poisson_ratio, c.problem.reference.threshold,
      c.problem.reference.brittleness, s.steps, s.displacement, s.tolerance, law_of(s.regularisation),
      c.nodes, c.nodes, spring, form, k_seed);
}

/// The model of that file, if it is there, whole, and of this description.
std::optional<reduction::SeparatedModel> kept_model(const std::string& path, const std::string& text) {
  if (!fs::exists(path)) return std::nullopt;
  try {
    reduction::ModelContents contents = reduction::read_model(path);
    if (contents.project != text) return std::nullopt;
    return reduction::SeparatedModel(std::move(contents), path);
  } catch (const DataError&) {
    return std::nullopt;  // of another version, or spoilt: it is built again
  }
}

reduction::SeparatedModel store_model(reduction::ModelContents contents, const std::string& path,
                                      const std::string& text) {
  contents.project = text;
  reduction::write_model(contents, path);
  return reduction::SeparatedModel(std::move(contents), path);
}

std::string parts_folder(const BeamCase& chosen, const std::string& folder) {
  return (fs::path(folder) / ((chosen.runs_of.empty() ? chosen.name : chosen.runs_of) + ".parts")).string();
}

/// values −= lift + the one mode of the model.
void subtract(const reduction::ModelContents& mode, reduction::Snapshots& snapshots) {
  const std::size_t n = snapshots.dof_count(), steps = snapshots.time.size();
  const files::Shape shape = snapshots.grid_shape();
  for (std::size_t g = 0; g < snapshots.grid_size(); ++g) {
    double factor = 1;  // the last axis runs fastest
    for (std::size_t a = shape.size(), rest = g; a-- > 0; rest /= shape[a])
      factor *= mode.parameters[a][rest % shape[a]];
    for (std::size_t t = 0; t < steps; ++t) {
      double* u = &snapshots.values[(g * steps + t) * n];
      const double* lift = &mode.lift[t * n];
      const double amplitude = factor * mode.temporal[t];
      for (std::size_t i = 0; i < n; ++i) u[i] -= lift[i] + amplitude * mode.space[i];
    }
  }
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
  add("band_20", "elements and notch 5 mm, crack band of 20 mm (regularised law)");
  cases.back().problem.solver.regularisation = {mechanics::DamageRegularisation::crack_band, 0.02, 0.01};
  mechanics::BeamOptions& fine = add("elements_2", "elements and notch 2.5 mm");
  fine.element = fine.notch_width = 0.0025;
  return cases;
}

reduction::Snapshots runs_of(const BeamCase& chosen, const std::string& folder, int processes) {
  simulator::RunGrid grid;
  grid.axes = axes_of(chosen);
  grid.parts_folder = parts_folder(chosen, folder);
  grid.processes = processes;
  simulator::GridRuns runs = mechanics::run_snapshots(chosen.problem, grid);
  for (const simulator::RunSummary& run : runs.runs) {
    if (run.record.steps_without_equilibrium.empty()) continue;
    fmt::print(stderr, "knothe: {}: at ({:g}) {} steps are not in equilibrium to 1e-8\n", chosen.what,
               fmt::join(run.parameters, ", "), run.record.steps_without_equilibrium.size());
  }
  if (chosen.machine_stiffness == 0) return std::move(runs.snapshots);
  return behind_spring(std::move(runs.snapshots), chosen.machine_stiffness);
}

BeamCase with_series_spring(BeamCase chosen, double peak) {
  mechanics::FullOrderModel model = mechanics::make_full_order_model(chosen.problem);
  const mechanics::FullOrderResult run = model.run(chosen.problem.reference);
  const auto at_peak = std::max_element(run.steps.begin(), run.steps.end(), [](const auto& a, const auto& b) {
    return a.reaction_force < b.reaction_force;
  });
  const double left = peak * chosen.problem.solver.displacement - at_peak->imposed_displacement;
  if (!(left > 0))
    throw NumericalError(fmt::format("{}: the load peaks at {:.3g} m, later than {:.3g} of the loading",
                                     chosen.what, at_peak->imposed_displacement, peak));
  chosen.machine_stiffness = at_peak->reaction_force / left;
  chosen.runs_of = chosen.name;
  chosen.name += "_spring";
  chosen.what += fmt::format(", a spring of {:.3g} N/m in series", chosen.machine_stiffness);
  return chosen;
}

reduction::Snapshots behind_spring(reduction::Snapshots runs, double stiffness) {
  const std::size_t n = runs.dof_count(), steps = runs.time.size();
  const auto output = [&](const char* name) {
    for (const reduction::SnapshotOutput& o : runs.outputs)
      if (o.name == name) return o.values;
    throw DataError(fmt::format("the runs have no output {}", name));
  };
  const std::vector<double> imposed = output("imposed_displacement"), force = output("reaction_force");
  for (std::size_t g = 0; g < runs.grid_size(); ++g) {
    const double *u = &imposed[g * steps], *f = &force[g * steps];
    const auto machine = [&](std::size_t i) { return u[i] + f[i] / stiffness; };
    // Between which steps of the beam each imposed displacement is reached first; before step 0 all is 0.
    std::vector<std::size_t> upper(steps);
    std::vector<double> fraction(steps);
    for (std::size_t t = 0, i = 0; t < steps; ++t) {
      while (i + 1 < steps && machine(i) < u[t]) ++i;
      const double low = i == 0 ? 0.0 : machine(i - 1);
      upper[t] = i;
      fraction[t] = std::clamp((u[t] - low) / (machine(i) - low), 0.0, 1.0);
    }
    const auto move_along = [&](double* series, std::size_t width) {
      const std::vector<double> before(series, series + steps * width);
      for (std::size_t t = 0; t < steps; ++t)
        for (std::size_t k = 0; k < width; ++k) {
          const double low = upper[t] == 0 ? 0.0 : before[(upper[t] - 1) * width + k];
          series[t * width + k] = low + fraction[t] * (before[upper[t] * width + k] - low);
        }
    };
    move_along(&runs.values[g * steps * n], n);
    for (reduction::SnapshotOutput& o : runs.outputs)
      if (o.name != "imposed_displacement") move_along(&o.values[g * steps], 1);
  }
  const double elastic = force[0] / imposed[0];  // of the uncracked beam, whatever its parameters
  for (double& v : runs.lift) v *= stiffness / (stiffness + elastic);
  return runs;
}

reduction::CrackSolutions crack_solutions(const BeamCase& chosen, const reduction::Dofs& dofs) {
  // As modes: all lengths are kept, in the coordinates of a basis made of themselves.
  mechanics::CrackTable table = mechanics::crack_table(chosen.problem, {}, dofs);
  for (std::size_t i = 0; i < table.lengths.size() && chosen.machine_stiffness > 0; ++i) {
    const double share = chosen.machine_stiffness / (chosen.machine_stiffness + table.stiffness[i]);
    for (std::size_t k = 0; k < dofs.components.size(); ++k)
      table.values[i * dofs.components.size() + k] *= share;
  }
  return reduction::crack_modes(table.lengths, table.values);
}

std::vector<reduction::Axis> axes_of(const BeamCase& chosen) {
  const mechanics::DamageParameters& reference = chosen.problem.reference;
  return {mechanics::parameter_axis("Y0", reference.threshold, 0.5, 1.5, chosen.nodes),
          mechanics::parameter_axis("Ad", reference.brittleness, 0.5, 1.5, chosen.nodes)};
}

BeamModels prepare(const BeamCase& chosen, const std::string& folder, int processes) {
  const auto path = [&](const char* which) {
    return (fs::path(folder) / fmt::format("{}_{}.h5", chosen.name, which)).string();
  };
  const std::string paper_text = description(chosen, "canonical, lift and 5 modes");
  const std::string three_text = description(chosen, "canonical, lift and 2 modes one by one");
  const std::string best_text = description(chosen, "canonical, lift and 2 modes");
  auto paper = kept_model(path("m6"), paper_text);
  auto three = kept_model(path("m3"), three_text);
  auto best = kept_model(path("m3_best"), best_text);
  if (paper && three && best) return {chosen, std::move(*paper), std::move(*three), std::move(*best), true};
  reduction::Snapshots snapshots = runs_of(chosen, folder, processes);
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
  return {chosen, store_model(std::move(studied[1].model), path("m6"), paper_text),
          store_model(mode_by_mode(std::move(snapshots), published::k_few_modes - 1, k_seed), path("m3"),
                      three_text),
          store_model(std::move(studied[0].model), path("m3_best"), best_text), false};
}

reduction::SeparatedModel kept_or_built(const BeamCase& chosen, const std::string& folder,
                                        const std::string& name, const std::string& form,
                                        const std::function<reduction::ModelContents()>& contents) {
  const std::string path = (fs::path(folder) / fmt::format("{}_{}.h5", chosen.name, name)).string();
  const std::string text = description(chosen, form);
  if (auto kept = kept_model(path, text)) return std::move(*kept);
  return store_model(contents(), path, text);
}

reduction::SeparatedModel prepare_accurate(const BeamCase& chosen, const std::string& folder, int processes) {
  return kept_or_built(chosen, folder, "tree", "tree, 50 modes", [&] {
    const reduction::Snapshots snapshots = runs_of(chosen, folder, processes);
    reduction::CompressionOptions options;
    options.modes = std::min<std::size_t>(50, snapshots.grid_size() - 1);
    options.seed = k_seed;
    return reduction::compress(snapshots, options);
  });
}

reduction::ModelContents mode_by_mode(reduction::Snapshots snapshots, std::size_t modes, std::uint64_t seed) {
  reduction::CompressionOptions options;
  options.form = reduction::Form::canonical;
  options.modes = 1;
  options.seed = seed;
  double size = 0;
  for (const double u : snapshots.values) size += u * u;
  reduction::ModelContents model;
  for (std::size_t k = 0; k < modes; ++k) {
    reduction::ModelContents next = reduction::compress(snapshots, options);
    subtract(next, snapshots);
    if (k == 0) {
      model = std::move(next);
      snapshots.lift.assign(model.lift.size(), 0.0);  // it is taken out of the values now
      continue;
    }
    model.space.insert(model.space.end(), next.space.begin(), next.space.end());
    model.temporal.insert(model.temporal.end(), next.temporal.begin(), next.temporal.end());
    for (std::size_t a = 0; a < model.parameters.size(); ++a)
      model.parameters[a].insert(model.parameters[a].end(), next.parameters[a].begin(),
                                 next.parameters[a].end());
    ++model.space_modes, ++model.parameter_modes;
  }
  double rest = 0, largest = 0;
  for (const double u : snapshots.values) rest += u * u, largest = std::max(largest, std::abs(u));
  model.relative_error = std::sqrt(rest / size);
  model.max_error_m = largest;
  return model;
}

reduction::ModelContents fitted_to_beginning(const reduction::Snapshots& snapshots, std::size_t steps,
                                             std::size_t modes, std::uint64_t seed) {
  using Eigen::Index;
  const std::size_t n = snapshots.dof_count(), all = snapshots.time.size(), grid = snapshots.grid_size();
  reduction::Snapshots beginning = snapshots;
  beginning.outputs.clear();
  beginning.time.resize(steps);
  beginning.lift.resize(steps * n);
  beginning.values.clear();
  for (std::size_t g = 0; g < grid; ++g) {
    const double* first = &snapshots.values[g * all * n];
    beginning.values.insert(beginning.values.end(), first, first + steps * n);
  }
  reduction::CompressionOptions options;
  options.form = reduction::Form::canonical;
  options.modes = modes;
  options.seed = seed;
  reduction::ModelContents model = reduction::compress(beginning, options);
  model.time = snapshots.time;
  model.lift = snapshots.lift;
  // The modes' products of space and parameters, grid × dofs each: their time functions where they fit best.
  const auto m = static_cast<Index>(modes), dofs = static_cast<Index>(n);
  const Eigen::Map<const reduction::RowMatrix> space(model.space.data(), m, dofs);
  const files::Shape shape = snapshots.grid_shape();
  Eigen::MatrixXd factors = Eigen::MatrixXd::Ones(m, static_cast<Index>(grid));
  for (std::size_t g = 0; g < grid; ++g)
    for (std::size_t a = shape.size(), rest = g; a-- > 0; rest /= shape[a])
      for (std::size_t k = 0; k < modes; ++k)
        factors(static_cast<Index>(k), static_cast<Index>(g)) *=
            model.parameters[a][k * shape[a] + rest % shape[a]];
  const Eigen::MatrixXd gram = (space * space.transpose()).cwiseProduct(factors * factors.transpose());
  Eigen::MatrixXd projected = Eigen::MatrixXd::Zero(m, static_cast<Index>(all));
  for (std::size_t g = 0; g < grid; ++g) {
    const Eigen::Map<const reduction::RowMatrix> u(&snapshots.values[g * all * n], static_cast<Index>(all),
                                                   dofs),
        lift(snapshots.lift.data(), static_cast<Index>(all), dofs);
    projected += factors.col(static_cast<Index>(g)).asDiagonal() * (space * (u - lift).transpose());
  }
  const reduction::RowMatrix temporal = gram.ldlt().solve(projected);
  model.temporal.assign(temporal.data(), temporal.data() + temporal.size());
  return model;
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
