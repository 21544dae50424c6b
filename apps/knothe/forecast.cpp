#include <fmt/format.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "apps/knothe/commands.hpp"
#include "knothe/assimilation/forecast/forecaster.hpp"
#include "knothe/base/console.hpp"
#include "knothe/base/error.hpp"
#include "knothe/files/json_line.hpp"
#include "knothe/project/project_file.hpp"
#include "knothe/project/update_setup.hpp"
#include "knothe/record/assimilation_output.hpp"
#include "knothe/record/forecast_text.hpp"
#include "knothe/record/posterior_file.hpp"
#include "knothe/record/step_record.hpp"

namespace knothe::commands {

int forecast(const ForecastArguments& arguments) {
  const project::Project project = project::read_project(arguments.project);
  project.require(!project.forecasts.empty(), "at least one table [forecast.NAME]");
  const project::UpdateSetup setup = project::set_up(project);
  const std::string path = (std::filesystem::path(project.results) / "posterior.nc").string();
  const assimilation::UpdateResult stored = record::read_last_posterior(path, setup.model.parameter_names());
  assimilation::Forecaster forecaster = project::make_forecaster(project, setup);
  auto forecasts = forecaster.update(stored.points, stored.weights);
  assimilation::mark_past(forecasts, stored.time);
  using Density = assimilation::Forecaster::FieldDensity;
  const auto published = forecaster.published(stored.points, stored.weights,
                                              arguments.inverse_map ? Density::inverse_map : Density::normal);
  if (arguments.json) {
    nlohmann::ordered_json line = {{"step", stored.step}, {"time", stored.time}};
    line["forecast"] = record::forecast_record(forecasts, true);
    line["published"] = record::forecast_record(published, false);
    fmt::print("{}\n", files::json_line(line));
    return 0;
  }
  const Eigen::VectorXd mean = stored.points.transpose() * stored.weights;
  const auto loading = model::loading_of(setup.model, project.clock, {mean.begin(), mean.end()});
  fmt::print("forecasts from the posterior after step {} (at {})\n", stored.step,
             record::horizon_text(stored.time, loading));
  const record::Precision precision(stored.verdict);
  for (const assimilation::NamedForecast& named : forecasts) {
    fmt::print("{}\n", for_people("  " + record::forecast_text(named, loading, precision), stdout, 2));
    if (named.bridge_residual_rms) {
      fmt::print(
          "    rms difference between the elastic crack and the predicted displacements at the sensors: "
          "{:.2g} µm\n",
          *named.bridge_residual_rms * 1e6);
    }
  }
  for (const assimilation::NamedForecast& named : published) {
    fmt::print(
        "  {} by Eq. 33 of the paper ({} of the predicted field): {}\n", named.name,
        arguments.inverse_map ? "inverse transport map" : "Gaussian approximation",
        record::value_text(named.forecast.mean, precision.of_forecast(named.forecast.std), "m", precision));
  }
  if (stored.verdict.level != assimilation::VerdictLevel::ok)
    fmt::print("{}\n", for_people(record::shown_verdict(stored.verdict, stdout), stdout, 2));
  return 0;
}

}  // namespace knothe::commands
