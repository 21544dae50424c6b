/// @file Fig. 5 to 7: the damage law, and the modes of the reduced model.
#include <fmt/format.h>

#include <cmath>

#include "knothe/mechanics/law/damage_law.hpp"
#include "knothe/report/figures/model_figures.hpp"
#include "knothe/reproduction/figure_parts.hpp"
#include "knothe/reproduction/published.hpp"
#include "knothe/reproduction/study.hpp"

namespace knothe::reproduction {
namespace {

struct Traction {
  std::vector<double> strain, stress;  ///< 1, Pa
  double peak = 0;                     ///< Pa
};

/// Stress under a growing strain in one direction with free sides: the law is isotropic, so the sides
/// contract by ν times the strain however damaged the material is.
Traction traction(const mechanics::ElasticConstants& elastic, const mechanics::DamageParameters& parameters) {
  constexpr int k_points = 161;
  constexpr double k_last = 4e-4;
  Traction curve;
  double damage = 0;
  for (int i = 0; i < k_points; ++i) {
    const double e = k_last * i / (k_points - 1);
    const mechanics::Voigt strain{e, -elastic.poisson_ratio * e, -elastic.poisson_ratio * e, 0, 0, 0};
    const mechanics::MaterialResponse r = mechanics::respond(strain, damage, elastic, parameters);
    damage = r.damage;
    curve.strain.push_back(e);
    curve.stress.push_back(r.stress[0]);
    curve.peak = std::max(curve.peak, r.stress[0]);
  }
  return curve;
}

constexpr double k_levels[] = {0.5, 0.75, 1.0, 1.25, 1.5};

}  // namespace

FigureRecord figure_5(const BeamCase& chosen) {
  const mechanics::ElasticConstants& elastic = chosen.problem.elastic;
  FigureRecord record{"5", "What the parameters of the damage law do", "", {}, {}, {}, {}};
  record.setting =
      "Traction in one direction with free sides, Eq. 29 at one material point, with the reference values of "
      "§6.2 and parameters over the ±50 % box.";
  Figure figure{"Stress against strain", {}};
  figure.columns = 2;
  double peak[2][5];
  for (int k = 0; k < 2; ++k) {
    Plot plot(k == 0 ? "Y₀ varies, A_d at its reference" : "A_d varies, Y₀ at its reference",
              {"strain (10⁻⁴)"}, {"stress (MPa)", 0.0});
    for (int i = 0; i < 5; ++i) {
      mechanics::DamageParameters parameters = chosen.problem.reference;
      (k == 0 ? parameters.threshold : parameters.brittleness) *= k_levels[i];
      Traction curve = traction(elastic, parameters);
      peak[k][i] = curve.peak * 1e-6;
      for (double& e : curve.strain) e *= 1e4;
      for (double& s : curve.stress) s *= 1e-6;
      plot.line(curve.strain, curve.stress, Paint::series(i),
                fmt::format("{} = {:g}", k == 0 ? "Y₀" : "A_d", k_levels[i]), {i == 2 ? 2.6 : 1.6});
      if (k == 0 && i == 0) record.data.emplace_back("strain_1e-4", curve.strain);
      record.data.emplace_back(fmt::format("stress_MPa_{}_{:g}", k == 0 ? "Y0" : "Ad", k_levels[i]),
                               curve.stress);
    }
    figure.plots.push_back(std::move(plot));
  }
  record.panels.push_back({{figure}, "Parameters as multiples of their reference values."});
  // Onset where ½ (λ + 2μ) ε² = Y₀: only the longitudinal strain is positive.
  const double onset =
      std::sqrt(2 * chosen.problem.reference.threshold / (elastic.lambda() + 2 * elastic.mu()));
  record.rows.push_back({"strain at which damage starts, reference values",
                         "1e-4",
                         "not given in figures",
                         fmt::format("{:.3f}", onset * 1e4),
                         "Y = ½(λ + 2μ)ε² = Y₀: a closed form.",
                         {},
                         onset * 1e4});
  record.rows.push_back({"largest stress, Y₀ from 0.5 to 1.5",
                         "MPa",
                         "Y₀ sets where damage begins",
                         fmt::format("{:.2f} to {:.2f}", peak[0][0], peak[0][4]),
                         "Agrees. The curve leaves the elastic line at a strain that grows with √Y₀.",
                         {},
                         peak[0][2]});
  record.rows.push_back(
      {"largest stress, A_d from 0.5 to 1.5",
       "MPa",
       "A_d drives the post-peak behaviour",
       fmt::format("{:.2f} to {:.2f}", peak[1][0], peak[1][4]),
       "Agrees: the onset does not move, what follows does. The slope at onset is E (1 − 2 A_d Y₀), nearly "
       "zero at "
       "the reference and strongly negative at the brittle end, where each element's onset is a jump.",
       {},
       peak[1][2]});
  return record;
}

FigureRecord figures_6_7(const Subject& subject) {
  const reduction::SeparatedModel& paper = subject.models.paper;
  const reduction::SeparatedModel modes = with_lift_as_mode(paper);
  const reduction::ModelContents& c = modes.contents();
  FigureRecord record{"6-7", "The modes of the reduced model, m = 6", "", {}, {}, {}, {}};
  record.setting = fmt::format(
      "{}; {} full-order runs on a {} × {} grid of (Y₀, A_d) in [0.5, 1.5]², 100 load steps to 0.4 mm, {} "
      "dofs. The "
      "elastic solution is taken out exactly and is mode 1 here; five canonical modes follow (alternating "
      "least "
      "squares on the snapshots in place of the paper's LATIN-PGD, which finds modes of the same form one by "
      "one).",
      subject.models.chosen.what, subject.models.chosen.nodes * subject.models.chosen.nodes,
      subject.models.chosen.nodes, subject.models.chosen.nodes, paper.dof_count());
  record.panels.push_back(
      {report::space_mode_figures(modes, 6),
       "Fig. 6: space modes on the outer face, horizontal component scaled to 1, deformed "
       "shape exaggerated."});
  const std::vector<double> p(subject.truth.begin(), subject.truth.end());
  Figure functions{"Time and parameter modes", {}};
  functions.columns = 3;
  functions.plot_width = 340;
  functions.plots.push_back(report::time_functions_plot(modes, p, 6));
  functions.plots.push_back(report::parameter_functions_plot(modes, 0, p, 6));
  functions.plots.push_back(report::parameter_functions_plot(modes, 1, p, 6));
  record.panels.push_back(
      {{functions},
       "Fig. 7: time modes as the largest displacement that each makes (left), parameter modes "
       "(centre, right). Mode 1 is elastic: it grows with the load and does not know the "
       "parameters."});
  std::vector<double> largest;
  for (std::size_t k = 0; k < c.space_modes; ++k) {
    double top = 0, space = 0;
    for (std::size_t t = 0; t < c.time.size(); ++t)
      top = std::max(top, std::abs(c.temporal[k * c.time.size() + t]));
    for (std::size_t i = 0; i < c.dof_count(); ++i)
      space = std::max(space, std::abs(c.space[k * c.dof_count() + i]));
    largest.push_back(1e6 * top * space);
  }
  record.data.emplace_back("largest_displacement_by_mode_um", largest);
  record.rows.push_back(
      {"parameter modes of mode 1",
       "1",
       "unit functions: elastic",
       "1 everywhere, exactly",
       "The elastic solution for the imposed displacement does not depend on the damage law.",
       {},
       1.0});
  record.rows.push_back({"largest displacement by mode 6 over that by mode 1",
                         "1",
                         "time modes get smaller and smaller",
                         fmt::format("{:.3f} ({})", largest.back() / largest.front(),
                                     [&] {
                                       std::string all;
                                       for (const double v : largest)
                                         all += (all.empty() ? "" : ", ") + report::readable(v, 2);
                                       return all + " µm";
                                     }()),
                         "Agrees in kind. Modes 2 to 6 fall slowly: a running crack is a travelling front, "
                         "which separates badly.",
                         {},
                         largest.back() / largest.front()});
  record.rows.push_back(
      {"error of m = 6, relative, all dofs, steps and grid points",
       "1",
       "“accurate”",
       report::readable(paper.contents().relative_error, 2),
       fmt::format(
           "This norm flatters: most of u is elastic. The largest error on a dof is {} µm, more than the "
           "whole effect of Y₀ on the data, and more than the noise.",
           report::readable(1e6 * paper.contents().max_error_m, 2)),
       {},
       paper.contents().relative_error});
  record.rows.push_back(
      {"error of m = 3, relative",
       "1",
       "“non-negligible truncation error” (§6.4)",
       report::readable(subject.models.three.contents().relative_error, 2),
       fmt::format("Two modes beside the elastic one, found one after the other; at most {} µm on a dof. The "
                   "best two: {}.",
                   report::readable(1e6 * subject.models.three.contents().max_error_m, 2),
                   report::readable(subject.models.three_best.contents().relative_error, 2)),
       {},
       subject.models.three.contents().relative_error});
  return record;
}

}  // namespace knothe::reproduction
