/// @file Beyond the paper: supports that give way as a spring in series, and loading that ends near the peak.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "knothe/base/cancellation.hpp"
#include "knothe/base/error.hpp"
#include "knothe/reproduction/figure_parts.hpp"
#include "knothe/reproduction/published.hpp"
#include "knothe/reproduction/study.hpp"

namespace knothe::reproduction {
namespace {

/// When the crack starts to run in the paper: the middle of the steps of its maps of higher order.
constexpr double k_onset = 0.01 * 0.5 * (published::k_first_high_order + published::k_last_high_order);
/// mm, of the displacement imposed on a beam without springs.
constexpr double k_ends[] = {0.108, 0.112, 0.116, 0.12, 0.14, 0.2, 0.4};
constexpr double k_short_ends[] = {0.115, 0.12};  ///< mm, of runs whose 100 steps end there
constexpr double k_fine_noise = 0.5e-6;           // m

/// A beam on its supports: what it shows, and what is known at the end.
struct Supported {
  Subject subject;
  Run run;

  Supported(Subject of, std::uint64_t seed)
      : subject(std::move(of)),
        run(forecast_run(subject, {crack_length("at the end", 1.0)}, seed, subject.models.chosen.what)) {}
  [[nodiscard]] const forecast::ScalarForecast& length() const { return run.forecasts.back()[0].forecast; }
  /// Reaction at the reference parameters, the middle of the grid, N.
  [[nodiscard]] std::vector<double> force() const {
    const reduction::ModelContents& c = subject.models.paper.contents();
    const std::size_t steps = c.time.size();
    for (const reduction::SnapshotOutput& output : c.outputs) {
      if (output.name != "reaction_force") continue;
      const double* middle = &output.values[output.values.size() / steps / 2 * steps];
      return {middle, middle + steps};
    }
    throw DataError("the model has no output reaction_force");
  }
  [[nodiscard]] std::size_t peak() const {
    const std::vector<double> f = force();
    return static_cast<std::size_t>(std::max_element(f.begin(), f.end()) - f.begin());
  }
};

BeamCase elements_of_20_mm() {
  for (BeamCase& other : other_cases())
    if (other.name == "elements_20") return other;
  throw UsageError("there is no case elements_20");
}

Figure force_figure(const std::vector<Supported>& beams) {
  Plot plot("Load at the reference parameters", {"imposed displacement (mm)"}, {"load (kN)", 0.0});
  for (std::size_t i = 0; i < beams.size(); ++i) {
    std::vector<double> x, y = beams[i].force();
    for (std::size_t t = 0; t < y.size(); ++t) {
      x.push_back(0.4 * beams[i].subject.models.paper.contents().time[t]);
      y[t] *= 1e-3;
    }
    plot.line(x, y, Paint::series(static_cast<int>(i)), beams[i].subject.models.chosen.what);
  }
  return report::figure_of(std::move(plot), "Load against the imposed displacement", 360.0);
}

Table supports_table(const std::vector<Supported>& beams) {
  Table table;
  table.caption = "Data of each beam's own m = 6 at (1, 1), 60 dofs, 1 µm.";
  table.header = {"beam", "load peaks at step",         "steps with maps of higher order", "Y₀",
                  "A_d",  "crack length at the end, mm"};
  for (const Supported& b : beams)
    table.rows.push_back({b.subject.models.chosen.what, fmt::format("{}", b.peak()),
                          range_of(b.run.high_order_steps()), with_uncertainty(b.run.mean(0), b.run.std(0)),
                          with_uncertainty(b.run.mean(1), b.run.std(1)),
                          with_uncertainty(1e3 * b.length().mean, 1e3 * b.length().std)});
  return table;
}

void spring_rows(FigureRecord& record, const std::vector<Supported>& beams, const Supported& guess) {
  for (const Supported& b : beams) {
    const BeamCase& chosen = b.subject.models.chosen;
    if (chosen.machine_stiffness == 0) continue;
    const std::vector<double> force = b.force();
    record.rows.push_back(
        {fmt::format("{:.0f} mm elements, spring in series: its stiffness",
                     1e3 * chosen.problem.beam.element),
         "MN/m",
         fmt::format("crack runs in steps {} to {}", published::k_first_high_order,
                     published::k_last_high_order),
         readable(1e-6 * chosen.machine_stiffness),
         fmt::format(
             "Chosen so that the load of the full-order model peaks at step {:.0f}; with data of m = 6 "
             "maps of higher order are at {}.",
             100 * k_onset, range_of(b.run.high_order_steps())),
         {},
         1e-6 * chosen.machine_stiffness});
    record.rows.push_back(
        {fmt::format("{:.0f} mm elements, spring in series: crack length at the end",
                     1e3 * chosen.problem.beam.element),
         "mm", report::plain(1e3 * published::k_length_mean),
         with_uncertainty(1e3 * b.length().mean, 1e3 * b.length().std),
         fmt::format(
             "A prediction: nothing was fitted to the length. What a spring takes up while the beam is "
             "stiff it gives back when the beam has cracked. A constant share, 0.18 of the "
             "0.4 mm, gives {} mm because it does not: that is not what supports do.",
             readable(1e3 * guess.length().mean)),
         1e3 * published::k_length_mean, 1e3 * b.length().mean});
  }
}

/// What is known where the loading ends.
struct Ends {
  std::vector<double> end, std[2], ratio;

  void add(double at, const Run& run, std::size_t step) {
    end.push_back(at);
    for (Index k = 0; k < 2; ++k) std[k].push_back(run.std_at(step, k));
    ratio.push_back(std[0].back() / std[1].back());
  }
  [[nodiscard]] std::string cell(std::size_t i) const {
    return fmt::format("{}, {}, {}", readable(std[0][i], 2), readable(std[1][i], 2), readable(ratio[i], 2));
  }
};

Run finely_measured(const Subject& subject, std::uint64_t seed) {
  const auto seen = observed(subject.models.paper, subject.sensors);
  RunOptions options;
  options.update = default_options(seed);
  return assimilate(seen,
                    measure(predicted(*seen, subject.truth), subject.sensors, seen->time, seed, k_fine_noise),
                    options);
}

/// The first steps of one run, up to each of k_ends.
Ends ends_of(const Subject& subject, std::uint64_t seed) {
  const Run run = finely_measured(subject, seed);
  Ends ends;
  for (const double end : k_ends) {
    const auto steps = static_cast<double>(run.steps.size());
    ends.add(end, run, static_cast<std::size_t>(std::max(1.0, std::round(end / 0.4 * steps))) - 1);
  }
  return ends;
}

/// The beam loaded to `end` [mm] in as many steps as others to 0.4 mm.
BeamCase ending_at(BeamCase chosen, double end) {
  chosen.problem.solver.displacement = 1e-3 * end;
  chosen.name += fmt::format("_to_{:g}", end);
  chosen.what += fmt::format(", loaded to {:g} mm", end);
  return chosen;
}

}  // namespace

FigureRecord supports_and_loading(const Subject& subject, const Subject& soft, const StudyOptions& options) {
  FigureRecord record{"supports", "Springs in series, and where the loading ends", "", {}, {}, {}, {}};
  record.setting = fmt::format(
      "Not in the paper. Supports and plates give way as a spring in series does, u_beam = u_imposed − F/k, "
      "not by a constant share of the displacement. k is found from the one thing that tells when the "
      "paper's crack began to run, its maps of higher order in steps {} to {}: the load peaks at step "
      "{:.0f}. "
      "Where the load falls faster than the spring unloads, the beam jumps. The length is then a prediction.",
      published::k_first_high_order, published::k_last_high_order, 100 * k_onset);
  std::vector<Supported> beams;
  const auto add = [&](Subject of) {
    check_cancellation("the models that were built are kept: the same command goes on from there");
    beams.emplace_back(std::move(of), options.seed);
  };
  const auto prepared = [&](const BeamCase& chosen) {
    return subject_of(prepare(chosen, options.models_folder, options.processes), options.seed);
  };
  const Subject coarse = prepared(elements_of_20_mm());
  add(subject);
  add(coarse);
  add(soft);
  add(prepared(with_series_spring(coarse.models.chosen, k_onset)));
  if (!options.quick) add(prepared(with_series_spring(subject.models.chosen, k_onset)));
  record.panels.push_back(
      {{force_figure(beams)}, "The load that each beam bears, before and after it cracks."});
  record.tables.push_back(supports_table(beams));
  spring_rows(record, beams, beams[2]);

  Table table;
  table.caption = fmt::format(
      "Loading that ends earlier: std of both parameters and their ratio ({:.2f} in the paper: {} and {}), "
      "noise of 0.5 µm, m = 6, without springs.",
      published::k_estimate_std[0] / published::k_estimate_std[1],
      report::plain(published::k_estimate_std[0]), report::plain(published::k_estimate_std[1]));
  table.header = {"loading ends at, mm", "20 mm elements: Y₀, A_d, ratio", "5 mm elements: Y₀, A_d, ratio"};
  const Ends of_coarse = ends_of(coarse, options.seed), of_fine = ends_of(subject, options.seed);
  for (std::size_t i = 0; i < of_coarse.end.size(); ++i)
    table.rows.push_back({report::plain(of_coarse.end[i]), of_coarse.cell(i), of_fine.cell(i)});
  Ends of_short;
  for (const double end : k_short_ends) {
    if (options.quick && end != k_short_ends[0]) continue;
    const Run run = finely_measured(prepared(ending_at(coarse.models.chosen, end)), options.seed);
    of_short.add(end, run, run.steps.size() - 1);
    table.rows.push_back(
        {fmt::format("{:g}, in 100 steps", end), of_short.cell(of_short.end.size() - 1), ""});
  }
  record.tables.push_back(table);
  record.rows.push_back(
      {fmt::format("std of Y₀ over std of A_d, 20 mm elements, 100 steps: to 0.4 mm, to {:g} mm",
                   k_short_ends[0]),
       "1", readable(published::k_estimate_std[0] / published::k_estimate_std[1], 2),
       fmt::format("{} and {}", readable(of_coarse.ratio.back(), 2), readable(of_short.ratio[0], 2)),
       fmt::format(
           "The stds are {} and {} where the loading ends near the peak (0.5 µm). Noise, dofs, prior and "
           "number of pictures do not change the ratio; where the loading ends does.",
           readable(of_short.std[0][0], 2), readable(of_short.std[1][0], 2)),
       published::k_estimate_std[0] / published::k_estimate_std[1], of_short.ratio[0]});
  record.data.emplace_back("loading_ends_mm", of_coarse.end);
  const std::pair<const char*, const Ends*> kept[] = {
      {"20_mm", &of_coarse}, {"5_mm", &of_fine}, {"20_mm_in_100_steps", &of_short}};
  for (const auto& [name, e] : kept) {
    record.data.emplace_back(fmt::format("std_Y0_{}", name), e->std[0]);
    record.data.emplace_back(fmt::format("std_Ad_{}", name), e->std[1]);
  }
  return record;
}

}  // namespace knothe::reproduction
