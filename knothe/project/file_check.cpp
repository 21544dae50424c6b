#include "knothe/project/file_check.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "knothe/base/text.hpp"
#include "knothe/likelihood/step/posterior_functions.hpp"
#include "knothe/likelihood/step/prior_of_model.hpp"
#include "knothe/model/simulator/command_simulator.hpp"
#include "knothe/numerics/linear/symmetric_eigen.hpp"
#include "knothe/project/field_measurements.hpp"
#include "knothe/project/field_steps.hpp"
#include "knothe/project/simulation.hpp"
#include "knothe/project/update_setup.hpp"

namespace knothe::project {
namespace {

using Eigen::Index;

/// The model's answers over the prior at the times of the data.
struct PriorAnswers {
  Eigen::MatrixXd mean;  ///< n_obs × n_t
  /// d × d: Σ over sensors and times of products of changes per standard deviation of the prior, over noise².
  Eigen::MatrixXd information;
  Eigen::VectorXd largest;  ///< n_obs: of |y|, mean and two standard deviations
};

PriorAnswers answers_of(const UpdateSetup& setup) {
  const model::ObservedModel& model = *setup.problem.model;
  const auto transform = likelihood::truncated_to_box(model, setup.problem.priors);
  const auto w = likelihood::prior_functions(*model.functions, *transform);
  const Eigen::VectorXd std = setup.measurements.noise.measurement().standard_deviations();
  PriorAnswers answers;
  answers.mean.resize(model.observations(), std::ssize(setup.time_indices));
  answers.information = Eigen::MatrixXd::Zero(w.tangent.cols(), w.tangent.cols());
  answers.largest = Eigen::VectorXd::Zero(model.observations());
  for (std::size_t k = 0; k < setup.time_indices.size(); ++k) {
    const std::size_t t = setup.time_indices[k];
    auto mean = answers.mean.col(k);
    mean = model.lift.col(t) + model.space * (model.core[t] * w.mean);
    const Eigen::MatrixXd change = model.space * (model.core[t] * w.tangent);
    const Eigen::VectorXd spread = (model.space * (model.core[t] * w.factor)).rowwise().norm();
    answers.largest = answers.largest.cwiseMax(mean.cwiseAbs() + 2 * spread);
    for (Index i = 0; i < change.rows() && i < std.size(); ++i)
      if (std[i] > 0) answers.information += change.row(i).transpose() * change.row(i) / (std[i] * std[i]);
  }
  return answers;
}

/// Of a component, or of a scalar series: the data's largest value beside the model's.
void compare_magnitudes(const UpdateSetup& setup, const PriorAnswers& answers, FileCheck& check) {
  const model::Sensors& sensors = setup.measurements.sensors;
  const auto compare = [&](const std::string& what, const std::vector<Index>& rows) {
    double measured = 0, expected = 0;
    for (const Index i : rows) {
      for (const double value : setup.measurements.values.row(i))
        if (!std::isnan(value)) measured = std::max(measured, std::abs(value));
      expected = std::max(expected, answers.largest[i]);
    }
    if (rows.empty() || !(measured > 0) || !(expected > 0)) return;
    const double ratio = measured / expected;
    if (ratio > 0.1 && ratio < 10) return;
    check.warnings.push_back(fmt::format(
        "the largest of {} is {:.3g}, the model's {:.3g} over the prior: check the unit (a factor of {:.2g})",
        what, measured, expected, ratio));
  };
  for (int c = 0; c < 3; ++c) {
    std::vector<Index> rows;
    for (std::size_t i = 0; i < sensors.displacement_count(); ++i)
      if (sensors.components[i] == c) rows.push_back(i);
    compare(fmt::format("the displacements along {} (m)", "xyz"[c]), rows);
  }
  for (std::size_t k = 0; k < sensors.scalars.size(); ++k)
    compare("\"" + sensors.scalars[k] + "\"", {static_cast<Index>(sensors.displacement_count() + k)});
}

void check_sensitivity(const UpdateSetup& setup, const PriorAnswers& answers, FileCheck& check) {
  const Index d = answers.information.rows();
  // Of the parameters together: what several explain alike is known of none. (I + information)⁻¹, which
  // keeps the I however large the rest.
  const numerics::SymmetricEigen axes(answers.information);
  const Eigen::VectorXd variance = (1 + axes.eigenvalues().array().max(0)).inverse();
  for (Index a = 0; a < d; ++a) {
    const double factor = 1 / std::sqrt(axes.eigenvectors().row(a).cwiseAbs2().dot(variance));
    const std::string& name = setup.problem.model->parameters[a];
    if (factor < 1.5)
      check.warnings.push_back(fmt::format(
          "the data carry almost no information on {}: together they narrow its prior by a factor of {:.2g}; "
          "measure where it moves the structure (`knothe select`), or more accurately",
          name, factor));
    else
      check.facts.push_back(
          fmt::format("{}: the data can narrow its prior by a factor of about {:.0f}", name, factor));
  }
}

/// What the runs of another program need: its files, and a place for each parameter.
void check_command(const Project& project) {
  if (!project.offline || !project.offline->command) return;
  std::vector<model::Axis> axes;
  for (const OfflineParameter& p : project.offline->parameters)
    axes.push_back({p.name, {p.lower, p.upper}, p.units, p.long_name, p.reference});
  (void)model::CommandSimulator(*project.offline->command, std::move(axes));
}

/// What [simulate] measures, where the model that says what there is to measure has been made.
void check_simulation(const Project& project) {
  if (!project.simulate || project.simulate->noise.empty() || !std::filesystem::exists(project.model)) return;
  const auto model = model::SeparatedModel::load(project.model);
  if (model.contents().quantities.empty())
    (void)measured_quantities(project, model.output_names());
  else
    (void)measured_quantities(project, model.contents().quantities);
}

}  // namespace

FileCheck check_files(const Project& project) {
  FileCheck check;
  check_command(project);
  check_simulation(project);
  check.warnings = truth_outside_box(project);
  const PictureOptions& pictures = project.pictures;
  const bool fields = !project.fields.files.empty();
  // A pattern of names is looked up where the fields are read.
  const std::string data = fields ? fields_folder(project.fields) : project.data;
  std::vector<std::string> files = {project.model,        data,
                                    pictures.folder,      pictures.series.mask,
                                    pictures.cameras,     pictures.calibration_std,
                                    project.fields.steps, project.fields.reference};
  files.insert(files.end(), pictures.other_folders.begin(), pictures.other_folders.end());
  for (const DataSource& source : project.sources) files.push_back(source.file);
  if (pictures.folder.empty())
    for (const auto* list : {&pictures.references, &pictures.pictures})
      files.insert(files.end(), list->begin(), list->end());
  for (const std::string& file : files)
    if (!file.empty() && !std::filesystem::exists(file)) check.missing.push_back(file);
  // Pictures are looked at when they are correlated.
  if (project.model.empty() || project.data.empty() || !pictures.cameras.empty() || !check.missing.empty())
    return check;
  if (fields) check.facts = measure_fields(project, load_model(project).contents()).read;
  const UpdateSetup setup = set_up(project);
  (void)make_forecaster(project, setup);
  (void)make_decider(project, setup);
  if (!project.serve.limits.empty()) (void)serve_limits(project, setup);
  check.facts.push_back(fmt::format("model: {}, {}, {}",
                                    counted(setup.problem.model->parameters.size(), "parameter"),
                                    counted(setup.model.contents().time.size(), "time"),
                                    counted(setup.model.contents().dof_count(), "dof")));
  check.facts.push_back(fmt::format("data: {} at {}, inside the model",
                                    counted(setup.problem.model->observations(), "sensor"),
                                    counted(setup.time_indices.size(), "time")));
  for (const std::string& name : setup.unused)
    check.warnings.push_back(fmt::format("the series \"{}\" is not used: it has no std", name));
  const PriorAnswers answers = answers_of(setup);
  check_sensitivity(setup, answers, check);
  compare_magnitudes(setup, answers, check);
  return check;
}

}  // namespace knothe::project
