#include "apps/knothe-offline/model_study.hpp"

#include <fmt/format.h>

#include <array>
#include <nlohmann/json.hpp>

#include "knothe/assimilation/synthetic_measurements.hpp"
#include "knothe/files/json_line.hpp"
#include "knothe/project/simulation.hpp"
#include "knothe/reduction/observed_model.hpp"

namespace knothe::offline_commands {
namespace {

using reduction::ObservedModel;

/// Synthetic data of the uncompressed model at the project's truth, and the posterior they give: the judge.
struct Judge {
  std::shared_ptr<const ObservedModel> model;
  std::vector<std::size_t> dofs;
  assimilation::Measurements data;
  std::vector<assimilation::Prior> priors;
};

std::optional<Judge> make_judge(const project::Project& project, const reduction::Snapshots& snapshots) {
  if (!project.simulate || project.parameters.size() != snapshots.axes.size()) return std::nullopt;
  std::vector<std::string> names;
  Judge judge;
  for (const reduction::Axis& axis : snapshots.axes) {
    for (const project::NamedPrior& parameter : project.parameters) {
      if (parameter.name == axis.name) judge.priors.push_back(parameter.prior);
    }
    names.push_back(axis.name);
  }
  if (judge.priors.size() != names.size()) return std::nullopt;
  const std::vector<double> truth = project::simulated_truth(project, names);
  const project::SimulateOptions& options = *project.simulate;
  judge.dofs = assimilation::choose_dofs(snapshots.dofs, project::dof_selection(options), options.seed);
  std::vector<double> points;
  std::vector<std::int64_t> components;
  for (std::size_t dof : judge.dofs) {
    points.insert(points.end(), &snapshots.dofs.points[3 * dof], &snapshots.dofs.points[3 * dof] + 3);
    components.push_back(snapshots.dofs.components[dof]);
  }
  judge.model =
      std::make_shared<const ObservedModel>(reduction::observe_snapshots(snapshots, points, components));
  const Eigen::VectorXd p =
      Eigen::Map<const Eigen::VectorXd>(truth.data(), static_cast<Eigen::Index>(truth.size()));
  Eigen::MatrixXd exact(static_cast<Eigen::Index>(judge.dofs.size()),
                        static_cast<Eigen::Index>(snapshots.time.size()));
  for (std::size_t t = 0; t < snapshots.time.size(); ++t) {
    exact.col(static_cast<Eigen::Index>(t)) = judge.model->predict(p, t);
  }
  judge.data = assimilation::add_noise(snapshots.dofs, judge.dofs, snapshots.time, exact, options.noise_std,
                                       options.seed);
  return judge;
}

}  // namespace

std::vector<StudyLine> study_models(const project::Project& project, const reduction::Snapshots& snapshots,
                                    const std::vector<reduction::OffGridSolution>& off_grid) {
  const std::optional<Judge> judge = make_judge(project, snapshots);
  std::vector<StudyLine> lines;
  for (const reduction::Form form : {reduction::Form::canonical, reduction::Form::tree}) {
    std::vector<std::size_t> modes;
    for (std::size_t m : {3u, 6u, 10u, 20u, 30u, 50u}) {
      // Alternating least squares with 50 canonical modes would take minutes and change nothing in the
      // picture.
      if (m < snapshots.grid_size() && (m <= 30 || form == reduction::Form::tree)) modes.push_back(m);
    }
    reduction::CompressionOptions options;
    options.form = form;
    for (reduction::StudiedModel& studied :
         reduction::compression_study(snapshots, options, modes, off_grid)) {
      StudyLine line{form, studied.row, std::nullopt};
      if (judge) {
        const reduction::SeparatedModel model(std::move(studied.model));
        const auto observed =
            std::make_shared<const ObservedModel>(reduction::observe_dofs(model, judge->dofs));
        line.shift = assimilation::summarise(assimilation::posterior_shift(
            observed, judge->model, judge->data.values, judge->data.noise, judge->priors));
      }
      lines.push_back(std::move(line));
    }
  }
  return lines;
}

void report_study(const std::vector<StudyLine>& lines, bool json) {
  if (!json) {
    fmt::print(
        "\nWhat the number of modes costs. Errors on the parameter grid, and at points off it; shift of the "
        "posterior of\n"
        "synthetic data from that of the uncompressed snapshots, in posterior std (worst step / last step).\n"
        "                        on the grid                  off the grid\n"
        "  form       modes   error   of u-lift  max µm   of u-lift  max µm   shift of mean   std wrong "
        "by\n");
  }
  for (const StudyLine& line : lines) {
    const auto& e = line.errors.training;
    if (json) {
      nlohmann::ordered_json record = {{"form", reduction::to_text(line.form)},
                                       {"modes", line.errors.parameter_modes},
                                       {"space_modes", line.errors.space_modes},
                                       {"relative_error", e.relative},
                                       {"relative_error_without_lift", e.relative_to_lift},
                                       {"max_error_m", e.max}};
      if (line.errors.off_grid) {
        record["off_grid"] = {{"relative_error", line.errors.off_grid->relative},
                              {"relative_error_without_lift", line.errors.off_grid->relative_to_lift},
                              {"max_error_m", line.errors.off_grid->max}};
      }
      if (line.shift) {
        record["shift_of_mean"] = {{"worst", line.shift->worst_mean.mean},
                                   {"worst_step", line.shift->worst_mean.step},
                                   {"last", line.shift->last.mean}};
        record["error_of_std"] = {{"worst", line.shift->worst_std.std},
                                  {"worst_step", line.shift->worst_std.step},
                                  {"last", line.shift->last.std}};
      }
      fmt::print("{}\n", files::json_line(record));
      continue;
    }
    std::string shift = "        –              –";
    if (line.shift) {
      shift = fmt::format("{:7.2f} / {:4.2f}  {:7.1f} % / {:.1f} %", line.shift->worst_mean.mean,
                          line.shift->last.mean, 100 * line.shift->worst_std.std, 100 * line.shift->last.std);
    }
    std::string off_grid = "      –        –";
    if (line.errors.off_grid) {
      off_grid = fmt::format("{:.1e}  {:7.3f}", line.errors.off_grid->relative_to_lift,
                             line.errors.off_grid->max * 1e6);
    }
    fmt::print("  {:<10} {:5}  {:.1e}  {:.1e}  {:7.3f}    {}  {}\n", reduction::to_text(line.form),
               line.errors.parameter_modes, e.relative, e.relative_to_lift, e.max * 1e6, off_grid, shift);
  }
  if (!json) fmt::print("\n");
}

}  // namespace knothe::offline_commands
