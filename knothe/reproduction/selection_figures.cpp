/// @file Fig. 16 to 18: which measurements are worth assimilating.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "knothe/assimilation/select/sensitivity.hpp"
#include "knothe/numerics/statistics/order_statistics.hpp"
#include "knothe/report/figures/mesh_view.hpp"
#include "knothe/reproduction/figure_parts.hpp"
#include "knothe/reproduction/published.hpp"
#include "knothe/reproduction/study.hpp"

namespace knothe::reproduction {
namespace {

using numerics::quantile;

/// Mean time of the model, as the paper's t⋄.
std::size_t mean_step(const reduction::SeparatedModel& model) {
  return model.step_count() / 2 - 1;
}

/// |S_1|, |S_2| and their product on the outer face, one component.
void add_fields(const Subject& subject, int component, Figure& figure) {
  const reduction::SeparatedModel& model = subject.models.paper;
  const report::OuterFace face = report::outer_face(*model.contents().mesh);
  std::vector<std::size_t> dofs;
  for (const std::ptrdiff_t dof : report::dofs_of_face(face, model.contents().dofs, component))
    dofs.push_back(static_cast<std::size_t>(dof));
  const Eigen::MatrixXd s =
      assimilation::sensitivity_fields(reduction::observe_dofs(model, dofs), subject.truth, mean_step(model));
  const char letter = component == 0 ? 'x' : 'y';
  std::vector<double> first, second, product;
  for (Index i = 0; i < s.rows(); ++i) {
    first.push_back(1e6 * std::abs(s(i, 0)));
    second.push_back(1e6 * std::abs(s(i, 1)));
    product.push_back(first.back() * second.back());
  }
  figure.plots.push_back(
      report::mesh_plot(fmt::format("S₁ (Y₀), {}", letter), face, first, {}, "µm per unit"));
  figure.plots.push_back(
      report::mesh_plot(fmt::format("S₂ (A_d), {}", letter), face, second, {}, "µm per unit"));
  figure.plots.push_back(report::mesh_plot(fmt::format("S₁₂ = S₁ S₂, {}", letter), face, product, {}, "µm²"));
  figure.plot_height = report::plot_height_of(face, figure.plot_width);
}

/// Last std with the noise of image correlation, the matrix of which selects: of 30 dofs by the paper's rule,
/// at random (median), and D-optimal for that noise.
struct Correlated {
  double selected[2] = {}, random[2] = {}, d_optimal[2] = {};
};

struct Choices {
  Run selected, random_dofs, random_nodes, d_optimal;
  Correlated correlated;
  std::vector<double> random_std[2];   ///< last std over several random choices of 30 dofs
  std::vector<double> random_half[2];  ///< and the step where it is half the prior's
};

std::string step_or_never(std::size_t step, const Run& run) {
  return step == run.steps.size() ? "never" : fmt::format("{}", step);
}

Figure std_figure(const Choices& c) {
  Figure figure{"Standard deviation over the steps", {}};
  figure.columns = 2;
  for (Index k = 0; k < 2; ++k) {
    report::PlotAxis vertical{fmt::format("posterior std of {}", k == 0 ? "Y₀" : "A_d")};
    vertical.logarithmic = true;
    Plot plot(k == 0 ? "How well Y₀ is known" : "How well A_d is known", {"step"}, vertical);
    const std::pair<const char*, const Run*> shown[] = {{"30 dofs, selected (paper)", &c.selected},
                                                        {"30 dofs, random", &c.random_dofs},
                                                        {"30 nodes, random (60 dofs)", &c.random_nodes},
                                                        {"30 dofs, D-optimal", &c.d_optimal}};
    int colour = 0;
    for (const auto& [label, run] : shown)
      plot.line(step_numbers(*run), stds(*run, k), Paint::series(colour++), label);
    figure.plots.push_back(std::move(plot));
  }
  return figure;
}

int random_choices(const StudyOptions& options) {
  return std::max(5, options.repetitions / 2);
}

Correlated with_correlated_noise(const Subject& subject, const Surface& surface,
                                 const std::vector<Index>& selected, const StudyOptions& options) {
  const reduction::SeparatedModel& model = subject.models.paper;
  const assimilation::NoiseModel noise = correlation_noise(surface);
  const auto run = [&](const std::vector<Index>& dofs, std::uint64_t seed) {
    return assimilate_chosen(model, surface, dofs, subject.truth, noise, seed);
  };
  const Run by_rule = run(selected, options.seed);
  const Run optimal = run(select_d_optimal(model, surface, subject.truth, noise), options.seed);
  std::vector<double> random[2];
  for (int i = 0; i < random_choices(options); ++i) {
    const std::uint64_t seed = options.seed + 2000 + static_cast<std::uint64_t>(i);
    const Run again = run(select_at_random(surface, seed), seed);
    for (Index k = 0; k < 2; ++k) random[k].push_back(again.std(k));
  }
  Correlated c;
  for (Index k = 0; k < 2; ++k) {
    c.selected[k] = by_rule.std(k);
    c.random[k] = quantile(random[k], 0.5);
    c.d_optimal[k] = optimal.std(k);
  }
  return c;
}

Choices compute(const Subject& subject, const StudyOptions& options, FigureRecord& record) {
  const reduction::SeparatedModel& model = subject.models.paper;
  const Surface surface = surface_of(subject.models.chosen, options.seed);
  const PublishedSelection published_choice =
      select_as_published(model, surface, subject.truth, mean_step(model));
  const auto run = [&](const Sensors& sensors, std::uint64_t seed, bool marginals) {
    return assimilate_chosen(model, sensors, subject.truth, seed, marginals);
  };
  Choices c;
  c.selected = run(part_of(surface.sensors, published_choice.dofs), options.seed, true);
  c.random_dofs = run(part_of(surface.sensors, select_at_random(surface, options.seed)), options.seed, true);
  c.random_nodes = run(subject.sensors, options.seed, true);
  const std::vector<Index> optimal = select_d_optimal(model, surface, subject.truth, white_noise(surface));
  c.d_optimal = run(part_of(surface.sensors, optimal), options.seed, false);
  for (int i = 0; i < random_choices(options); ++i) {
    const std::uint64_t seed = options.seed + 2000 + static_cast<std::uint64_t>(i);
    const Run again = run(part_of(surface.sensors, select_at_random(surface, seed)), seed, false);
    for (Index k = 0; k < 2; ++k) {
      c.random_std[k].push_back(again.std(k));
      c.random_half[k].push_back(static_cast<double>(again.first_below(k, 0.5)));
    }
  }
  c.correlated = with_correlated_noise(subject, surface, published_choice.dofs, options);
  record.data.emplace_back("selected_dofs_of_the_camera",
                           std::vector<double>(published_choice.dofs.begin(), published_choice.dofs.end()));
  record.data.emplace_back("d_optimal_dofs_of_the_camera",
                           std::vector<double>(optimal.begin(), optimal.end()));
  return c;
}

void compare(const Choices& c, FigureRecord& record) {
  for (Index k = 0; k < 2; ++k) {
    const char* name = k == 0 ? "Y₀" : "A_d";
    record.rows.push_back({fmt::format("{}: last std, selected over random 30 dofs", name),
                           "1",
                           "selected is better",
                           readable(c.selected.std(k) / quantile(c.random_std[k], 0.5), 2),
                           fmt::format("{} against {} (median of {} random choices); 60 random dofs: {}; 30 "
                                       "D-optimal dofs, which look at "
                                       "all steps: {}.",
                                       readable(c.selected.std(k), 2),
                                       readable(quantile(c.random_std[k], 0.5), 2), c.random_std[k].size(),
                                       readable(c.random_nodes.std(k), 2), readable(c.d_optimal.std(k), 2)),
                           {},
                           c.selected.std(k) / quantile(c.random_std[k], 0.5)});
    const auto half = c.selected.first_below(k, 0.5);
    record.rows.push_back(
        {fmt::format("{}: step where the std is half the prior's, selected and random", name),
         "step",
         "selected is faster",
         fmt::format("{} and {}", step_or_never(half, c.selected),
                     quantile(c.random_half[k], 0.5) >= static_cast<double>(c.selected.steps.size())
                         ? std::string("never")
                         : readable(quantile(c.random_half[k], 0.5))),
         fmt::format("60 random dofs: {}; D-optimal: {}.",
                     step_or_never(c.random_nodes.first_below(k, 0.5), c.random_nodes),
                     step_or_never(c.d_optimal.first_below(k, 0.5), c.d_optimal)),
         {},
         static_cast<double>(half)});
    const Correlated& same = c.correlated;
    record.rows.push_back(
        {fmt::format("{}: last std, selected over random, the noise 2γ²M⁻¹ assimilated too", name),
         "1",
         "M_DIC weights the choice; the noise assimilated is white",
         readable(same.selected[k] / same.random[k], 2),
         fmt::format(
             "{} against {}; 30 dofs that are D-optimal for that noise: {}. γ is such that the median "
             "std of a dof is 1 µm; neighbours' errors are alike, and what all 30 dofs show together "
             "counts less.",
             readable(same.selected[k], 2), readable(same.random[k], 2), readable(same.d_optimal[k], 2)),
         {},
         same.selected[k] / same.random[k]});
  }
  record.data.emplace_back("random_std_Y0", c.random_std[0]);
  record.data.emplace_back("random_std_Ad", c.random_std[1]);
}

}  // namespace

FigureRecord figures_16_17(const Subject& subject, const StudyOptions& options) {
  FigureRecord record{"16-17", "Sensitivity fields, and the dofs chosen by them", "", {}, {}, {}, {}};
  const reduction::SeparatedModel& model = subject.models.paper;
  const Surface surface = surface_of(subject.models.chosen, options.seed);
  const PublishedSelection s = select_as_published(model, surface, subject.truth, mean_step(model));
  record.setting = fmt::format(
      "Eq. 34 at the mean time (step {}) and the reference parameters. The camera: a speckle picture of the "
      "central "
      "240 mm, 0.25 mm a pixel, linear triangles of 6 mm ({} dofs), M_DIC by Eq. 27; S₁₂ weighted by it.",
      mean_step(model), surface.sensors.size());
  Figure fields{"Sensitivity fields", {}};
  fields.columns = 3;
  fields.plot_width = 330;
  add_fields(subject, 0, fields);
  add_fields(subject, 1, fields);
  record.panels.push_back(
      {{fields}, "Fig. 16: |∂u/∂Y₀|, |∂u/∂A_d| and their product, horizontal (above) and vertical."});
  std::vector<double> along[2];
  const double largest = s.weighted.cwiseAbs().maxCoeff();
  for (Index i = 0; i < s.weighted.size(); ++i) along[i % 2].push_back(s.weighted[i] / largest);
  record.panels.push_back(
      {{surface_figure(surface, "M_DIC S₁₂, x direction", along[0], "largest = 1", {}),
        surface_figure(surface, "M_DIC S₁₂, y direction", along[1], "largest = 1", {}),
        surface_figure(surface, "The 30 dofs chosen", along[0], "x direction", s.dofs)},
       "Fig. 17: the product weighted by the matrix of the image correlation, and the 30 dofs where it "
       "is largest."});
  const WhereChosen where = where_chosen(surface, s.dofs);
  record.rows.push_back(
      {"chosen dofs right of mid-span", "%", "all", fmt::format("{:.0f}", 100 * where.right),
       "u_x = 0 on the left: as the crack opens the right half moves to the right, and all of it "
       "by the same amount.",
       100, 100 * where.right});
  record.rows.push_back({"chosen dofs that are horizontal",
                         "%",
                         "area of the larger horizontal displacement",
                         fmt::format("{:.0f}", 100 * where.horizontal),
                         "As above.",
                         {},
                         100 * where.horizontal});
  const auto seen = observed(model, surface.sensors);
  std::vector<double> size[2];
  for (std::size_t t = 0; t < model.step_count(); ++t) {
    const Eigen::MatrixXd at = assimilation::sensitivity_fields(*seen, subject.truth, t);
    for (Index k = 0; k < 2; ++k)
      size[k].push_back(1e6 * at.col(k).norm() / std::sqrt(static_cast<double>(at.rows())));
  }
  std::size_t peak[2];
  for (std::size_t k = 0; k < 2; ++k)
    peak[k] = static_cast<std::size_t>(std::max_element(size[k].begin(), size[k].end()) - size[k].begin());
  Plot over_time("Sensitivity over time", {"step"}, {"rms over the dofs (µm per unit)"});
  std::vector<double> steps;
  for (std::size_t t = 0; t < size[0].size(); ++t) steps.push_back(static_cast<double>(t));
  over_time.line(steps, size[0], Paint::series(0), "Y₀").line(steps, size[1], Paint::series(1), "A_d");
  over_time.vertical(static_cast<double>(mean_step(model)), Paint::faint(), "mean time");
  record.panels.push_back({{report::figure_of(std::move(over_time), "Sensitivity over time", 320.0)},
                           "When each parameter moves the surface: the mean time is one instant of this."});
  record.rows.push_back({"step where the sensitivity is largest: Y₀, A_d",
                         "step",
                         "mean time chosen",
                         fmt::format("{} and {}", peak[0], peak[1]),
                         fmt::format("At the mean time it is {} and {} of that.",
                                     readable(size[0][mean_step(model)] / size[0][peak[0]], 2),
                                     readable(size[1][mean_step(model)] / size[1][peak[1]], 2)),
                         {},
                         static_cast<double>(peak[0])});
  record.data.emplace_back("sensitivity_um_rms_Y0", size[0]);
  record.data.emplace_back("sensitivity_um_rms_Ad", size[1]);
  record.data.emplace_back("chosen_dofs_of_the_camera", std::vector<double>(s.dofs.begin(), s.dofs.end()));
  return record;
}

FigureRecord figure_18(const Subject& subject, const StudyOptions& options) {
  FigureRecord record{"18", "Selected measurements against random ones", "", {}, {}, {}, {}};
  record.setting =
      "Data of m = 6 at (1, 1), white noise of 1 µm (in two rows that of image correlation), at the 30 dofs "
      "of Fig. 17, at 30 dofs of the camera "
      "drawn at random, "
      "and at the 30 random nodes of Fig. 8: §6.4 says that those are 60 dofs, §6.5 that they are 30.";
  const Choices c = compute(subject, options, record);
  record.panels.push_back(
      {{marginals_figure(c.selected, subject.truth, "selected", 4)}, "Fig. 18, left: 30 selected dofs."});
  record.panels.push_back({{marginals_figure(c.random_dofs, subject.truth, "30 random dofs", 4)},
                           "Fig. 18, right, read as 30 random dofs."});
  record.panels.push_back({{marginals_figure(c.random_nodes, subject.truth, "30 random nodes", 4)},
                           "Fig. 18, right, read as 30 random nodes (60 dofs)."});
  record.panels.push_back({{std_figure(c)},
                           "The same as standard deviations; besides, 30 dofs chosen by the "
                           "information of all steps."});
  compare(c, record);
  const std::pair<const char*, const Run*> kept[] = {{"selected", &c.selected},
                                                     {"random_30_dofs", &c.random_dofs},
                                                     {"random_30_nodes", &c.random_nodes},
                                                     {"d_optimal", &c.d_optimal}};
  for (const auto& [name, run] : kept) {
    record.data.emplace_back(fmt::format("std_Y0_{}", name), stds(*run, 0));
    record.data.emplace_back(fmt::format("std_Ad_{}", name), stds(*run, 1));
  }
  return record;
}

}  // namespace knothe::reproduction
