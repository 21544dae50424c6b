/// @file When a bias begins decides what its correction is worth: the model is right until a step, from which
/// on a field grows that it does not know; uncorrected, corrected at every step, and from the alarm on
/// (§4.3).
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "knothe/base/progress.hpp"
#include "knothe/numerics/statistics/order_statistics.hpp"
#include "knothe/reproduction/bias.hpp"
#include "knothe/reproduction/figure_parts.hpp"
#include "knothe/reproduction/study.hpp"

namespace knothe::reproduction {
namespace {

using assimilation::BiasCorrectionMode;
using numerics::quantile;
using Way = assimilation::BiasOptions::Way;

constexpr std::array<Index, 5> k_onsets = {15, 25, 35, 50, 65};  ///< steps of 100
constexpr Index k_ramp = 20;  ///< steps of 100 until the bias is there in full
constexpr double k_size = 3;  ///< times what m = 6 adds to m = 3 where that is largest
constexpr int k_joint_draws = 10, k_quick_joint_draws = 2;  ///< the joint correction takes a second and more

struct Treatment {
  const char* name;
  BiasCorrectionMode mode;
  Way way;
};
constexpr std::array<Treatment, 6> k_treatments = {
    {{"uncorrected", BiasCorrectionMode::off, Way::joint},
     {"published", BiasCorrectionMode::on, Way::published},
     {"linear", BiasCorrectionMode::on, Way::modes},
     {"joint", BiasCorrectionMode::on, Way::joint},
     {"published, from the alarm", BiasCorrectionMode::automatic, Way::published},
     {"linear, from the alarm", BiasCorrectionMode::automatic, Way::modes}}};

/// What came of all draws of noise and nodes with one onset and one treatment.
struct Outcomes {
  std::vector<double> worst;    ///< largest distance of the truth from the mean after the onset, std
  std::vector<double> last;     ///< … at the end, the larger of both parameters
  std::vector<double> nats;     ///< log-evidence above that of the uncorrected run
  std::vector<double> alarmed;  ///< step at which the correction came on; of the runs in which it did
  double square_error = 0;      ///< mean square of the last error of A_d
};

/// What the model with m = 3 predicts, and from `onset` on, more and more, a field of one shape: what m = 6
/// adds to m = 3 where that is largest.
Eigen::MatrixXd ramped(const Eigen::MatrixXd& few, const Eigen::MatrixXd& many, Index onset) {
  const Eigen::MatrixXd left_out = many - few;
  Index largest = 0;
  left_out.colwise().squaredNorm().maxCoeff(&largest);
  const double ramp = static_cast<double>(k_ramp * few.cols()) / 100;
  Eigen::MatrixXd exact = few;
  for (Index t = onset; t < few.cols(); ++t)
    exact.col(t) += k_size * std::min(1.0, static_cast<double>(t - onset + 1) / ramp) * left_out.col(largest);
  return exact;
}

double worst_after(const Run& run, const Eigen::VectorXd& truth, Index onset) {
  double worst = 0;
  for (auto i = static_cast<std::size_t>(onset); i < run.steps.size(); ++i)
    for (Index k = 0; k < truth.size(); ++k)
      worst = std::max(worst, std::abs(run.steps[i].mean[k] - truth[k]) / run.std_at(i, k));
  return worst;
}

void add(Outcomes& outcomes, const Run& run, const Eigen::VectorXd& truth, Index onset, double uncorrected) {
  outcomes.worst.push_back(worst_after(run, truth, onset));
  outcomes.last.push_back(std::max(run.off_by(0, truth[0]), run.off_by(1, truth[1])));
  outcomes.nats.push_back(run.last().log_evidence - uncorrected);
  const double error = run.mean(1) - truth[1];
  outcomes.square_error +=
      (error * error - outcomes.square_error) / static_cast<double>(outcomes.last.size());
  for (std::size_t i = 0; i < run.steps.size(); ++i) {
    if (!run.steps[i].bias_corrected) continue;
    outcomes.alarmed.push_back(static_cast<double>(run.steps[i].step));
    break;
  }
}

using AtOnset = std::array<Outcomes, k_treatments.size()>;
using Onsets = std::array<AtOnset, k_onsets.size()>;

bool is_joint(const Treatment& treatment) {
  return treatment.mode != BiasCorrectionMode::off && treatment.way == Way::joint;
}

int joint_draws(const StudyOptions& options) {
  return std::min(options.repetitions, options.quick ? k_quick_joint_draws : k_joint_draws);
}

Onsets all_runs(const Subject& subject, const StudyOptions& options) {
  Onsets study;
  Progress progress("onset of a bias", static_cast<std::size_t>(options.repetitions));
  for (int i = 0; i < options.repetitions; ++i) {
    const std::uint64_t seed = options.seed + 5000 + static_cast<std::uint64_t>(i);
    const Sensors sensors = random_nodes(subject.models.paper, seed);
    const auto model = observed(subject.models.three, sensors);
    const Eigen::MatrixXd few = predicted(*model, subject.truth);
    const Eigen::MatrixXd many = predicted(*observed(subject.models.paper, sensors), subject.truth);
    for (std::size_t a = 0; a < k_onsets.size(); ++a) {
      const Index onset = k_onsets[a] * few.cols() / 100;
      const assimilation::Measurements data = measure(ramped(few, many, onset), sensors, model->time, seed);
      double uncorrected = 0;
      for (std::size_t b = 0; b < k_treatments.size(); ++b) {
        if (is_joint(k_treatments[b]) && i >= joint_draws(options)) continue;
        RunOptions run_options;
        run_options.update = corrected_options(k_treatments[b].mode, k_treatments[b].way, seed);
        const Run run = assimilate(model, data, run_options);
        if (b == 0) uncorrected = run.last().log_evidence;
        add(study[a][b], run, subject.truth, onset, uncorrected);
      }
    }
    progress.advance_to(static_cast<std::size_t>(i) + 1);
  }
  return study;
}

/// The treatments of a model that was fitted to what comes before the crack has run (k_early), with data of
/// m = 6: uncorrected, published, linear.
constexpr Index k_early = 40;  ///< steps of 100
using Early = std::array<Outcomes, 3>;

Early early_runs(const Subject& subject, const StudyOptions& options) {
  const BeamCase& chosen = subject.models.chosen;
  const auto steps = subject.models.paper.contents().time.size();
  const std::size_t beginning = static_cast<std::size_t>(k_early) * steps / 100;
  const reduction::SeparatedModel early =
      kept_or_built(chosen, options.models_folder, "m3_early",
                    fmt::format("canonical, lift and 2 modes, {} steps", beginning), [&] {
                      return fitted_to_beginning(runs_of(chosen, options.models_folder, options.processes),
                                                 beginning, published::k_few_modes - 1, 1);
                    });
  Early study;
  for (int i = 0; i < options.repetitions; ++i) {
    const std::uint64_t seed = options.seed + 6000 + static_cast<std::uint64_t>(i);
    const Sensors sensors = random_nodes(subject.models.paper, seed);
    const auto model = observed(early, sensors);
    const assimilation::Measurements data = measure(
        predicted(*observed(subject.models.paper, sensors), subject.truth), sensors, model->time, seed);
    double uncorrected = 0;
    for (std::size_t b = 0; b < study.size(); ++b) {
      RunOptions run_options;
      run_options.update = corrected_options(k_treatments[b].mode, k_treatments[b].way, seed);
      const Run run = assimilate(model, data, run_options);
      if (b == 0) uncorrected = run.last().log_evidence;
      add(study[b], run, subject.truth, static_cast<Index>(beginning), uncorrected);
    }
  }
  return study;
}

std::vector<double> medians(const Onsets& study, std::size_t treatment, std::vector<double> Outcomes::*what,
                            double level = 0.5) {
  std::vector<double> values;
  for (const auto& at_onset : study) values.push_back(quantile(at_onset[treatment].*what, level));
  return values;
}

Plot onset_plot(const Onsets& study, const char* title, std::vector<double> Outcomes::*what,
                std::size_t first, std::size_t last) {
  Plot plot(title, {"step at which the bias begins"}, {"truth off by, std", {}, {}, true});
  const std::vector<double> x(k_onsets.begin(), k_onsets.end());
  for (std::size_t b = 0; b < k_treatments.size(); ++b) {
    if (b != 0 && (b < first || b > last)) continue;
    const Paint paint = Paint::series(static_cast<int>(b < 4 ? b : b - 3));
    plot.band(x, medians(study, b, what, 0.05), medians(study, b, what, 0.95), paint, "", 0.12);
    plot.line(x, medians(study, b, what), paint, k_treatments[b].name);
    plot.scatter(x, medians(study, b, what), paint);
  }
  return plot;
}

Figure onset_figure(const Onsets& study) {
  Figure figure{"Onset of a bias against the error of the estimate", {}};
  figure.columns = 2;
  figure.plots = {onset_plot(study, "Worst step after the onset, corrected always", &Outcomes::worst, 1, 3),
                  onset_plot(study, "Worst step, corrected from the alarm on", &Outcomes::worst, 4, 5),
                  onset_plot(study, "Last step, corrected always", &Outcomes::last, 1, 3),
                  onset_plot(study, "Last step, corrected from the alarm on", &Outcomes::last, 4, 5)};
  return figure;
}

/// Median, and the range of the middle 90 %.
std::string range(const std::vector<double>& v) {
  return fmt::format("{} ({} to {})", readable(quantile(v, 0.5), 2), readable(quantile(v, 0.05), 2),
                     readable(quantile(v, 0.95), 2));
}

Table early_table(const Early& study, const StudyOptions& options) {
  Table table;
  table.caption = fmt::format(
      "A model with m = 3 fitted to the first {} steps, of which later steps have the time functions alone; "
      "data of m = 6. Medians over {} draws of noise and nodes; in brackets the range of the middle 90 %.",
      k_early, options.repetitions);
  table.header = {"correction", fmt::format("worst after step {}, std", k_early), "last, std",
                  "error of A_d, rms, %", "evidence, nats"};
  for (std::size_t b = 0; b < study.size(); ++b)
    table.rows.push_back({k_treatments[b].name, range(study[b].worst), range(study[b].last),
                          readable(100 * std::sqrt(study[b].square_error), 2),
                          b == 0 ? "0" : fmt::format("{:+.0f}", quantile(study[b].nats, 0.5))});
  return table;
}

Table onset_table(const Onsets& study, const StudyOptions& options) {
  Table table;
  table.caption = fmt::format(
      "Medians over {} draws of noise and nodes (joint: {}); in brackets the range of the middle 90 %.",
      options.repetitions, joint_draws(options));
  table.header = {"bias from step",       "correction",     "worst after it, std",       "last, std",
                  "error of A_d, rms, %", "evidence, nats", "came on: runs, median step"};
  for (std::size_t a = 0; a < k_onsets.size(); ++a) {
    for (std::size_t b = 0; b < k_treatments.size(); ++b) {
      const Outcomes& o = study[a][b];
      const bool automatic = k_treatments[b].mode == BiasCorrectionMode::automatic;
      table.rows.push_back(
          {fmt::format("{}", k_onsets[a]), k_treatments[b].name, range(o.worst), range(o.last),
           readable(100 * std::sqrt(o.square_error), 2),
           b == 0 ? "0" : fmt::format("{:+.0f}", quantile(o.nats, 0.5)),
           automatic ? fmt::format("{}{}", o.alarmed.size(),
                                   o.alarmed.empty() ? "" : fmt::format(", {:.0f}", quantile(o.alarmed, 0.5)))
                     : ""});
    }
  }
  return table;
}

}  // namespace

FigureRecord bias_onset(const Subject& subject, const StudyOptions& options) {
  FigureRecord record{"onset", "When the bias begins", "", {}, {}, {}, {}};
  record.setting = fmt::format(
      "Not in the paper. The model with m = 3 is exact until a step. From there on a field of one shape is "
      "added to the data, {:.0f} times what m = 6 adds to m = 3 where that is largest; it is there in full "
      "after {} steps. Uncorrected; corrected at every step, to the letter of Eq. 16-20 (published), with "
      "what "
      "the modes were off by in the covariance (linear), and jointly; and the first two from the alarm on, "
      "what was assimilated since the drift began being assimilated again (§4.3).",
      k_size, k_ramp);
  const Onsets study = all_runs(subject, options);
  record.panels.push_back({{onset_figure(study)},
                           "Distance of the truth from the mean, the worse parameter: median over the draws, "
                           "and the range of the middle 90 %."});
  const Early early = early_runs(subject, options);
  record.tables = {onset_table(study, options), early_table(early, options)};
  const auto row = [&](std::size_t onset, std::size_t treatment) {
    const Outcomes& o = study[onset][treatment];
    const double last = quantile(o.last, 0.5), before = quantile(study[onset][0].last, 0.5);
    record.rows.push_back(
        {fmt::format("bias from step {}, {}: truth off by at the end", k_onsets[onset],
                     k_treatments[treatment].name),
         "std",
         "not done",
         readable(last, 2),
         fmt::format("Uncorrected {}. At the worst step after the onset {}, uncorrected {}.",
                     readable(before, 2), readable(quantile(o.worst, 0.5), 2),
                     readable(quantile(study[onset][0].worst, 0.5), 2)),
         {},
         last});
  };
  record.rows.push_back(
      {fmt::format("m = 3 fitted to steps before {}: truth off by at the end, uncorrected and published",
                   k_early),
       "std",
       "not done",
       fmt::format("{} and {}", readable(quantile(early[0].last, 0.5), 2),
                   readable(quantile(early[1].last, 0.5), 2)),
       fmt::format(
           "At the worst step after it {} and {}. The parameters are identified before the model fails.",
           readable(quantile(early[0].worst, 0.5), 2), readable(quantile(early[1].worst, 0.5), 2)),
       {},
       quantile(early[1].last, 0.5)});
  for (const std::size_t onset : {std::size_t{1}, std::size_t{2}, std::size_t{3}})
    for (std::size_t treatment = 1; treatment < 4; ++treatment) row(onset, treatment);
  record.data.emplace_back("onset", std::vector<double>(k_onsets.begin(), k_onsets.end()));
  for (std::size_t b = 0; b < k_treatments.size(); ++b) {
    for (const auto& [name, level] : {std::pair{"low", 0.05}, {"median", 0.5}, {"high", 0.95}}) {
      record.data.emplace_back(fmt::format("worst_{}_{}", name, k_treatments[b].name),
                               medians(study, b, &Outcomes::worst, level));
      record.data.emplace_back(fmt::format("last_{}_{}", name, k_treatments[b].name),
                               medians(study, b, &Outcomes::last, level));
    }
  }
  return record;
}

}  // namespace knothe::reproduction
