// Time and parameter functions of a reduced model, as curves.
#include <fmt/core.h>

#include <algorithm>
#include <cmath>

#include "knothe/model/reduced/parameter_functions.hpp"
#include "knothe/numerics/functions/cubic_spline.hpp"
#include "knothe/report/data/specimen.hpp"
#include "knothe/report/data/words.hpp"

namespace knothe::report {
namespace {

using Json = nlohmann::ordered_json;

constexpr int k_line_points = 101;
constexpr std::size_t k_max_modes = 4;

Json curve(std::size_t mode, std::vector<double> y) {
  return {{"label", fmt::format("mode {}", mode + 1)}, {"y", std::move(y)}};
}

Eigen::MatrixXd values_of(const model::ParameterFunctions& functions, const Eigen::MatrixXd& points) {
  model::FunctionBatch batch;
  batch.resize(points.rows(), points.cols(), functions.count(), 0);
  functions.evaluate(points, 0, batch);
  return batch.value;
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

Json time_functions(const model::SeparatedModel& model, std::span<const double> p) {
  const auto& contents = model.contents();
  const Eigen::VectorXd w =
      values_of(*model.functions(), Eigen::Map<const Eigen::RowVectorXd>(p.data(), std::ssize(p))).row(0);
  const bool is_displacement = contents.quantities.empty() && contents.field.units == "m";
  const std::size_t n = contents.dof_count();
  Json curves = Json::array();
  for (std::size_t k = 0; k < std::min(k_max_modes, contents.space_modes); ++k) {
    double largest = 0;
    for (const double v : std::span<const double>(contents.space).subspan(k * n, n))
      largest = std::max(largest, std::abs(v));
    std::vector<double> y;
    for (std::size_t t = 0; t < contents.time.size(); ++t)
      y.push_back((is_displacement ? 1e3 : 1) * largest * amplitude(contents, k, t, w));
    curves.push_back(curve(k, std::move(y)));
  }
  return {
      {"x", contents.time},
      {"curves", std::move(curves)},
      {"xLabel", fmt::format("model time t [{}]", contents.time_units.empty() ? "–" : contents.time_units)},
      {"yLabel",
       is_displacement ? "largest displacement by the mode [mm]" : "largest value of the mode [–]"}};
}

Json parameter_functions(const model::SeparatedModel& model, std::size_t axis, std::span<const double> p) {
  const auto& contents = model.contents();
  const auto& nodes = contents.axes[axis].nodes;
  std::vector<double> x;
  for (int i = 0; i < k_line_points; ++i)
    x.push_back(i + 1 == k_line_points
                    ? nodes.back()
                    : nodes.front() + (nodes.back() - nodes.front()) * i / (k_line_points - 1.0));
  const std::size_t shown = std::min(k_max_modes, contents.parameter_modes);
  Json curves = Json::array();
  if (contents.form == model::Form::canonical) {
    for (std::size_t k = 0; k < shown; ++k) {
      const numerics::CubicSpline spline(
          nodes, std::span<const double>(contents.parameters[axis]).subspan(k * nodes.size(), nodes.size()));
      std::vector<double> y;
      for (const double at : x) y.push_back(spline.value(at));
      curves.push_back(curve(k, std::move(y)));
    }
  } else {
    Eigen::MatrixXd points(k_line_points, std::ssize(p));
    for (Eigen::Index i = 0; i < points.cols(); ++i) points.col(i).setConstant(p[i]);
    points.col(axis) = Eigen::Map<const Eigen::VectorXd>(x.data(), k_line_points);
    const Eigen::MatrixXd values = values_of(*model.functions(), points);
    for (std::size_t k = 0; k < shown; ++k) {
      const auto column = values.col(k);
      curves.push_back(curve(k, {column.begin(), column.end()}));
    }
  }
  return {{"x", x},
          {"curves", std::move(curves)},
          {"xLabel", pretty_name(contents.axes[axis].name) + " [–]"},
          {"yLabel", "parameter function [–]"}};
}

}  // namespace

Json functions_record(const model::SeparatedModel& model, std::span<const double> p) {
  Json records = Json::array({time_functions(model, p)});
  for (std::size_t axis = 0; axis < model.contents().axes.size(); ++axis)
    records.push_back(parameter_functions(model, axis, p));
  return records;
}

}  // namespace knothe::report
