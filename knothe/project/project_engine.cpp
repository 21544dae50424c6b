#include "knothe/project/project_engine.hpp"

#include <cmath>
#include <filesystem>
#include <limits>

#include "knothe/model/reduced/truncation_error.hpp"
#include "knothe/project/forecast_scoring.hpp"

namespace knothe::project {
namespace {

/// Relative to the project file's folder; an absolute path has no such name from a relative folder.
std::string name_of(const std::string& file, const Project& project) {
  const auto path =
      std::filesystem::path(file).lexically_relative(project.folder.empty() ? "." : project.folder);
  return path.empty() ? file : path.string();
}

assimilation::CandidateModel candidate(const Project& project, const std::string& file,
                                       const UpdateSetup& first) {
  Project other = project;
  other.model = file;
  const UpdateSetup setup = set_up(other);
  assimilation::CandidateModel model{name_of(file, project), setup.problem, {}};
  model.time_indices.assign(first.problem.model->time.size(), std::numeric_limits<std::size_t>::max());
  for (std::size_t i = 0; i < first.problem.model->time.size(); ++i)
    for (std::size_t j = 0; j < setup.problem.model->time.size(); ++j)
      if (std::abs(first.problem.model->time[i] - setup.problem.model->time[j]) < 1e-9)
        model.time_indices[i] = j;
  // The data's own times may differ by rounding.
  for (std::size_t i = 0; i < first.time_indices.size(); ++i)
    model.time_indices[first.time_indices[i]] = setup.time_indices[i];
  return model;
}

}  // namespace

assimilation::EngineSetup engine_setup(const Project& project, const UpdateSetup& setup) {
  assimilation::EngineSetup engine;
  static_cast<assimilation::Problem&>(engine) = setup.problem;
  engine.forecaster = make_forecaster(project, setup);
  engine.decider = make_decider(project, setup);
  engine.scores = forecasts_to_score(project, setup);
  // A node on a crack is no sensor that fell silent, nor is a camera's drift.
  engine.sensors = setup.measurements.sensors;
  engine.known_errors =
      model::observe_off_grid(model::read_truncation_error(project.model), setup.model.contents(),
                              project.model, setup.measurements.sensors, project.sensors,
                              setup.problem.model->time, setup.problem.model->observations());
  for (const model::Axis& axis : setup.model.contents().axes)
    engine.axes.push_back({axis.name, {}, axis.units, axis.long_name, axis.reference});
  engine.watches_sensors = !setup.pictures && setup.measurements.noise.measurement().is_independent();
  engine.name = name_of(project.model, project);
  for (const std::string& file : project.candidates)
    engine.candidates.push_back(candidate(project, file, setup));
  return engine;
}

std::optional<RecordedData::Item> RecordedData::next(const Eigen::VectorXd& mean) {
  if (next_ == size()) return std::nullopt;
  const std::size_t step = next_++;
  const std::vector<std::size_t>& time = setup_.time_indices;
  Item item;
  item.datum.key.seq = step;
  item.datum.step = step;
  item.datum.time_index = time[step];
  const Eigen::Index column = step;
  if (setup_.pictures) {
    const Eigen::Index displacements = setup_.pictures->measurements().values.rows();
    if (mean.size() != 0 && step + 1 < size()) {
      const Eigen::VectorXd increment = setup_.problem.model->predict(mean, time[step + 1]) -
                                        setup_.problem.model->predict(mean, time[step]);
      setup_.pictures->set_increment(increment.head(displacements));
    }
    item.picture = setup_.pictures->next();
    item.datum.noise = item.picture->noise;
    if (item.datum.noise) item.datum.noise = with_series_noise(*item.datum.noise, setup_.measurements);
    setup_.measurements.values.col(column).head(displacements) = item.picture->values;
  }
  item.datum.values = setup_.measurements.values.col(column);
  return item;
}

}  // namespace knothe::project
