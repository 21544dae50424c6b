#include "knothe/offline/latin/latin_prediction.hpp"

#include "knothe/base/index.hpp"
#include "knothe/model/compress/low_rank.hpp"
#include "knothe/offline/latin/latin_activation.hpp"

namespace knothe::offline {

using Eigen::MatrixXd;

namespace {

/// Rows of the active dofs.
MatrixXd on_active(const LatinBody& body, const MatrixXd& fields) {
  MatrixXd result(body.dof_count(), fields.cols());
  for (Index i = 0; i < result.rows(); ++i) result.row(i) = fields.row(body.dofs()[i]);
  return result;
}

}  // namespace

LatinPrediction::LatinPrediction(const LatinStart& start, const Structure& structure)
    : start_(start), forces_(start.space.rows(), start.space.cols()) {
  const std::size_t size = forces_.rows();
  for (Index k = 0; k < forces_.cols(); ++k)
    structure.stiffness().multiply(std::span(start.space.col(k).data(), size),
                                   std::span(forces_.col(k).data(), size));
}

std::vector<std::int64_t> LatinPrediction::joining(const LatinBody& body, int step, double imposed,
                                                   std::span<const double> thresholds,
                                                   double fraction) const {
  if (body.waiting().empty()) return {};
  const MatrixXd& values = start_.coordinates[step];
  MatrixXd states(values.rows() + 1, values.cols());
  states.row(0).setConstant(imposed);
  states.bottomRows(values.rows()) = values;
  return find_activation(body, start_.space, states, thresholds, fraction).joining;
}

MatrixXd LatinPrediction::forces(const LatinBody& body, int first, int last, double allowed) const {
  const Index l = start_.space.cols();
  MatrixXd gram = MatrixXd::Zero(l, l);
  Index count = 0;
  for (int step = first; step < last; ++step) {
    const MatrixXd& values = start_.coordinates[step];
    gram.noalias() += values * values.transpose();
    count += values.cols();
  }
  const model::FallingEigenpairs pairs = model::falling_eigenpairs(gram / count);
  Index kept = l;
  double left_out = 0;
  while (kept > 0 && left_out + pairs.values[kept - 1] <= allowed * allowed) left_out += pairs.values[--kept];
  return on_active(body, forces_) * pairs.vectors.leftCols(kept);
}

MatrixXd LatinPrediction::expected(const LatinBody& body, const LatinBasis& basis, int step) const {
  const MatrixXd onto = basis.forces().transpose() * on_active(body, start_.space);
  if (step < 0) return MatrixXd::Zero(onto.rows(), start_.coordinates.front().cols());
  return onto * start_.coordinates[step];
}

}  // namespace knothe::offline
