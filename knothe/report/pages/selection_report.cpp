#include "knothe/report/pages/selection_report.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "knothe/record/number_text.hpp"
#include "knothe/report/figures/mesh_view.hpp"
#include "knothe/report/figures/model_figures.hpp"
#include "knothe/report/pages/page.hpp"

namespace knothe::report {
namespace {

using nlohmann::ordered_json;
constexpr const char* k_letters[] = {"x", "y", "z"};

ordered_json by_name(const std::vector<std::string>& names, const Eigen::VectorXd& values) {
  ordered_json object = ordered_json::object();
  for (std::size_t k = 0; k < names.size(); ++k) object[names[k]] = values[k];
  return object;
}

/// √(Σ_t (∂u/∂p)²) of one component, times the prior's std, µm, at the nodes of the face.
std::vector<double> field_on_face(const model::SeparatedModel& model, const OuterFace& face, int component,
                                  Eigen::Index parameter, const Eigen::VectorXd& at, double prior_std) {
  const std::vector<std::ptrdiff_t> dofs = dofs_of_face(face, model.contents().dofs, component);
  std::vector<std::size_t> present;
  for (const std::ptrdiff_t dof : dofs) {
    if (dof >= 0) present.push_back(dof);
  }
  const Eigen::MatrixXd s = assimilation::sensitivity_over_time(model::observe_dofs(model, present), at);
  std::vector<double> values;
  Eigen::Index next = 0;
  for (const std::ptrdiff_t dof : dofs)
    values.push_back(dof < 0 ? 0 : 1e6 * prior_std * s(next++, parameter));
  return values;
}

Figure field_figure(const project::SelectionSetup& setup, const assimilation::SelectionStudy& study) {
  const OuterFace face = outer_face(*setup.model.contents().mesh);
  Figure figure{"Sensitivity fields", {}};
  figure.columns = 2;
  for (std::size_t k = 0; k < setup.model.dimension(); ++k) {
    for (int component = 0; component < 2; ++component) {
      const std::string name = setup.model.parameter_names()[k];
      const auto values =
          field_on_face(setup.model, face, component, k, setup.problem.at, study.prior_std[k]);
      Plot plot = mesh_plot(fmt::format("{}, {} displacement", name, k_letters[component]), face, values, {},
                            "root of the sum over time, µm per prior std");
      std::vector<double> x, y;
      for (const assimilation::RankedDof& r : study.ranked) {
        if (setup.sensors.components[r.dof] != component) continue;
        x.push_back(setup.problem.positions(r.dof, 0));
        y.push_back(setup.problem.positions(r.dof, 1));
      }
      if (!x.empty()) plot.scatter(x, y, Paint::series(1), "chosen", 3.5);
      figure.plots.push_back(std::move(plot));
    }
  }
  figure.plot_height = plot_height_of(face, figure.plot_width);
  return figure;
}

Figure curve_figure(const project::SelectionSetup& setup, const assimilation::SelectionStudy& study) {
  Figure figure{"Posterior standard deviation against number of dofs", {}};
  figure.columns = 2;
  for (std::size_t k = 0; k < setup.model.dimension(); ++k) {
    const Eigen::Index j = k;
    const std::string name = setup.model.parameter_names()[k];
    PlotAxis vertical{"posterior std of " + name};
    vertical.logarithmic = true;
    Plot plot(name, {"number of dofs"}, vertical);
    int colour = 0;
    for (const assimilation::SelectionCurve& curve : study.curves) {
      std::vector<double> x = {0}, y = {study.prior_std[j]};
      for (Eigen::Index i = 0; i < curve.posterior_std.rows(); ++i) {
        x.push_back(i + 1);
        y.push_back(curve.posterior_std(i, j));
      }
      plot.line(x, y, Paint::series(colour++), curve.name);
    }
    plot.horizontal(study.posterior_std_of_all[j], Paint::truth(),
                    fmt::format("all {} dofs", setup.candidates.size()));
    figure.plots.push_back(std::move(plot));
  }
  return figure;
}

}  // namespace

std::vector<ordered_json> selection_records(const project::Project& project,
                                            const project::SelectionSetup& setup,
                                            const assimilation::SelectionStudy& study) {
  const std::vector<std::string> names = setup.model.parameter_names();
  std::vector<ordered_json> records;
  std::vector<std::size_t> dofs;
  for (std::size_t i = 0; i < study.ranked.size(); ++i) {
    const assimilation::RankedDof& r = study.ranked[i];
    const auto& x = setup.problem.positions;
    dofs.push_back(setup.candidates[r.dof]);
    records.push_back({{"rank", i},
                       {"dof", dofs.back()},
                       {"point", {x(r.dof, 0), x(r.dof, 1), x(r.dof, 2)}},
                       {"component", setup.sensors.components[r.dof]},
                       {"score", r.score},
                       {"sensitivity", by_name(names, r.sensitivity)},
                       {"signal_to_noise", by_name(names, r.signal_to_noise)},
                       {"posterior_std", by_name(names, r.posterior_std)},
                       {"reason", assimilation::explain(study, i, names)}});
  }
  ordered_json curves = ordered_json::object();
  for (const assimilation::SelectionCurve& curve : study.curves)
    curves[curve.name] = by_name(names, curve.posterior_std.row(curve.posterior_std.rows() - 1).transpose());
  records.push_back({{"done", true},
                     {"criterion", to_text(project.select.criterion)},
                     {"candidates", setup.candidates.size()},
                     {"candidates_from", setup.from_data ? "data" : "model"},
                     {"dofs", dofs},
                     {"prior_std", by_name(names, study.prior_std)},
                     {"posterior_std", curves},
                     {"posterior_std_all", by_name(names, study.posterior_std_of_all)},
                     {"elapsed_s", study.choice_seconds}});
  return records;
}

std::string selection_page(const project::Project& project, const project::SelectionSetup& setup,
                           const assimilation::SelectionStudy& study) {
  const std::vector<std::string> names = setup.model.parameter_names();
  Page page("Data selection", fmt::format("{}: {} of {} dofs by {}", project.path, study.ranked.size(),
                                          setup.candidates.size(), to_text(project.select.criterion)));
  std::vector<Card> cards;
  for (std::size_t k = 0; k < names.size(); ++k) {
    const Eigen::Index j = k;
    cards.push_back({"std of " + names[k], record::readable(study.ranked.back().posterior_std[j]),
                     fmt::format("prior {}, all dofs {}", record::readable(study.prior_std[j]),
                                 record::readable(study.posterior_std_of_all[j]))});
  }
  page.cards(cards);
  page.section("Posterior standard deviation against number of dofs");
  page.figure(curve_figure(setup, study),
              "Linearised at one point of the box; information of all steps. The same number of dofs, chosen "
              "in different ways, and all of them.");
  page.section("Sensitivity fields");
  if (can_be_drawn(setup.model)) {
    page.figure(field_figure(setup, study), "What each parameter moves, and the chosen dofs.");
  } else {
    page.note("The model has no mesh to draw on.");
  }
  page.section("Chosen dofs");
  std::vector<TableRow> rows;
  for (std::size_t i = 0; i < study.ranked.size(); ++i) {
    const assimilation::RankedDof& r = study.ranked[i];
    const std::size_t k = r.dof;
    rows.push_back(
        {{std::to_string(i + 1), std::to_string(setup.candidates[k]),
          fmt::format("{} at ({:.1f}, {:.1f}, {:.1f}) mm", k_letters[setup.sensors.components[k]],
                      1e3 * setup.problem.positions(r.dof, 0), 1e3 * setup.problem.positions(r.dof, 1),
                      1e3 * setup.problem.positions(r.dof, 2)),
          record::readable(r.score), assimilation::explain(study, i, names)}});
  }
  page.table({"Rank", "Dof", "Component and point", "Score", "Why"}, rows);
  return page.html();
}

}  // namespace knothe::report
