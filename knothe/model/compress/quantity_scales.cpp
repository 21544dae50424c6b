#include "knothe/model/compress/quantity_scales.hpp"

#include <fmt/format.h>

#include <cmath>

#include "knothe/base/index.hpp"

namespace knothe::model {
namespace {

/// Rows of n_dof values, each multiplied or divided.
void scale_rows(std::vector<double>& rows, const std::vector<double>& scales, bool divide) {
  for (Index i = 0; i < std::ssize(rows); ++i) {
    const double scale = scales[i % scales.size()];
    rows[i] = divide ? rows[i] / scale : rows[i] * scale;
  }
}

/// Of the values [grid, n_t] of one quantity.
double scale_of(const std::vector<double>& values, std::size_t times) {
  const std::size_t grid = values.size() / times;
  double variation = 0, size = 0;
  for (std::size_t t = 0; t < times; ++t) {
    double mean = 0;
    for (std::size_t g = 0; g < grid; ++g) mean += values[g * times + t] / grid;
    for (std::size_t g = 0; g < grid; ++g) {
      const double value = values[g * times + t];
      variation += (value - mean) * (value - mean);
      size += value * value;
    }
  }
  const double square = variation > 1e-24 * size ? variation : size;
  return square > 0 ? std::sqrt(square / values.size()) : 1.0;
}

}  // namespace

QuantityScales::QuantityScales(const Snapshots& snapshots) {
  const std::size_t dofs = snapshots.dof_count();
  std::vector<double> values;
  for (std::size_t dof = 0; dof < dofs; ++dof) {
    values.clear();
    for (std::size_t i = dof; i < snapshots.values.size(); i += dofs) values.push_back(snapshots.values[i]);
    scales_.push_back(scale_of(values, snapshots.time.size()));
  }
}

QuantityScales::QuantityScales(const SeparatedModel& model) : scales_(model.dof_count(), 1.0) {
  for (const SnapshotOutput& output : model.contents().outputs)
    if (const auto dof = model.quantity(output.name))
      scales_[*dof] = scale_of(output.values, model.step_count());
}

Snapshots QuantityScales::scaled(Snapshots snapshots) const {
  scale_rows(snapshots.values, scales_, true);
  scale_rows(snapshots.lift, scales_, true);
  return snapshots;
}

std::vector<OffGridSolution> QuantityScales::scaled(std::span<const OffGridSolution> solutions) const {
  std::vector<OffGridSolution> result(solutions.begin(), solutions.end());
  for (OffGridSolution& solution : result) scale_rows(solution.values, scales_, true);
  return result;
}

ModelContents QuantityScales::scaled(ModelContents model) const {
  scale_rows(model.space, scales_, true);
  scale_rows(model.lift, scales_, true);
  return model;
}

void QuantityScales::restore(ModelContents& model) const {
  restore(model.space);
  restore(model.lift);
}

void QuantityScales::restore(std::vector<double>& rows) const {
  scale_rows(rows, scales_, false);
}

ModelError off_grid_error_in_scales(const Snapshots& snapshots, const ModelContents& model, std::size_t count,
                                    const std::function<OffGridSolution(std::size_t)>& solution,
                                    std::size_t threads) {
  // Fields of many dofs are kept in a basis: they have one unit.
  if (model.quantities.empty() || snapshots.dof_count() != model.quantities.size())
    return off_grid_error(model, count, solution, threads);
  const QuantityScales scales(snapshots);
  const auto scaled = [&](std::size_t i) {
    const OffGridSolution at = solution(i);
    return scales.scaled({&at, 1}).front();
  };
  return off_grid_error(scales.scaled(model), count, scaled, threads);
}

std::string largest_error(double error, const std::vector<Quantity>& quantities) {
  if (quantities.empty()) return fmt::format("at most {:.3g} µm on any dof", error * 1e6);
  return fmt::format("at most {:.2g} of how a quantity varies (root mean square)", error);
}

}  // namespace knothe::model
