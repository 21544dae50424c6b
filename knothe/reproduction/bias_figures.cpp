/// @file Fig. 14 and 15: a model with too few modes, and its correction.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "knothe/reproduction/bias.hpp"
#include "knothe/reproduction/figure_parts.hpp"
#include "knothe/reproduction/published.hpp"
#include "knothe/reproduction/study.hpp"

namespace knothe::reproduction {
namespace {

constexpr std::size_t k_smoothing = 10;

double total(const Run& run) {
  return run.last().log_evidence;
}

Figure evidence_figure(const BiasRuns& runs) {
  Figure figure{"Model evidence", {}};
  figure.columns = 2;
  Plot increments("Evidence of each step, smoothed", {"step"}, {"log-evidence of a datum"});
  Plot balance("Accumulated against the reference", {"step"}, {"log Bayes factor for m = 6"});
  const std::vector<double> x = step_numbers(runs.reference);
  const std::vector<double> of_reference = evidence_increments(runs.reference);
  const std::pair<const char*, const Run*> shown[] = {{"m = 6 (reference)", &runs.reference},
                                                      {"m = 3, uncorrected", &runs.biased},
                                                      {"m = 3, corrected (published)", &runs.published},
                                                      {"m = 3, corrected (linear)", &runs.corrected},
                                                      {"m = 3, corrected (joint)", &runs.joint}};
  int colour = 0;
  for (const auto& [label, run] : shown) {
    const std::vector<double> values = evidence_increments(*run);
    increments.line(x, smoothed(values, k_smoothing), Paint::series(colour), label);
    std::vector<double> sum;
    double so_far = 0;
    for (std::size_t i = 0; i < values.size(); ++i) sum.push_back(so_far += of_reference[i] - values[i]);
    if (run != &runs.reference) balance.line(x, sum, Paint::series(colour), label);
    ++colour;
  }
  balance.horizontal(0, Paint::faint());
  figure.plots = {increments, balance};
  return figure;
}

std::string estimates(const Run& run) {
  return fmt::format("Y₀ {}, A_d {}", with_uncertainty(run.mean(0), run.std(0)),
                     with_uncertainty(run.mean(1), run.std(1)));
}

/// "12 at step 24": how far the truth is from the mean, in standard deviations.
std::string distance(const Run& run, const Eigen::VectorXd& truth) {
  const Run::Distance worst = run.worst_off(truth);
  return fmt::format("{} at step {}", report::readable(worst.std, 2), worst.step);
}

std::string last_distances(const Run& run, const Eigen::VectorXd& truth) {
  return fmt::format("at the end {} and {}", report::readable(run.off_by(0, truth[0]), 2),
                     report::readable(run.off_by(1, truth[1]), 2));
}

/// Mean difference of the evidence of a datum over the steps [from, to).
double gain(const Run& better, const Run& worse, std::size_t from, std::size_t to) {
  double sum = 0;
  for (std::size_t i = from; i < to; ++i)
    sum += better.steps[i].log_evidence_increment - worse.steps[i].log_evidence_increment;
  return to > from ? sum / static_cast<double>(to - from) : 0;
}

}  // namespace

FigureRecord figures_14_15(const Subject& subject, const StudyOptions& options) {
  FigureRecord record{"14-15", "A model that is wrong, and its correction", "", {}, {}, {}, {}};
  record.setting =
      "As for Fig. 9, data from m = 6. The model that assimilates them has m = 3 modes, found one after the "
      "other as in "
      "the paper; the table has the two best modes too. Corrected: mean and standard deviation of the "
      "residual at the 60 "
      "dofs, two modes of each, extrapolated linearly, to the letter (Eq. 16-20, `published`) and with what "
      "the modes were off by lately added to the covariance (`linear`). Besides, knothe's own correction, "
      "in which the discrepancy is unknown together with the parameters.";
  const auto in_all_ways = [&](const reduction::SeparatedModel& few, bool marginals) {
    return bias_runs(subject.models.paper, few, subject.sensors, subject.data, options.seed, marginals, true);
  };
  const BiasRuns runs = in_all_ways(subject.models.three, true);
  const BiasRuns best = in_all_ways(subject.models.three_best, false);
  record.panels.push_back({{marginals_figure(runs.biased, subject.truth, "m = 3, uncorrected", 4)},
                           "Fig. 14: without correction the marginals end beside the truth."});
  record.panels.push_back(
      {{marginals_figure(runs.published, subject.truth, "m = 3, corrected as published", 4)},
       "Fig. 15, left and centre: corrected by the extrapolated residual, Eq. 16-20 to the letter."});
  record.panels.push_back(
      {{marginals_figure(runs.corrected, subject.truth, "m = 3, corrected (linear)", 4)},
       "The same with what the extrapolated modes were off by lately added to the covariance."});
  record.panels.push_back(
      {{marginals_figure(runs.joint, subject.truth, "m = 3, joint correction", 4)},
       "Beyond the paper: the discrepancy integrated out. Wide where data and model cannot tell."});
  record.panels.push_back(
      {{evidence_figure(runs)},
       "Fig. 15, right: evidence of each datum, moving average over ten steps, and its sum "
       "against the reference (above zero: m = 6 explains the data better)."});
  const Eigen::VectorXd& p = subject.truth;
  const auto row = [&](const std::string& quantity, const std::string& paper, const Run& run,
                       const Run& other, const std::string& why) {
    record.rows.push_back({quantity,
                           "std",
                           paper,
                           distance(run, p) + ", " + last_distances(run, p),
                           &run == &other
                               ? fmt::format("Last: {}.", estimates(run))
                               : fmt::format("Last: {}. With the two best modes: {}, {}.{}", estimates(run),
                                             distance(other, p), last_distances(other, p), why),
                           {},
                           run.worst_off(p).std});
  };
  row("m = 6: largest distance of the truth from the mean, Y₀ and A_d", "the reference", runs.reference,
      runs.reference, "");
  row("m = 3: the same", "shifted marginals, means do not converge", runs.biased, best.biased, "");
  row("m = 3, corrected to the letter of Eq. 16-20: the same", "effect of the bias eliminated",
      runs.published, best.published,
      " A residual at the last posterior confirms the estimate it was made with: what the parameters have "
      "wrongly "
      "explained is not in it. The paper shows one draw; the next section says when the correction helps.");
  row("m = 3, corrected, the modes' error in the covariance: the same", "not in the paper", runs.corrected,
      best.corrected, " docs/explanation/assimilation.md has the coverage over 30 truths.");
  row("m = 3, joint correction: the same", "not in the paper", runs.joint, best.joint,
      " It says how little is known where bias and parameters look alike.");
  const auto three = observed(subject.models.three, subject.sensors);
  RunOptions uncorrected;
  uncorrected.update = default_options(options.seed);
  const Run control =
      assimilate(three,
                 less_true_residual(*three, p, predicted(*observed(subject.models.paper, subject.sensors), p),
                                    subject.data),
                 uncorrected);
  row("m = 3, less what Eq. 17-20 extrapolate from the residual at the true parameters: the same",
      "not in the paper", control, control, "");
  record.rows.back().why +=
      " The same decomposition and line, from the right residual: the extrapolation works, and what the "
      "correction lacks is the residual, which nobody has.";
  const std::size_t n = runs.reference.steps.size(), onset = runs.reference.first_below(1, 0.9);
  record.rows.push_back(
      {"evidence lost by m = 3, per datum: before damage, after",
       "nats",
       "falls slowly below the reference",
       fmt::format("{} and {}", report::readable(gain(runs.reference, runs.biased, 0, onset), 2),
                   report::readable(gain(runs.reference, runs.biased, onset, n), 2)),
       fmt::format("Damage begins near step {}. In all {} nats in favour of m = 6.", onset,
                   report::readable(total(runs.reference) - total(runs.biased))),
       {},
       gain(runs.reference, runs.biased, onset, n)});
  const auto gain_row = [&](const Run& corrected, const char* name, const char* paper) {
    const double before = gain(corrected, runs.biased, 0, onset),
                 after = gain(corrected, runs.biased, onset, n);
    record.rows.push_back(
        {fmt::format("evidence gained by the correction ({}), per datum: before damage, after", name),
         "nats",
         paper,
         fmt::format("{} and {}", report::readable(before, 2), report::readable(after, 2)),
         fmt::format("{} In all {} nats (joint: {}).",
                     after > 0
                         ? "A gain after the onset."
                         : "No gain after the onset: a line through the last two residuals carries their "
                           "noise on, and nothing in the covariance allows for it.",
                     report::readable(total(corrected) - total(runs.biased)),
                     report::readable(total(runs.joint) - total(runs.biased))),
         {},
         after});
  };
  gain_row(runs.published, "to the letter", "a loss at first, where only noise is extrapolated, then a gain");
  gain_row(runs.corrected, "linear", "not in the paper");
  const std::pair<const char*, const Run*> kept[] = {{"m6", &runs.reference},
                                                     {"m3", &runs.biased},
                                                     {"m3_published", &runs.published},
                                                     {"m3_corrected", &runs.corrected},
                                                     {"m3_joint", &runs.joint}};
  for (const auto& [name, run] : kept) {
    record.data.emplace_back(fmt::format("log_evidence_increment_{}", name), evidence_increments(*run));
    for (Index k = 0; k < 2; ++k) {
      record.data.emplace_back(fmt::format("mean_{}_{}", k == 0 ? "Y0" : "Ad", name), means(*run, k));
      record.data.emplace_back(fmt::format("std_{}_{}", k == 0 ? "Y0" : "Ad", name), stds(*run, k));
    }
  }
  return record;
}

}  // namespace knothe::reproduction
