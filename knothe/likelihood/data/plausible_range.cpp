#include "knothe/likelihood/data/plausible_range.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "knothe/numerics/integrate/sobol.hpp"

namespace knothe::likelihood {
namespace {

using Eigen::Index;
using Rows = std::vector<Index>;

constexpr double k_margin = 100;
constexpr Index k_points = 256;  // in the box, and as many of its corners
/// At least so many are looked at; beside each other, those of a picture say nearly the same.
constexpr std::size_t k_rows_of_a_kind = 256;

/// The rows of each kind of sensor.
std::vector<Rows> kinds_of(const model::Sensors& sensors) {
  std::vector<Rows> kinds(3);
  for (std::size_t i = 0; i < sensors.displacement_count(); ++i) kinds.at(sensors.components[i]).push_back(i);
  const Index all = sensors.size();
  for (Index i = sensors.displacement_count(); i < all; ++i) kinds.push_back({i});
  return kinds;
}

/// Evenly spaced ones, where there are many.
Rows some_of(const Rows& rows) {
  const std::size_t stride = std::max<std::size_t>(1, rows.size() / k_rows_of_a_kind);
  Rows some;
  for (std::size_t k = 0; k < rows.size(); k += stride) some.push_back(rows[k]);
  return some;
}

/// The model's functions at points of its box, r × n: inside, and at its corners. Of the first 2^d points of
/// the Sobol sequence each lies in a quadrant of its own, so that up to 8 parameters no corner is left out.
Eigen::MatrixXd functions_over_box(const model::ParameterFunctions& functions) {
  const Index d = functions.dimension();
  Eigen::MatrixXd points(2 * k_points, d);
  points.topRows(k_points) = numerics::sobol_points(k_points, d, 0);
  points.bottomRows(k_points) = points.topRows(k_points).array().round();
  const Eigen::RowVectorXd lower = functions.lower(), size = functions.upper().transpose() - lower;
  points = (points * size.asDiagonal()).rowwise() + lower;
  model::FunctionBatch batch;
  batch.resize(points.rows(), d, functions.count(), 0);
  functions.evaluate(points, 0, batch);
  return batch.value.transpose();
}

/// Largest |y| of these rows; `w`: the functions at the points.
double largest_answer(const model::ObservedModel& model, const Rows& rows, const Eigen::MatrixXd& w) {
  const Eigen::MatrixXd space = model.space(rows, Eigen::all), lift = model.lift(rows, Eigen::all);
  double largest = 0;
  for (std::size_t t = 0; t < model.core.size(); ++t) {
    const Eigen::MatrixXd answers = (space * (model.core[t] * w)).colwise() + lift.col(t);
    largest = std::max(largest, answers.cwiseAbs().maxCoeff());
  }
  return largest;
}

bool has_an_end(const model::ParameterFunctions& functions) {
  return functions.lower().allFinite() && functions.upper().allFinite();
}

}  // namespace

PlausibleRange::PlausibleRange(const model::ObservedModel& model, const model::Sensors& sensors,
                               const Eigen::VectorXd& noise_std)
    : sensors_(sensors),
      limits_(Eigen::VectorXd::Constant(model.observations(), std::numeric_limits<double>::infinity())) {
  if (!has_an_end(*model.functions)) return;
  const Eigen::MatrixXd w = functions_over_box(*model.functions);
  for (const Rows& rows : kinds_of(sensors)) {
    if (rows.empty()) continue;
    double largest = largest_answer(model, some_of(rows), w);
    for (const Index i : rows)
      if (std::isfinite(noise_std[i])) largest = std::max(largest, noise_std[i]);
    for (const Index i : rows) limits_[i] = k_margin * largest;
  }
}

void PlausibleRange::limit_displacements(double limit) {
  limits_.head(sensors_.displacement_count()).setConstant(limit);
}

void PlausibleRange::limit_scalar(std::size_t k, double limit) {
  limits_[sensors_.displacement_count() + k] = limit;
}

std::string PlausibleRange::words_for(Index i, double value) const {
  const std::size_t k = i, displacements = sensors_.displacement_count();
  if (k >= displacements)
    return fmt::format("{} is {:.4g}, beyond the limit of {:.4g}", sensors_.scalars[k - displacements], value,
                       limits_[i]);
  const auto at = sensors_.point(k);
  return fmt::format("sensor {}, {} at ({:.4g}, {:.4g}, {:.4g}) m, is {:.4g} m, beyond the limit of {:.4g} m",
                     k, "xyz"[sensors_.components[k]], at[0], at[1], at[2], value, limits_[i]);
}

std::string PlausibleRange::complaint(const Eigen::Ref<const Eigen::VectorXd>& values) const {
  const Index beyond = (values.array().abs() > limits_.array()).count();
  if (beyond == 0) return "";
  Index first = 0;
  while (!(std::abs(values[first]) > limits_[first])) ++first;
  return words_for(first, values[first]) + (beyond > 1 ? fmt::format(" (and {} more)", beyond - 1) : "");
}

}  // namespace knothe::likelihood
