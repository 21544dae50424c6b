/// @file Fig. 8, 9 and 13: sequential assimilation, and the forecast of the crack length.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "knothe/mechanics/full_order/offline.hpp"
#include "knothe/report/figures/result_figures.hpp"
#include "knothe/reproduction/figure_parts.hpp"
#include "knothe/reproduction/published.hpp"
#include "knothe/reproduction/study.hpp"

namespace knothe::reproduction {
namespace {

const char* const k_names[2] = {"Y₀", "A_d"};

double sum(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0);
}

Figure cost_figure(const Run& with_gradient, const Run& without) {
  Plot plot("Order of each map, and CPU time", {"step"}, {"order of the map", 0.0});
  report::PlotAxis cost{"CPU time of a step (ms)"};
  cost.logarithmic = true;
  plot.right_axis(cost);
  std::vector<double> order;
  for (const assimilation::UpdateResult& r : with_gradient.steps) order.push_back(r.map_order);
  const std::vector<double> x = step_numbers(with_gradient);
  plot.bars(x, order, 0.8, Paint::series(5), "order");
  plot.line(x, with_gradient.update_ms, Paint::series(0), "with gradient", {1.8}, report::Side::right);
  plot.line(x, without.update_ms, Paint::series(1), "function alone", {1.8, "5 4", 1.0}, report::Side::right);
  return report::figure_of(std::move(plot), "Order and cost of the maps", 320.0);
}

Figure std_figure(const Run& run, const Run& soft) {
  Figure figure{"Standard deviations over the steps", {}};
  figure.columns = 2;
  for (Index k = 0; k < 2; ++k) {
    report::PlotAxis vertical{fmt::format("posterior std of {}", k_names[k])};
    vertical.logarithmic = true;
    Plot plot(fmt::format("How well {} is known", k_names[k]), {"step"}, vertical);
    plot.line(step_numbers(run), stds(run, k), Paint::series(0), "reference");
    plot.line(step_numbers(soft), stds(soft, k), Paint::series(2), "coarse, soft supports");
    plot.horizontal(published::k_estimate_std[k], Paint::truth(), "paper, last step");
    figure.plots.push_back(std::move(plot));
  }
  return figure;
}

/// The experiment again with other nodes and noise.
struct Repetitions {
  std::vector<double> mean[2], std[2];
  int covered[2] = {0, 0};  ///< truth within two standard deviations
};

Repetitions repeat(const Subject& subject, const StudyOptions& options) {
  Repetitions all;
  for (int i = 0; i < options.repetitions; ++i) {
    const std::uint64_t seed = options.seed + 1000 + static_cast<std::uint64_t>(i);
    const Run run = assimilate_chosen(subject.models.paper, random_nodes(subject.models.paper, seed),
                                      subject.truth, seed, false);
    for (Index k = 0; k < 2; ++k) {
      all.mean[k].push_back(run.mean(k));
      all.std[k].push_back(run.std(k));
      all.covered[k] += run.off_by(k, subject.truth[k]) <= 2 ? 1 : 0;
    }
  }
  return all;
}

std::vector<std::size_t> camera_steps(std::size_t steps) {
  std::vector<std::size_t> chosen;
  for (int i = 1; i <= published::k_picture_count; ++i)
    chosen.push_back(
        static_cast<std::size_t>(std::lround(static_cast<double>(steps) * i / published::k_picture_count)) -
        1);
  chosen.erase(std::unique(chosen.begin(), chosen.end()), chosen.end());
  return chosen;
}

std::vector<double> numbers(const std::vector<std::size_t>& steps) {
  return {steps.begin(), steps.end()};
}

void estimate_rows(FigureRecord& record, const Run& run, const Run& soft, const Repetitions& again) {
  for (std::size_t k = 0; k < 2; ++k) {
    const auto i = static_cast<Index>(k);
    const auto [least, most] = std::minmax_element(again.mean[k].begin(), again.mean[k].end());
    record.rows.push_back(
        {fmt::format("{}: maximum of the last marginal", k_names[k]), "1",
         report::plain(published::k_estimate[k]),
         fmt::format("{} (mean {})", readable(run.mode_of_marginal(k)),
                     with_uncertainty(run.mean(i), run.std(i))),
         fmt::format(
             "One draw of nodes and noise against another. Over {} draws the mean is {} to {}; the truth, 1, "
             "lies within two std in {} of them.",
             again.mean[k].size(), readable(*least), readable(*most), again.covered[k]),
         published::k_estimate[k], run.mode_of_marginal(k)});
    record.rows.push_back(
        {fmt::format("{}: std of the last marginal", k_names[k]), "1",
         report::plain(published::k_estimate_std[k]), readable(run.std(i), 2),
         k == 0
             ? fmt::format(
                   "The information on Y₀ is in how the crack starts, and grows with the width of the crack "
                   "band, "
                   "which is one element: the mesh of the paper is not given. Elements of 20 mm and softer "
                   "supports give {}.",
                   readable(soft.std(i), 2))
             : fmt::format(
                   "The paper knows A_d less well than any mesh here does ({} with the coarse, soft beam). "
                   "Noise, dofs and number of pictures change both std alike; where the loading ends changes "
                   "their ratio (\"supports\", below).",
                   readable(soft.std(i), 2)),
         published::k_estimate_std[k], run.std(i)});
  }
}

void course_rows(FigureRecord& record, const Run& run, const Run& without, const Run& soft) {
  const auto fast = run.first_below(1, 0.5), slow = run.first_below(0, 0.5);
  record.rows.push_back(
      {"step at which the std is half the prior's: A_d, Y₀",
       "step",
       "A_d converges faster",
       fmt::format("{}, {}", fast,
                   slow == run.steps.size() ? std::string("not reached") : fmt::format("{}", slow)),
       "Agrees: A_d moves the observed displacements by up to 12 µm, Y₀ by less than 1 µm and only while the "
       "crack "
       "runs.",
       {},
       static_cast<double>(fast)});
  const auto high = run.high_order_steps(), high_soft = soft.high_order_steps();
  record.rows.push_back(
      {"steps with maps of higher order", "step",
       fmt::format("between {} and {}", published::k_first_high_order, published::k_last_high_order),
       range_of(high),
       fmt::format(
           "Order rises where the posterior changes shape, which is when the crack starts to run: here the "
           "load peaks near step 19. The step moves with supports and mesh: {} in the coarse, soft beam.",
           range_of(high_soft)),
       published::k_first_high_order, high.empty() ? 0.0 : static_cast<double>(high.front())});
  const double ratio = sum(without.update_ms) / sum(run.update_ms);
  record.rows.push_back(
      {"CPU time of all steps, function alone over with gradient",
       "1",
       "gradient much faster",
       readable(ratio),
       fmt::format("Agrees. {} s and {} s in all; Nelder-Mead simplex and BFGS, as in the paper.",
                   readable(1e-3 * sum(without.update_ms)), readable(1e-3 * sum(run.update_ms))),
       {},
       ratio});
}

/// Of a full-order run at the reference parameters, after the last step, m.
double damaged_length(const BeamCase& chosen) {
  mechanics::FullOrderModel model = mechanics::make_full_order_model(chosen.problem);
  return model.run(chosen.problem.reference).crack_length;
}

const forecast::NamedForecast& last_forecast(const Run& run, std::size_t which) {
  return run.forecasts.back()[which];
}

Figure forecast_figure(const Run& run, const Subject& subject, const std::string& title) {
  report::Results results = as_results(run, subject.truth, 2);
  Figure figure{"Successive densities of the crack length, " + title, {}};
  figure.columns = 2;
  for (const forecast::NamedForecast& f : run.forecasts.back()) {
    results.forecasts[f.name] = {"crack_length", {}, {}, "m"};
    figure.plots.push_back(report::forecast_densities_plot(results, f.name));
    figure.plots.push_back(report::forecast_convergence_plot(results, f.name));
  }
  return figure;
}

Figure step_cost_figure(const Run& run) {
  Plot plot("CPU time of each step", {"step"}, {"CPU time (ms)", 0.0});
  std::vector<double> total;
  for (std::size_t i = 0; i < run.steps.size(); ++i) total.push_back(run.update_ms[i] + run.forecast_ms[i]);
  const std::vector<double> x = step_numbers(run);
  plot.bars(x, total, 1.0, Paint::series(1), "crack length", report::Side::left, 1.0);
  plot.bars(x, run.update_ms, 1.0, Paint::series(0), "parameters", report::Side::left, 1.0);
  return report::figure_of(std::move(plot), "Time of each step", 320.0);
}

}  // namespace

FigureRecord figures_8_9(const Subject& subject, const Subject& soft, const StudyOptions& options) {
  FigureRecord record{"8-9", "Sequential updating of the damage parameters", "", {}, {}, {}, {}};
  record.setting =
      "As in §6.3.1: data from the same separated model (m = 6) at (1, 1), 30 nodes drawn at random from the "
      "outer "
      "face with |x| ≤ 120 mm, both components (60 dofs), white noise of 1 µm; prior N((0.9, 1.1), 0.2 I), "
      "truncated "
      "to the box in which the model exists (half of its mass is outside); one map per datum, composed, by "
      "BFGS with "
      "the gradient, variance diagnostic 10⁻³.";
  RunOptions run_options;
  run_options.update = paper_options(options.seed);
  run_options.marginals = true;
  run_options.label = "Fig. 9";
  const auto model = observed(subject.models.paper, subject.sensors);
  const Run run = assimilate(model, subject.data, run_options);
  run_options.marginals = false;
  run_options.label = "Fig. 9, coarse beam";
  const Run soft_run = assimilate(observed(soft.models.paper, soft.sensors), soft.data, run_options);
  run_options.update.map.minimiser = transport::MinimiserKind::nelder_mead;
  run_options.label = "Fig. 9, without gradient";
  const Run without = assimilate(model, subject.data, run_options);
  run_options.update = default_options(options.seed);
  run_options.label = "";
  const Run collapsed = assimilate(model, subject.data, run_options);
  run_options.steps = camera_steps(model->time.size());
  const Run camera = assimilate(model, subject.data, run_options);
  const Repetitions again = repeat(subject, options);

  record.panels.push_back({{sensors_figure(subject.models.paper, subject.sensors, "Measured nodes")},
                           "Fig. 8: the nodes that are observed."});
  record.panels.push_back(
      {{marginals_figure(run, subject.truth, "as in Fig. 9")},
       "Fig. 9, left and centre: wide while the beam is elastic, then narrow around the truth."});
  record.panels.push_back(
      {{cost_figure(run, without)},
       "Fig. 9, right. Bars: the order that the map of each datum needed. Lines: time to find it."});
  record.panels.push_back(
      {{std_figure(run, soft_run)},
       "Standard deviations, and the paper's last ones. How well Y₀ is known depends on the mesh."});
  estimate_rows(record, run, soft_run, again);
  course_rows(record, run, without, soft_run);
  double apart = 0;
  for (Index k = 0; k < 2; ++k)
    apart = std::max(apart, std::abs(run.mean(k) - collapsed.mean(k)) / collapsed.std(k));
  record.rows.push_back({"composed maps against all data in one map, last means",
                         "std",
                         "composed maps only",
                         readable(apart, 2),
                         "The same posterior computed in two ways; the composition is checked against it and "
                         "restarted where errors of many maps have added up.",
                         {},
                         apart});
  record.rows.push_back(
      {"27 pictures (3·10⁻³ mm/s, one every 5 s) in place of 100 steps: Y₀, A_d",
       "1",
       "not said which",
       fmt::format("{}, {}", with_uncertainty(camera.mean(0), camera.std(0)),
                   with_uncertainty(camera.mean(1), camera.std(1))),
       "The paper computes 100 steps up to 0.4 mm; its camera would have taken 27 pictures.",
       {},
       camera.std(0)});
  const std::pair<const char*, const Run*> kept[] = {{"", &run}, {"coarse_soft_", &soft_run}};
  for (const auto& [prefix, r] : kept) {
    for (Index k = 0; k < 2; ++k) {
      const std::string name = k == 0 ? "Y0" : "Ad";
      record.data.emplace_back(fmt::format("{}mean_{}", prefix, name), means(*r, k));
      record.data.emplace_back(fmt::format("{}std_{}", prefix, name), stds(*r, k));
    }
    record.data.emplace_back(std::string(prefix) + "steps_of_higher_order", numbers(r->high_order_steps()));
  }
  record.data.emplace_back("step_cpu_ms_with_gradient", run.update_ms);
  record.data.emplace_back("step_cpu_ms_function_alone", without.update_ms);
  for (std::size_t k = 0; k < 2; ++k)
    record.data.emplace_back(fmt::format("last_mean_of_repetitions_{}", k == 0 ? "Y0" : "Ad"), again.mean[k]);
  return record;
}

FigureRecord figure_13(const Subject& subject, const Subject& soft, const StudyOptions& options) {
  FigureRecord record{"13", "The crack length at the end, forecast as the data come in", "", {}, {}, {}, {}};
  record.setting =
      "The elastic crack that moves the sensors as the damaged beam does at the final imposed displacement: "
      "each posterior point's, with its weight. Beside it Eq. 33 with the predicted field as a normal one, "
      "prior N(40 mm, (13 mm)²), and how far the two fields are apart estimated (the paper does not say). "
      "Also at 0.12 mm, where the length is still uncertain.";
  const Run run = forecast_run(subject, {crack_length("at the end", 1.0), crack_length("at 0.12 mm", 0.3)},
                               options.seed, "Fig. 13");
  const Run soft_run =
      forecast_run(soft, {crack_length("at the end", 1.0)}, options.seed, "Fig. 13, coarse beam");
  record.panels.push_back(
      {{forecast_figure(run, subject, "reference")}, "The reference beam, at the end and at 0.12 mm."});
  record.panels.push_back(
      {{forecast_figure(soft_run, soft, "coarse, soft supports")},
       "Elements of 20 mm, and 0.18 of the 0.4 mm reaching the beam: near the paper's numbers."});
  record.panels.push_back(
      {{step_cost_figure(run)}, "Fig. 13, right: time of each step, parameters and forecast."});
  const auto& f = last_forecast(run, 0);
  const auto& early = last_forecast(run, 1);
  const auto& g = last_forecast(soft_run, 0);
  const std::string why = fmt::format(
      "At 0.4 mm this beam has lost 98 % of its stiffness whatever the parameters, and an elastic crack of "
      "equal "
      "compliance is that long: the paper's beam must have been softer at its supports, coarser, or both. "
      "The coarse, "
      "soft beam gives {} mm; a spring in series, found from when the crack runs, does not (\"supports\", "
      "below). At 0.12 mm the reference gives {} mm.",
      with_uncertainty(1e3 * g.forecast.mean, 1e3 * g.forecast.std),
      with_uncertainty(1e3 * early.forecast.mean, 1e3 * early.forecast.std));
  record.rows.push_back({"crack length at the end, mean", "mm", report::plain(1e3 * published::k_length_mean),
                         with_uncertainty(1e3 * f.forecast.mean, 1e3 * f.forecast.std), why,
                         1e3 * published::k_length_mean, 1e3 * f.forecast.mean});
  record.rows.push_back({"crack length at the end, maximum a posteriori", "mm",
                         report::plain(1e3 * published::k_length_mode),
                         readable(1e3 * f.forecast.maximum_a_posteriori), "As for the mean.",
                         1e3 * published::k_length_mode, 1e3 * f.forecast.maximum_a_posteriori});
  record.rows.push_back(
      {"the same, coarse beam on soft supports", "mm", report::plain(1e3 * published::k_length_mode),
       readable(1e3 * g.forecast.maximum_a_posteriori),
       "A guess at what the paper leaves open that gives its length; not evidence that it is right.",
       1e3 * published::k_length_mode, 1e3 * g.forecast.maximum_a_posteriori});
  const auto by_eq_33 = [&](std::size_t step, std::size_t which) {
    const forecast::ScalarForecast& p = run.published[step][which].forecast;
    return with_uncertainty(1e3 * p.mean, 1e3 * p.std);
  };
  const auto here = [&](std::size_t step, std::size_t which) {
    const forecast::ScalarForecast& p = run.forecasts[step][which].forecast;
    return with_uncertainty(1e3 * p.mean, 1e3 * p.std);
  };
  const std::size_t end = run.forecasts.size() - 1;
  record.rows.push_back(
      {"crack length at the end by Eq. 33 with a normal field, first and last step",
       "mm",
       "Eq. 33 with inverse transport maps",
       by_eq_33(0, 0) + " and " + by_eq_33(end, 0),
       fmt::format(
           "From the posterior's points: {} and {}. At 0.12 mm: {} and {}, by Eq. 33 {} and {}. A field of "
           "mean displacement is that of no crack while little is known.",
           here(0, 0), here(end, 0), here(0, 1), here(end, 1), by_eq_33(0, 1), by_eq_33(end, 1)),
       {},
       1e3 * run.published.front()[0].forecast.mean});
  const auto by_map = [&](std::size_t which, std::size_t quantity) {
    const forecast::ScalarForecast& p = run.published_by_map[which][quantity].forecast;
    return with_uncertainty(1e3 * p.mean, 1e3 * p.std);
  };
  record.rows.push_back(
      {"the same with the inverse transport map of the predicted field",
       "mm",
       "Eq. 33 with inverse transport maps",
       by_map(0, 0) + " and " + by_map(1, 0),
       fmt::format(
           "At 0.12 mm: {} and {}. The field's distribution is right then, and at the end of the data "
           "the two agree. What is left is Eq. 33's own: a second prior, and a weight for fields that "
           "look like a crack's.",
           by_map(0, 1), by_map(1, 1)),
       {},
       1e3 * run.published_by_map.front()[0].forecast.mean});
  record.rows.push_back({"crack length of the damage field itself at (1, 1): reference, coarse and soft",
                         "mm",
                         "not given",
                         fmt::format("{} and {}", readable(1e3 * damaged_length(subject.models.chosen)),
                                     readable(1e3 * damaged_length(soft.models.chosen))),
                         "Height above the notch over which the damage exceeds ½ in the full-order run: no "
                         "elastic crack in between.",
                         {},
                         1e3 * damaged_length(subject.models.chosen)});
  const double before = run.forecasts.front()[1].forecast.std, after = early.forecast.std;
  record.rows.push_back(
      {"std of the length at 0.12 mm, first and last step",
       "mm",
       "coarse at first, then converges",
       fmt::format("{} and {}", readable(1e3 * before, 2), readable(1e3 * after, 2)),
       "Agrees. (At the end the length hardly depends on the parameters, so there is little to learn.)",
       {},
       1e3 * after});
  double slowest = 0;
  for (std::size_t i = 0; i < run.steps.size(); ++i)
    slowest = std::max(slowest, 1e-3 * (run.update_ms[i] + run.forecast_ms[i]));
  record.rows.push_back(
      {"slowest step, update and forecast, CPU time", "s",
       fmt::format("< {:g}", published::k_seconds_per_step), readable(slowest, 2),
       "Composed maps as in the paper; with all data in one map a step takes about a millisecond "
       "(docs/explanation/assimilation.md). The machine is named at the end.",
       published::k_seconds_per_step, slowest});
  record.rows.push_back(
      {"distance of the elastic crack from the damaged beam, sensor by sensor",
       "µm",
       "not given",
       fmt::format("{} (coarse, soft: {})", readable(1e6 * f.bridge_residual_rms.value_or(0), 2),
                   readable(1e6 * g.bridge_residual_rms.value_or(0), 2)),
       "What Eq. 33 has to allow for, estimated with the length (docs/explanation/forecast.md).",
       {},
       1e6 * f.bridge_residual_rms.value_or(0)});
  const std::pair<const char*, const Run*> kept[] = {{"", &run}, {"coarse_soft_", &soft_run}};
  for (const auto& [prefix, r] : kept) {
    std::vector<double> mean, std;
    for (const auto& step : r->forecasts)
      mean.push_back(step[0].forecast.mean), std.push_back(step[0].forecast.std);
    record.data.emplace_back(fmt::format("{}length_m_mean", prefix), mean);
    record.data.emplace_back(fmt::format("{}length_m_std", prefix), std);
  }
  return record;
}

}  // namespace knothe::reproduction
