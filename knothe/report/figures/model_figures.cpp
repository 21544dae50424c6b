#include "knothe/report/figures/model_figures.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>

#include "knothe/model/reduced/parameter_functions.hpp"
#include "knothe/numerics/functions/cubic_spline.hpp"
#include "knothe/record/number_text.hpp"
#include "knothe/report/figures/mesh_view.hpp"
#include "knothe/report/figures/result_figures.hpp"

namespace knothe::report {
namespace {

constexpr int k_line_points = 101;

/// The outer face with the dofs that move its nodes.
struct FaceDofs {
  OuterFace face;
  std::vector<std::ptrdiff_t> x, y;
};

FaceDofs face_of(const model::SeparatedModel& model) {
  const auto& contents = model.contents();
  FaceDofs result{outer_face(*contents.mesh), {}, {}};
  result.x = dofs_of_face(result.face, contents.dofs, 0);
  result.y = dofs_of_face(result.face, contents.dofs, 1);
  return result;
}

/// Mesh figure of the horizontal component of `field` (n_dof) times `scale`; deformed so that the largest
/// movement is 6 % of the face's length at most, or not at all where the model lacks a component.
Figure field_figure(const std::string& title, const FaceDofs& f, std::span<const double> field, double scale,
                    const std::string& label) {
  const auto at = [&](std::ptrdiff_t dof) { return dof < 0 ? 0.0 : field[dof]; };
  std::vector<double> value;
  double largest = 0.0, low = INFINITY, high = -INFINITY;
  for (std::size_t i = 0; i < f.face.points.size(); ++i) {
    value.push_back(scale * at(f.x[i]));
    largest = std::max({largest, std::abs(at(f.x[i])), std::abs(at(f.y[i]))});
    low = std::min(low, f.face.points[i][0]), high = std::max(high, f.face.points[i][0]);
  }
  const double length = high - low;
  std::vector<std::array<double, 2>> shift;
  const double exaggeration = largest > 0.0 ? 0.03 * length / largest : 0.0;
  for (std::size_t i = 0; i < value.size(); ++i)
    shift.push_back({exaggeration * at(f.x[i]), exaggeration * at(f.y[i])});
  Figure figure{title, {mesh_plot(title, f.face, value, shift, label)}};
  figure.plot_height = plot_height_of(f.face, figure.plot_width);
  return figure;
}

std::span<const double> space_mode(const model::ModelContents& contents, std::size_t k) {
  const std::size_t n = contents.dof_count();
  return std::span<const double>(contents.space).subspan(k * n, n);
}

double largest_magnitude(std::span<const double> values) {
  double largest = 0.0;
  for (double v : values) largest = std::max(largest, std::abs(v));
  return largest;
}

Eigen::VectorXd functions_at(const model::SeparatedModel& model, std::span<const double> p) {
  const auto& functions = *model.functions();
  Eigen::MatrixXd point(1, functions.dimension());
  for (Eigen::Index i = 0; i < point.cols(); ++i) point(0, i) = p[i];
  model::FunctionBatch batch;
  batch.resize(1, point.cols(), functions.count(), 0);
  functions.evaluate(point, 0, batch);
  return batch.value.row(0);
}

/// Amplitude of space mode k at time step t: Σ_j c_kj(t) w_j.
double amplitude(const model::ModelContents& contents, std::size_t k, std::size_t t,
                 const Eigen::VectorXd& w) {
  if (contents.form == model::Form::canonical) return contents.temporal[k * contents.time.size() + t] * w[k];
  const std::size_t l = contents.space_modes, r = contents.parameter_modes;
  double sum = 0.0;
  for (std::size_t j = 0; j < r; ++j) sum += contents.temporal[(t * l + k) * r + j] * w[j];
  return sum;
}

/// A mode of a model, scaled such that its largest horizontal component is 1.
Figure mode_figure(const std::string& title, const FaceDofs& face, std::span<const double> mode) {
  double largest = 0.0;
  for (std::ptrdiff_t dof : face.x)
    if (dof >= 0) largest = std::max(largest, std::abs(mode[dof]));
  return field_figure(title, face, mode, largest > 0.0 ? 1.0 / largest : 1.0, "x component");
}

}  // namespace

bool can_be_drawn(const model::SeparatedModel& model) {
  const auto& contents = model.contents();
  return contents.mesh && contents.mesh->nodes_per_cell == 8 && !contents.dofs.empty();
}

std::vector<Figure> space_mode_figures(const model::SeparatedModel& model, std::size_t count) {
  const auto& contents = model.contents();
  const FaceDofs face = face_of(model);
  std::vector<Figure> figures;
  for (std::size_t k = 0; k < std::min(count, contents.space_modes); ++k) {
    const auto mode = space_mode(contents, k);
    figures.push_back(mode_figure(fmt::format("Space mode {}", k + 1), face, mode));
  }
  return figures;
}

Plot time_functions_plot(const model::SeparatedModel& model, std::span<const double> p, std::size_t count) {
  const auto& contents = model.contents();
  const Eigen::VectorXd w = functions_at(model, p);
  const bool is_displacement = contents.quantities.empty() && contents.field.units == "m";
  Plot plot("Time functions", {"model time"},
            {is_displacement ? "largest displacement by the mode (µm)" : "largest value of the mode"});
  for (std::size_t k = 0; k < std::min(count, contents.space_modes); ++k) {
    const double scale = (is_displacement ? 1e6 : 1) * largest_magnitude(space_mode(contents, k));
    std::vector<double> y;
    for (std::size_t t = 0; t < contents.time.size(); ++t) y.push_back(scale * amplitude(contents, k, t, w));
    plot.line(contents.time, y, Paint::series(k), fmt::format("mode {}", k + 1));
  }
  return plot;
}

Plot parameter_functions_plot(const model::SeparatedModel& model, std::size_t axis, std::span<const double> p,
                              std::size_t count) {
  const auto& contents = model.contents();
  const auto& nodes = contents.axes[axis].nodes;
  const std::string name = pretty_name(contents.axes[axis].name);
  Plot plot("Parameter functions along " + name, {name}, {"value"});
  std::vector<double> x;
  for (int i = 0; i < k_line_points; ++i)
    x.push_back(i + 1 == k_line_points
                    ? nodes.back()
                    : nodes.front() + (nodes.back() - nodes.front()) * i / (k_line_points - 1.0));
  const std::size_t shown = std::min(count, contents.parameter_modes);
  if (contents.form == model::Form::canonical) {
    for (std::size_t k = 0; k < shown; ++k) {
      const numerics::CubicSpline spline(
          nodes, std::span<const double>(contents.parameters[axis]).subspan(k * nodes.size(), nodes.size()));
      std::vector<double> y;
      for (double at : x) y.push_back(spline.value(at));
      plot.line(x, y, Paint::series(k), fmt::format("mode {}", k + 1));
    }
    return plot;
  }
  const auto& functions = *model.functions();
  Eigen::MatrixXd points(k_line_points, functions.dimension());
  for (Eigen::Index i = 0; i < points.cols(); ++i) points.col(i).setConstant(p[i]);
  points.col(axis) = Eigen::Map<const Eigen::VectorXd>(x.data(), k_line_points);
  model::FunctionBatch batch;
  batch.resize(points.rows(), points.cols(), functions.count(), 0);
  functions.evaluate(points, 0, batch);
  for (std::size_t k = 0; k < shown; ++k) {
    const Eigen::VectorXd y = batch.value.col(k);
    plot.line(x, std::span<const double>(y.data(), x.size()), Paint::series(k),
              fmt::format("mode {}", k + 1));
  }
  return plot;
}

Figure displacement_figure(const model::SeparatedModel& model, std::span<const double> p, std::size_t step) {
  const auto field = model.evaluate(p, step);
  return field_figure("Displacement, exaggerated", face_of(model), field.value, 1e6, "horizontal, µm");
}

std::vector<Figure> crack_figures(const model::SeparatedModel& model, std::span<const double> lengths) {
  const auto& crack = model.contents().crack;
  std::vector<Figure> figures;
  if (crack.empty()) return figures;
  const FaceDofs face = face_of(model);
  const std::size_t n = model.dof_count(), modes = crack.modes.size() / n;
  for (double wanted : lengths) {
    std::size_t best = 0;
    for (std::size_t i = 0; i < crack.length.size(); ++i)
      if (std::abs(crack.length[i] - wanted) < std::abs(crack.length[best] - wanted)) best = i;
    std::vector<double> field(n, 0.0);
    for (std::size_t k = 0; k < modes; ++k)
      for (std::size_t j = 0; j < n; ++j)
        field[j] += crack.coefficients[best * modes + k] * crack.modes[k * n + j];
    figures.push_back(
        field_figure(fmt::format("Elastic beam, crack of {} mm", record::plain(1e3 * crack.length[best])),
                     face, field, 1.0, "horizontal, m per m"));
  }
  return figures;
}

}  // namespace knothe::report
