/// @file Beyond the paper: data of the beam itself, at parameters on the grid's nodes and between them,
/// assimilated with the uncompressed snapshots and with several decompositions of six modes.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "knothe/base/cancellation.hpp"
#include "knothe/base/progress.hpp"
#include "knothe/mechanics/full_order/offline.hpp"
#include "knothe/mechanics/latin/latin_model.hpp"
#include "knothe/reduction/observe/observation_operator.hpp"
#include "knothe/reproduction/figure_parts.hpp"
#include "knothe/reproduction/published.hpp"
#include "knothe/reproduction/study.hpp"

namespace knothe::reproduction {
namespace {

/// (Y₀, A_d): nodes of the grid, then centres between four of them, as far from all nodes as can be.
constexpr double k_truths[][2] = {{1, 1},           {0.9375, 1.0625}, {1.1875, 0.8125}, {1.125, 0.875},
                                  {0.8125, 1.1875}, {1.0625, 1.1875}, {0.6875, 0.9375}};
constexpr std::size_t k_quick_truths = 3;

/// A model of the beam, and whether it is one of the decompositions of six modes.
struct Candidate {
  std::string name;
  reduction::SeparatedModel model;
  bool is_six = true;
};

/// The snapshots at these dofs, compressed by rounding alone: all modes that there are.
reduction::ModelContents uncompressed(const reduction::Snapshots& runs, std::span<const std::size_t> dofs) {
  reduction::Snapshots seen;
  seen.axes = runs.axes;
  seen.time = runs.time;
  for (const std::size_t dof : dofs) seen.dofs.add(runs.dofs.point(dof), runs.dofs.components[dof]);
  const std::size_t n = runs.dof_count();
  for (std::size_t row = 0; row < runs.grid_size() * runs.time.size(); ++row)
    for (const std::size_t dof : dofs) seen.values.push_back(runs.values[row * n + dof]);
  for (std::size_t row = 0; row < runs.time.size(); ++row)
    for (const std::size_t dof : dofs) seen.lift.push_back(runs.lift[row * n + dof]);
  reduction::CompressionOptions options;
  options.modes = seen.grid_size();
  return reduction::compress(seen, options);
}

/// The first is the judge of the others.
std::vector<Candidate> candidates(const Subject& subject, const StudyOptions& options) {
  const BeamCase& chosen = subject.models.chosen;
  std::optional<reduction::Snapshots> loaded;
  const auto runs = [&]() -> reduction::Snapshots& {
    if (!loaded) loaded = runs_of(chosen, options.models_folder, options.processes);
    return *loaded;
  };
  const auto built = [&](const std::string& name, const std::string& form, const auto& contents) {
    return kept_or_built(chosen, options.models_folder, name, form, contents);
  };
  const std::size_t modes = published::k_modes - 1;  // beside the lift
  std::vector<Candidate> all;
  all.push_back({"uncompressed snapshots",
                 built(fmt::format("sensors_{}", options.seed),
                       fmt::format("uncompressed, sensors of seed {}", options.seed),
                       [&] { return uncompressed(runs(), random_dofs(runs().dofs, options.seed)); }),
                 false});
  all.push_back(
      {"tree form, 50 modes", prepare_accurate(chosen, options.models_folder, options.processes), false});
  all.push_back({"m = 6, best of four starts", subject.models.paper});
  for (std::uint64_t start = 1; start <= (options.quick ? 2 : 4); ++start) {
    check_cancellation("the models that were built are kept: the same command goes on from there");
    all.push_back({fmt::format("m = 6, random start {}", start),
                   built(fmt::format("m6_start_{}", start),
                         fmt::format("canonical, lift and 5 modes, random start {}", start), [&] {
                           reduction::CompressionOptions one;
                           one.form = reduction::Form::canonical;
                           one.modes = modes;
                           one.seed = 100 * start;
                           one.grown_start = false;
                           one.random_starts = 1;
                           return reduction::compress(runs(), one);
                         })});
  }
  all.push_back({"m = 6, LATIN-PGD", built("m6_latin", "LATIN, lift and 5 modes", [&] {
                   const mechanics::LatinModel latin =
                       mechanics::solve_latin_grid(chosen.problem, axes_of(chosen), {});
                   reduction::CompressionOptions canonical;
                   canonical.form = reduction::Form::canonical;
                   canonical.modes = modes;
                   return reduction::compress(latin.grid, canonical);
                 })});
  all.push_back({"m = 6, mode by mode", built("m6_greedy", "canonical, lift and 5 modes one by one",
                                              [&] { return mode_by_mode(std::move(runs()), modes, 1); })});
  all.push_back({"m = 3, two best modes", subject.models.three_best, false});
  all.push_back({"m = 3", subject.models.three, false});
  return all;
}

/// One truth, assimilated with one model.
struct TruthOutcome {
  double error = 0;             ///< of the model at the truth, largest on any sensor at any step, m
  double last = 0, worst = 0;   ///< truth off by, std
  double shift = 0, moved = 0;  ///< of the mean from the judge's, in its std: worst step, last step
  double narrower = 0;          ///< last std over the judge's, the parameter where it differs more
  double nats = 0;              ///< log-evidence beyond the judge's
  std::vector<double> by_step;  ///< shift of the mean
  std::string estimates[2];
};

TruthOutcome outcome_of(const Run& run, const Run& judge, const Eigen::VectorXd& truth) {
  TruthOutcome o;
  o.last = std::max(run.off_by(0, truth[0]), run.off_by(1, truth[1]));
  o.worst = run.worst_off(truth).std;
  o.narrower = 1;
  for (std::size_t i = 0; i < run.steps.size(); ++i) {
    double shift = 0;
    for (Index k = 0; k < 2; ++k)
      shift = std::max(shift, std::abs(run.steps[i].mean[k] - judge.steps[i].mean[k]) / judge.std_at(i, k));
    o.by_step.push_back(shift);
  }
  o.shift = *std::max_element(o.by_step.begin(), o.by_step.end());
  o.moved = o.by_step.back();
  for (Index k = 0; k < 2; ++k) {
    const double ratio = run.std(k) / judge.std(k);
    if (std::abs(std::log(ratio)) > std::abs(std::log(o.narrower))) o.narrower = ratio;
    o.estimates[k] = with_uncertainty(run.mean(k), run.std(k));
  }
  o.nats = run.last().log_evidence - judge.last().log_evidence;
  return o;
}

bool is_node(const std::vector<reduction::Axis>& axes, const Eigen::VectorXd& p) {
  for (std::size_t k = 0; k < axes.size(); ++k)
    if (std::none_of(axes[k].nodes.begin(), axes[k].nodes.end(),
                     [&](double node) { return std::abs(node - p[static_cast<Index>(k)]) < 1e-9; }))
      return false;
  return true;
}

struct DecompositionStudy {
  std::vector<Eigen::VectorXd> truths;
  std::vector<bool> on_node;
  std::vector<Candidate> models;
  std::vector<std::vector<TruthOutcome>> outcomes;  ///< model × truth

  /// The values of a model at the truths that are nodes, or that are none.
  [[nodiscard]] std::vector<double> values(std::size_t model, double TruthOutcome::*what, bool nodes) const {
    std::vector<double> all;
    for (std::size_t i = 0; i < truths.size(); ++i)
      if (on_node[i] == nodes) all.push_back(outcomes[model][i].*what);
    return all;
  }
  [[nodiscard]] double most(std::size_t model, double TruthOutcome::*what) const {
    double largest = 0;
    for (const TruthOutcome& o : outcomes[model]) largest = std::max(largest, o.*what);
    return largest;
  }
};

DecompositionStudy study_of(const Subject& subject, const StudyOptions& options) {
  DecompositionStudy study;
  const BeamCase& chosen = subject.models.chosen;
  study.models = candidates(subject, options);
  std::vector<std::shared_ptr<const reduction::ObservedModel>> seen;
  for (const Candidate& c : study.models) seen.push_back(observed(c.model, subject.sensors));
  study.outcomes.resize(study.models.size());
  mechanics::FullOrderModel full = mechanics::make_full_order_model(chosen.problem);
  const std::vector<reduction::Axis> axes = axes_of(chosen);
  const reduction::ModelContents& c = subject.models.paper.contents();
  const reduction::ObservationOperator operation(c.dofs, c.mesh, "the beam", subject.sensors);
  const std::size_t count = options.quick ? k_quick_truths : std::size(k_truths);
  Progress progress("decompositions", count);
  for (std::size_t i = 0; i < count; ++i) {
    check_cancellation("the models that were built are kept: the same command goes on from there");
    const Eigen::VectorXd truth = Eigen::Map<const Eigen::Vector2d>(k_truths[i]);
    const mechanics::FullOrderResult run =
        full.run(mechanics::damage_parameters(chosen.problem, axes, k_truths[i]));
    const Eigen::MatrixXd exact = operation.apply(Eigen::Map<const Eigen::MatrixXd>(
        run.displacement.data(), static_cast<Index>(c.dof_count()), static_cast<Index>(c.time.size())));
    const assimilation::Measurements data = measure(exact, subject.sensors, c.time, options.seed + i);
    RunOptions run_options;
    run_options.update = default_options(options.seed);
    std::optional<Run> judge;
    for (std::size_t m = 0; m < study.models.size(); ++m) {
      const Run assimilated = assimilate(seen[m], data, run_options);
      if (!judge) judge = assimilated;
      study.outcomes[m].push_back(outcome_of(assimilated, *judge, truth));
      study.outcomes[m].back().error = (predicted(*seen[m], truth) - exact).cwiseAbs().maxCoeff();
    }
    study.truths.push_back(truth);
    study.on_node.push_back(is_node(axes, truth));
    progress.advance_to(i + 1);
  }
  return study;
}

std::string range(const std::vector<double>& values) {
  const auto [least, most] = std::minmax_element(values.begin(), values.end());
  const std::string low = readable(*least, 2), high = readable(*most, 2);
  return low == high ? low : low + " to " + high;
}

Table estimates_table(const DecompositionStudy& study) {
  Table table;
  table.caption =
      "Data of the full-order model at (1, 1) in place of data of m = 6: what truncation does to a real "
      "assimilation, which the paper's own test cannot show.";
  table.header = {"model that assimilates",
                  "Y₀",
                  "A_d",
                  "truth off by, std",
                  "std over that of the snapshots",
                  "log-evidence beyond the snapshots'"};
  for (std::size_t m = 0; m < study.models.size(); ++m) {
    const TruthOutcome& o = study.outcomes[m].front();
    table.rows.push_back({study.models[m].name, o.estimates[0], o.estimates[1], readable(o.last, 2),
                          readable(o.narrower, 2), fmt::format("{:+.1f}", o.nats)});
  }
  return table;
}

Table truths_table(const DecompositionStudy& study) {
  Table table;
  table.caption = fmt::format(
      "{} truths, {} of them nodes of the grid, the others half-way between nodes in both directions. "
      "\"Mean moved\" is from that of the uncompressed snapshots, in their std, largest over the truths.",
      study.truths.size(), std::count(study.on_node.begin(), study.on_node.end(), true));
  table.header = {"model that assimilates", "error at the sensors, µm: nodes, between",
                  "truth off by at the end, std: nodes, between", "at the worst step: nodes, between",
                  "mean moved at the worst step, at the end, std"};
  for (std::size_t m = 0; m < study.models.size(); ++m) {
    const auto both = [&](double TruthOutcome::*what, double unit) {
      std::vector<double> nodes = study.values(m, what, true), between = study.values(m, what, false);
      for (std::vector<double>* all : {&nodes, &between})
        for (double& v : *all) v = unit * v < 1e-6 ? 0.0 : unit * v;
      return range(nodes) + ", " + range(between);
    };
    table.rows.push_back({study.models[m].name, both(&TruthOutcome::error, 1e6), both(&TruthOutcome::last, 1),
                          both(&TruthOutcome::worst, 1),
                          readable(study.most(m, &TruthOutcome::shift), 2) + ", " +
                              readable(study.most(m, &TruthOutcome::moved), 2)});
  }
  return table;
}

Figure shift_figure(const DecompositionStudy& study, std::size_t truth) {
  Plot plot("How far the mean is from that of the uncompressed snapshots", {"step"},
            {"shift of the mean, std", {}, {}, true});
  std::vector<double> steps;
  for (std::size_t t = 0; t < study.outcomes[0][truth].by_step.size(); ++t)
    steps.push_back(static_cast<double>(t));
  for (std::size_t m = 1; m < study.models.size(); ++m) {
    std::vector<double> y = study.outcomes[m][truth].by_step;
    for (double& v : y) v = std::max(v, 1e-3);
    plot.line(steps, y, Paint::series(static_cast<int>(m) - 1), study.models[m].name);
  }
  return report::figure_of(std::move(plot), "Shift of the mean over the steps", 380.0);
}

}  // namespace

FigureRecord decompositions(const Subject& subject, const StudyOptions& options) {
  FigureRecord record{"models", "Data of the beam itself, and what six modes are", "", {}, {}, {}, {}};
  record.setting = fmt::format(
      "Not in the paper, whose data are of the model that assimilates them. Here the full-order model makes "
      "the data: the same 60 dofs, white noise of 1 µm. They are assimilated with the uncompressed snapshots "
      "({} runs, splines between them), and with several separated models of them: six modes from several "
      "starts of alternating least squares (the first mode being the elastic solution), from LATIN-PGD's "
      "solution, and found one after the other.",
      subject.models.chosen.nodes * subject.models.chosen.nodes);
  const DecompositionStudy study = study_of(subject, options);
  const auto off_grid = std::find(study.on_node.begin(), study.on_node.end(), false);
  const auto shown = static_cast<std::size_t>(off_grid - study.on_node.begin());
  record.panels.push_back({{shift_figure(study, shown)},
                           fmt::format("Data of the beam at ({:g}, {:g}), between the nodes of the grid.",
                                       study.truths[shown][0], study.truths[shown][1])});
  record.tables = {estimates_table(study), truths_table(study)};

  const auto off = [&](std::size_t m, bool nodes) { return study.values(m, &TruthOutcome::last, nodes); };
  const auto largest = [](const std::vector<double>& v) { return *std::max_element(v.begin(), v.end()); };
  record.rows.push_back(
      {"uncompressed snapshots: truth off by at the end, on nodes and between",
       "std",
       "not done",
       range(off(0, true)) + " and " + range(off(0, false)),
       fmt::format("At (1, 1) they give {} and {}. Between the nodes the splines are off by up to {} µm.",
                   study.outcomes[0][0].estimates[0], study.outcomes[0][0].estimates[1],
                   readable(1e6 * largest(study.values(0, &TruthOutcome::error, false)), 2)),
       {},
       largest(off(0, false))});
  std::vector<double> moved, worst, errors;
  std::vector<std::string> excluded;
  for (std::size_t m = 0; m < study.models.size(); ++m) {
    if (!study.models[m].is_six) continue;
    moved.push_back(study.most(m, &TruthOutcome::moved));
    worst.push_back(study.most(m, &TruthOutcome::shift));
    errors.push_back(study.models[m].model.contents().relative_error);
    if (largest(off(m, true)) > 2.5 || largest(off(m, false)) > 2.5) excluded.push_back(study.models[m].name);
  }
  record.rows.push_back(
      {fmt::format("{} decompositions of m = 6: largest shift of the mean at the end", moved.size()),
       "std",
       "one decomposition",
       range(moved),
       fmt::format("At the worst step {}. Their errors are alike, {}: what the modes leave out, not how much "
                   "of it, decides. At some truth the answer is more than 2.5 std off at the end with {}.",
                   range(worst), range(errors),
                   excluded.empty() ? std::string("none") : fmt::format("{}", fmt::join(excluded, "; "))),
       {},
       *std::max_element(moved.begin(), moved.end())});
  record.rows.push_back({"tree form, 50 modes: largest shift of the mean, worst step and end",
                         "std",
                         "not done",
                         readable(study.most(1, &TruthOutcome::shift), 2) + " and " +
                             readable(study.most(1, &TruthOutcome::moved), 2),
                         "What is left then is the grid, not the modes.",
                         {},
                         study.most(1, &TruthOutcome::moved)});
  for (std::size_t m = 0; m < study.models.size(); ++m) {
    std::vector<double> error, last, shift;
    for (const TruthOutcome& o : study.outcomes[m])
      error.push_back(1e6 * o.error), last.push_back(o.last), shift.push_back(o.shift);
    record.data.emplace_back("error_um, " + study.models[m].name, error);
    record.data.emplace_back("truth_off_by_std, " + study.models[m].name, last);
    record.data.emplace_back("worst_shift_std, " + study.models[m].name, shift);
  }
  record.data.emplace_back("truth_is_node", std::vector<double>(study.on_node.begin(), study.on_node.end()));
  return record;
}

}  // namespace knothe::reproduction
