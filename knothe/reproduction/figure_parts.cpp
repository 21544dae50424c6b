#include "knothe/reproduction/figure_parts.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "knothe/report/figures/mesh_view.hpp"
#include "knothe/report/figures/result_figures.hpp"
#include "knothe/reproduction/published.hpp"

namespace knothe::reproduction {

std::vector<double> step_numbers(const Run& run) {
  std::vector<double> x;
  for (const assimilation::UpdateResult& r : run.steps) x.push_back(static_cast<double>(r.step));
  return x;
}

std::vector<double> stds(const Run& run, Eigen::Index k) {
  std::vector<double> y;
  for (std::size_t i = 0; i < run.steps.size(); ++i) y.push_back(run.std_at(i, k));
  return y;
}

std::vector<double> means(const Run& run, Eigen::Index k) {
  std::vector<double> y;
  for (const assimilation::UpdateResult& r : run.steps) y.push_back(r.mean[k]);
  return y;
}

std::string range_of(const std::vector<std::size_t>& steps) {
  if (steps.empty()) return "none";
  if (steps.size() == 1) return fmt::format("{}", steps.front());
  return fmt::format("{} to {}", steps.front(), steps.back());
}

Figure marginals_figure(const Run& run, const Eigen::VectorXd& truth, const std::string& subtitle,
                        std::size_t stride) {
  const report::Results results = as_results(run, truth, stride);
  Figure figure{"Successive marginals, " + subtitle, {}};
  figure.columns = 2;
  for (std::size_t k = 0; k < run.parameters.size(); ++k)
    figure.plots.push_back(report::marginals_plot(results, k));
  return figure;
}

Figure sensors_figure(const reduction::SeparatedModel& model, const Sensors& sensors,
                      const std::string& title) {
  const report::OuterFace face = report::outer_face(*model.contents().mesh);
  std::vector<report::Cell> cells;
  for (const auto& quadrilateral : face.cells) {
    report::Cell cell{{}, "#cfd8df"};
    for (const std::size_t node : quadrilateral) cell.corners.push_back(face.points[node]);
    cells.push_back(std::move(cell));
  }
  std::vector<double> x, y;
  for (std::size_t i = 0; i < sensors.size(); ++i)
    x.push_back(sensors.points[3 * i]), y.push_back(sensors.points[3 * i + 1]);
  Plot plot(title, {""}, {""});
  plot.as_map().cells(std::move(cells)).scatter(x, y, Paint::series(1), "measured nodes", 3.0);
  Figure figure = report::figure_of(std::move(plot), title, 320.0);
  figure.plot_width = 940;
  figure.plot_height = report::plot_height_of(face, figure.plot_width);
  return figure;
}

Figure surface_figure(const Surface& surface, const std::string& title, const std::vector<double>& value,
                      const std::string& unit, const std::vector<Eigen::Index>& chosen) {
  report::OuterFace face;
  for (std::size_t a = 0; a < surface.x.size(); ++a) {
    face.nodes.push_back(a);
    face.points.push_back({surface.x[a], surface.y[a]});
  }
  for (const auto& e : surface.quadrilaterals.elements) {
    std::array<std::size_t, 4> corners{};
    for (std::size_t k = 0; k < 4; ++k) corners[k] = static_cast<std::size_t>(e[k]);
    face.cells.push_back(corners);
  }
  Plot plot = report::mesh_plot(title, face, value, {}, unit);
  for (const int component : {0, 1}) {
    std::vector<double> x, y;
    for (const Eigen::Index dof : chosen) {
      const auto i = static_cast<std::size_t>(dof);
      if (surface.sensors.components[i] != component) continue;
      x.push_back(surface.sensors.points[3 * i]), y.push_back(surface.sensors.points[3 * i + 1]);
    }
    if (!x.empty())
      plot.scatter(x, y, Paint::series(component == 0 ? 1 : 2),
                   component == 0 ? "chosen, horizontal" : "chosen, vertical", component == 0 ? 3.5 : 2.5);
  }
  Figure figure = report::figure_of(std::move(plot), title, 320.0);
  figure.plot_height = report::plot_height_of(face, figure.plot_width);
  return figure;
}

forecast::ForecastSpecification crack_length(const std::string& name, double horizon) {
  forecast::ForecastSpecification f;
  f.name = name;
  f.horizon = horizon;
  f.threshold = published::k_length_prior[0];
  f.prior_mean = published::k_length_prior[0];
  f.prior_std = published::k_length_prior[1];
  return f;
}

Run forecast_run(const Subject& subject, const std::vector<forecast::ForecastSpecification>& forecasts,
                 std::uint64_t seed, const std::string& label) {
  forecast::Forecaster forecaster(subject.models.paper, subject.sensors, forecasts);
  RunOptions run;
  run.update = paper_options(seed);
  run.forecaster = &forecaster;
  run.label = label;
  return assimilate(observed(subject.models.paper, subject.sensors), subject.data, run);
}

}  // namespace knothe::reproduction
