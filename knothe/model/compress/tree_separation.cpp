#include <algorithm>
#include <cmath>
#include <numeric>

#include "knothe/base/index.hpp"
#include "knothe/base/threads.hpp"
#include "knothe/model/compress/separation.hpp"

namespace knothe::model {

namespace {

/// Share of the (squared) truncation error of p that the space basis may add. Small, because a few local
/// space modes are free at run time and carry the information about Y₀: with 0.09 the posterior std is wrong
/// by 15 %.
constexpr double k_space_share = 1e-4;

}  // namespace

ModelContents frame_of(const Snapshots& snapshots, const Deviation& deviation) {
  ModelContents model;
  model.axes = snapshots.axes;
  model.time = snapshots.time;
  model.time_units = snapshots.time_units;
  model.field = snapshots.field;
  model.lift.assign(deviation.lift().data(), deviation.lift().data() + deviation.lift().size());
  model.dofs = snapshots.dofs;
  model.quantities = snapshots.quantities;
  model.mesh = snapshots.mesh;
  model.outputs = snapshots.outputs;
  return model;
}

Eigen::MatrixXd ParameterUnfolding::times(const Eigen::MatrixXd& b) const {
  return product_.transposed_times(deviation_.applied(b, threads_));
}

Eigen::MatrixXd ParameterUnfolding::transposed_times(const Eigen::MatrixXd& b) const {
  // n_dof × (n_t columns) as (n_t n_dof) × columns.
  const Eigen::MatrixXd by_time = deviation_.projected(product_.times(b), threads_);
  Eigen::MatrixXd result(cols(), b.cols());
  for (Index t = 0; t < deviation_.times(); ++t)
    result.middleRows(t * deviation_.dofs(), deviation_.dofs()) = by_time.middleCols(t * b.cols(), b.cols());
  return result;
}

Eigen::MatrixXd ParameterUnfolding::gram() const {
  const Eigen::MatrixXd left = product_.transposed_times(deviation_.grid_gram(threads_));
  return product_.transposed_times(left.transpose());
}

double ParameterUnfolding::squared_norm() const {
  std::vector<double> by_time(deviation_.times());
  parallel_for(by_time.size(), threads_, [&](std::size_t i) {
    const Index t = i;
    by_time[i] =
        deviation_.time_weights()[t] * product_.transposed_times(deviation_.at_time(t)).squaredNorm();
  });
  return std::accumulate(by_time.begin(), by_time.end(), 0.0);
}

TreeSeparation::TreeSeparation(const Deviation& deviation, const ParameterProduct& product,
                               DominantSpace grid, const CompressionOptions& options, double floor)
    : deviation_(deviation), product_(product), grid_(std::move(grid)) {
  floor_ = floor * grid_.total;
  const Eigen::MatrixXd weighted = deviation.projected(product.times(grid_.basis), options.threads);
  const double allowed = std::max(k_space_share * grid_.rest, floor_);
  space_ = dominant_space(weighted, allowed, options.seed, options.threads);
  core_.noalias() = space_.basis.transpose() * weighted;
}

void TreeSeparation::fill(ModelContents& model, std::size_t modes) const {
  const Index r = std::min<Index>(modes, grid_.basis.cols());
  const Index times = deviation_.times(), dofs = deviation_.dofs();
  const double allowed = std::max(k_space_share * grid_.rest_from(r), floor_);
  const Index l = std::clamp<Index>(space_.rank_for(allowed), 1, space_.basis.cols());
  model.form = Form::tree;
  model.space_modes = l;
  model.parameter_modes = r;
  model.space.assign(space_.basis.data(), space_.basis.data() + l * dofs);
  model.temporal.resize(times * l * r);
  for (Index t = 0; t < times; ++t) {
    Eigen::Map<RowMatrix>(model.temporal.data() + t * l * r, l, r) =
        core_.block(0, t * grid_.basis.cols(), l, r) / std::sqrt(deviation_.time_weights()[t]);
  }
  // β_k at the nodes, orthonormal in the inner product over the parameters.
  model.joint.resize(r * deviation_.grid());
  Eigen::Map<RowMatrix> joint(model.joint.data(), r, deviation_.grid());
  joint = product_.at_nodes(grid_.basis.leftCols(r)).transpose();
  // Signs: every β_k has its largest value positive, so that equal data give equal files.
  for (Index k = 0; k < r; ++k) {
    Index at = 0;
    joint.row(k).cwiseAbs().maxCoeff(&at);
    if (joint(k, at) > 0.0) continue;
    joint.row(k) *= -1.0;
    for (Index t = 0; t < times; ++t) {
      Eigen::Map<RowMatrix>(model.temporal.data() + t * l * r, l, r).col(k) *= -1.0;
    }
  }
}

}  // namespace knothe::model
