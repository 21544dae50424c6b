#include <algorithm>
#include <cmath>

#include "knothe/reduction/compress/separation.hpp"

namespace knothe::reduction {

namespace {

/// Share of the (squared) truncation error of p that the space basis may add. Small, because a few local
/// space modes cost nothing online and carry what the data say about Y₀: with 0.09 the posterior std is wrong
/// by 15 %.
constexpr double k_space_share = 1e-4;
double tail(const Eigen::VectorXd& energy, Eigen::Index from) {
  return energy.tail(energy.size() - from).sum();
}

}  // namespace

ModelContents frame_of(const Snapshots& snapshots, const Deviation& deviation) {
  ModelContents model;
  model.axes = snapshots.axes;
  model.time = snapshots.time;
  model.field = snapshots.field;
  model.lift.assign(deviation.lift().data(), deviation.lift().data() + deviation.lift().size());
  model.dofs = snapshots.dofs;
  model.mesh = snapshots.mesh;
  model.outputs = snapshots.outputs;
  return model;
}

std::size_t TreeSeparation::modes_for(const Eigen::VectorXd& energy, double allowed) {
  Eigen::Index r = energy.size();
  double rest = 0.0;
  allowed = std::max(allowed, k_rounding * energy.sum());
  while (r > 1 && rest + energy[r - 1] <= allowed) rest += energy[--r];
  return static_cast<std::size_t>(r);
}

TreeSeparation::TreeSeparation(const Deviation& deviation, const ParameterProduct& product,
                               std::size_t max_modes, const CompressionOptions& options, double floor)
    : deviation_(deviation),
      product_(product),
      grid_(falling_eigenpairs(deviation.grid_gram(product.factor(), options.threads))) {
  floor_ = floor * grid_.values.sum();
  max_modes_ = std::min(static_cast<Eigen::Index>(max_modes), deviation.grid());
  const Eigen::MatrixXd weighted = deviation.projected(
      product.factor().triangularView<Eigen::Lower>() * grid_.vectors.leftCols(max_modes_), options.threads);
  const double allowed = std::max(k_space_share * tail(grid_.values, max_modes_), floor_);
  space_ = dominant_space(weighted, allowed, options.seed, options.threads);
  core_.noalias() = space_.basis.transpose() * weighted;
}

void TreeSeparation::fill(ModelContents& model, std::size_t modes) const {
  const Eigen::Index r = std::min(static_cast<Eigen::Index>(modes), max_modes_);
  const Eigen::Index times = deviation_.times(), dofs = deviation_.dofs();
  const double allowed = std::max(k_space_share * tail(grid_.values, r), floor_);
  const Eigen::Index l = std::clamp<Eigen::Index>(space_.rank_for(allowed), 1, space_.basis.cols());
  model.form = Form::tree;
  model.space_modes = static_cast<std::size_t>(l);
  model.parameter_modes = static_cast<std::size_t>(r);
  model.space.assign(space_.basis.data(), space_.basis.data() + l * dofs);
  model.temporal.resize(static_cast<std::size_t>(times * l * r));
  for (Eigen::Index t = 0; t < times; ++t) {
    Eigen::Map<RowMatrix>(model.temporal.data() + t * l * r, l, r) =
        core_.block(0, t * max_modes_, l, r) / std::sqrt(deviation_.time_weights()[t]);
  }
  // β_k at the nodes, orthonormal in the inner product over the parameters.
  model.joint.resize(static_cast<std::size_t>(r * deviation_.grid()));
  Eigen::Map<RowMatrix> joint(model.joint.data(), r, deviation_.grid());
  joint = product_.at_nodes(grid_.vectors.leftCols(r)).transpose();
  // Signs: every β_k has its largest value positive, so that equal data give equal files.
  for (Eigen::Index k = 0; k < r; ++k) {
    Eigen::Index at = 0;
    joint.row(k).cwiseAbs().maxCoeff(&at);
    if (joint(k, at) > 0.0) continue;
    joint.row(k) *= -1.0;
    for (Eigen::Index t = 0; t < times; ++t) {
      Eigen::Map<RowMatrix>(model.temporal.data() + t * l * r, l, r).col(k) *= -1.0;
    }
  }
}

}  // namespace knothe::reduction
