#include "knothe/report/pages/selection_report.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "knothe/record/number_text.hpp"
#include "knothe/report/data/report_record.hpp"
#include "knothe/report/data/specimen.hpp"
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

/// √(Σ_t (∂u/∂p)²) of one component, times the prior's std, m, at the nodes of the face.
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
  for (const std::ptrdiff_t dof : dofs) values.push_back(dof < 0 ? 0 : prior_std * s(next++, parameter));
  return values;
}

/// What each parameter moves, by component, and the dofs that were chosen there.
void add_fields(ordered_json& record, const project::SelectionSetup& setup,
                const assimilation::SelectionStudy& study) {
  const OuterFace face = outer_face(*setup.model.contents().mesh);
  record["specimen"] = face_record(face);
  record["fields"] = ordered_json::array();
  for (std::size_t k = 0; k < setup.model.dimension(); ++k) {
    for (int component = 0; component < 2; ++component) {
      ordered_json x = ordered_json::array(), y = ordered_json::array();
      for (const assimilation::RankedDof& r : study.ranked) {
        if (setup.sensors.components[r.dof] != component) continue;
        x.push_back(setup.problem.positions(r.dof, 0));
        y.push_back(setup.problem.positions(r.dof, 1));
      }
      record["fields"].push_back(
          {{"title",
            fmt::format("{}, {} displacement", setup.model.parameter_names()[k], k_letters[component])},
           {"value", field_on_face(setup.model, face, component, k, setup.problem.at, study.prior_std[k])},
           {"units", "m"},
           {"chosen", {{"x", std::move(x)}, {"y", std::move(y)}}}});
    }
  }
}

/// What the figures are drawn from.
ordered_json record_of(const project::SelectionSetup& setup, const assimilation::SelectionStudy& study) {
  const auto list = [](const auto& values) { return std::vector<double>(values.begin(), values.end()); };
  ordered_json record = {{"kind", "selection"},
                         {"parameters", setup.model.parameter_names()},
                         {"prior_std", list(study.prior_std)},
                         {"all_std", list(study.posterior_std_of_all)},
                         {"candidates", setup.candidates.size()},
                         {"curves", ordered_json::array()}};
  for (const assimilation::SelectionCurve& curve : study.curves) {
    ordered_json std = ordered_json::array();
    for (const auto& row : curve.posterior_std.rowwise()) std.push_back(list(row));
    record["curves"].push_back({{"name", curve.name}, {"std", std::move(std)}});
  }
  if (can_be_drawn(setup.model)) add_fields(record, setup, study);
  shorten_numbers(record, 5);
  return record;
}

/// Of the standard deviations that the chosen dofs leave: what they do not determine, and what all dofs
/// would.
void add_result(Page& page, const project::SelectionSetup& setup, const assimilation::SelectionStudy& study) {
  constexpr double k_hardly_determined = 0.5;  // of the prior's
  constexpr double k_much_is_lost = 1.5;       // of what all dofs leave
  const std::vector<std::string> names = setup.model.parameter_names();
  std::vector<std::string> doubts, sentences;
  for (std::size_t k = 0; k < names.size(); ++k) {
    const Eigen::Index j = k;
    const double prior = study.prior_std[j], chosen = study.ranked.back().posterior_std[j],
                 all = study.posterior_std_of_all[j];
    sentences.push_back(fmt::format("{}: standard deviation {} from the chosen dofs, {} from all; prior {}.",
                                    names[k], record::readable(chosen), record::readable(all),
                                    record::readable(prior)));
    if (all > k_hardly_determined * prior)
      doubts.push_back(fmt::format(
          "All dofs together hardly determine {}: measure elsewhere, or something else.", names[k]));
    else if (chosen > k_much_is_lost * all)
      doubts.push_back(
          fmt::format("All dofs would determine {} {} times better: a larger select.count helps.", names[k],
                      record::readable(chosen / all, 2)));
  }
  const bool is_clean = doubts.empty();
  doubts.insert(doubts.end(), sentences.begin(), sentences.end());
  page.finding(fmt::format("{} of {} dofs chosen", study.ranked.size(), setup.candidates.size()),
               is_clean ? Usability::usable : Usability::with_caveats, doubts);
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
  Page page("Data selection", fmt::format("{}, by {}", project.path, to_text(project.select.criterion)));
  const ordered_json record = record_of(setup, study);
  add_result(page, setup, study);
  std::vector<FigurePlace> curves, fields;
  for (std::size_t k = 0; k < names.size(); ++k) {
    curves.push_back({fmt::format("curve:{}", k),
                      fmt::format("Posterior standard deviation of {} against number of dofs", names[k])});
  }
  page.figures(
      curves,
      "Linearised at one point of the box; information of all steps. The same number of dofs, chosen "
      "in different ways, and all of them.");
  page.section("Sensitivity fields");
  if (record.contains("fields")) {
    for (const auto& [key, field] : record.at("fields").items())
      fields.push_back({"field:" + key, field.at("title").get<std::string>()});
    page.figures(fields, "What each parameter moves, and the chosen dofs.");
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
  return page.html(record);
}

}  // namespace knothe::report
