#include "knothe/model/compress/compression.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <limits>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/base/progress.hpp"
#include "knothe/model/compress/quantity_scales.hpp"
#include "knothe/model/compress/separation.hpp"

namespace knothe::model {

namespace {

void set_errors(ModelContents& model, const ModelError& error) {
  model.relative_error = std::max(error.relative, error.plain_relative);
  model.max_error_m = error.max;
}

bool good_enough(const ModelError& error, double tolerance) {
  return error.relative <= tolerance && error.plain_relative <= tolerance;
}

/// ‖u‖² with the quadrature weights.
double squared_norm(const Snapshots& snapshots, const Deviation& deviation) {
  double sum = 0.0;
  for (std::size_t g = 0; g < snapshots.grid_size(); ++g) {
    const Eigen::Map<const Eigen::MatrixXd> u(snapshots.solution(g).data(), deviation.dofs(),
                                              deviation.times());
    const Eigen::VectorXd by_time = u.colwise().squaredNorm();
    sum += deviation.grid_weights()[g] * deviation.time_weights().dot(by_time);
  }
  return sum;
}

/// The first `modes` parameter functions, whatever they leave out.
SpaceSearch search_for(std::size_t modes, const CompressionOptions& options) {
  return {.allowed = std::numeric_limits<double>::infinity(),
          .at_least = static_cast<Index>(modes),
          .converge = true,
          .seed = options.seed};
}

/// Tree form: the singular values tell how many modes a tolerance needs; checked, and made longer if the
/// unweighted norm asks for more.
ModelContents compress_tree(const Snapshots& snapshots, const Deviation& deviation,
                            const ParameterProduct& product, const CompressionOptions& options) {
  ModelContents model = frame_of(snapshots, deviation);
  const ParameterUnfolding unfolding(deviation, product, options.threads);
  SpaceSearch search = search_for(options.modes, options);
  if (options.modes == 0) {
    // A little of the squared error is left for the space basis (k_space_share).
    search.allowed =
        std::max(0.999 * options.tolerance * options.tolerance * squared_norm(snapshots, deviation),
                 TreeSeparation::k_rounding * unfolding.squared_norm());
  }
  double floor = TreeSeparation::k_rounding;
  while (true) {
    const TreeSeparation separation(deviation, product, dominant_space(unfolding, search), options, floor);
    const Index modes = separation.modes();
    separation.fill(model, modes);
    const ModelError error = training_error(model, snapshots, options.threads);
    set_errors(model, error);
    const bool all = modes == std::min(unfolding.rows(), unfolding.cols()) && floor == 0.0;
    if (options.modes != 0 || good_enough(error, options.tolerance) || all) return model;
    search.at_least = modes + std::max<Index>(1, modes / 8);
    floor = floor > 1e-18 ? 1e-4 * floor : 0.0;
  }
}

ModelContents compress_canonical(const Snapshots& snapshots, const Deviation& deviation,
                                 const ParameterProduct& product, const CompressionOptions& options) {
  ModelContents model = frame_of(snapshots, deviation);
  CanonicalSeparation separation(deviation, product, snapshots, options);
  const std::size_t most = options.modes == 0 ? options.max_modes : options.modes;
  Progress progress("canonical modes", most, options.quiet);
  std::size_t modes = options.modes == 0 ? 1 : options.modes;
  while (true) {
    (void)separation.decompose(modes);
    separation.fill(model);
    const ModelError error = training_error(model, snapshots, options.threads);
    set_errors(model, error);
    progress.advance_to(modes, fmt::format("error {:.2g}", model.relative_error));
    if (options.modes != 0 || good_enough(error, options.tolerance)) return model;
    if (modes == most) {
      throw NumericalError(
          fmt::format("the canonical form does not reach the tolerance {} with {} modes (error {:.2g}): "
                      "ask for a larger tolerance or a number of modes, or use the tree form",
                      options.tolerance, most, model.relative_error));
    }
    modes = std::min(most, modes + std::max<std::size_t>(1, modes / 4));
  }
}

void require_sensible(const CompressionOptions& options) {
  if (options.modes == 0 && !(options.tolerance > 0.0 && options.tolerance < 1.0)) {
    throw UsageError(fmt::format("the tolerance {} must be between 0 and 1", options.tolerance));
  }
}

ModelContents separated(const Snapshots& snapshots, const CompressionOptions& options) {
  const Deviation deviation(snapshots);
  const ParameterProduct product(snapshots.axes, options);
  return options.form == Form::tree ? compress_tree(snapshots, deviation, product, options)
                                    : compress_canonical(snapshots, deviation, product, options);
}

std::vector<StudiedModel> studied(const Snapshots& snapshots, const CompressionOptions& options,
                                  std::span<const std::size_t> modes,
                                  std::span<const OffGridSolution> off_grid) {
  std::vector<StudiedModel> study;
  const Deviation deviation(snapshots);
  const ParameterProduct product(snapshots.axes, options);
  std::optional<TreeSeparation> tree;
  std::optional<CanonicalSeparation> canonical;
  if (options.form == Form::tree) {
    const ParameterUnfolding unfolding(deviation, product, options.threads);
    tree.emplace(deviation, product, dominant_space(unfolding, search_for(modes.back(), options)), options);
  } else {
    canonical.emplace(deviation, product, snapshots, options);
  }
  for (const std::size_t m : modes) {
    StudiedModel row;
    row.model = frame_of(snapshots, deviation);
    if (tree) {
      tree->fill(row.model, m);
    } else {
      (void)canonical->decompose(m);
      canonical->fill(row.model);
    }
    row.row.parameter_modes = row.model.parameter_modes;
    row.row.space_modes = row.model.space_modes;
    row.row.training = training_error(row.model, snapshots, options.threads);
    if (!off_grid.empty()) row.row.off_grid = off_grid_error(row.model, off_grid);
    set_errors(row.model, row.row.training);
    study.push_back(std::move(row));
  }
  return study;
}

}  // namespace

ModelContents compress(const Snapshots& snapshots, const CompressionOptions& options) {
  require_sensible(options);
  validate(snapshots, "snapshots");
  if (snapshots.quantities.empty()) return separated(snapshots, options);
  const QuantityScales scales(snapshots);
  ModelContents model = separated(scales.scaled(snapshots), options);
  scales.restore(model);
  return model;
}

std::vector<StudiedModel> compression_study(const Snapshots& snapshots, const CompressionOptions& options,
                                            std::span<const std::size_t> modes,
                                            std::span<const OffGridSolution> off_grid) {
  validate(snapshots, "snapshots");
  if (modes.empty()) return {};
  if (!std::is_sorted(modes.begin(), modes.end()) || modes.front() == 0) {
    throw UsageError("the numbers of modes of a study must be positive and increase");
  }
  if (snapshots.quantities.empty()) return studied(snapshots, options, modes, off_grid);
  const QuantityScales scales(snapshots);
  std::vector<StudiedModel> study =
      studied(scales.scaled(snapshots), options, modes, scales.scaled(off_grid));
  for (StudiedModel& row : study) scales.restore(row.model);
  return study;
}

}  // namespace knothe::model
