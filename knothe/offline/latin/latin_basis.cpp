#include "knothe/offline/latin/latin_basis.hpp"

#include <cmath>

#include "knothe/base/index.hpp"
#include "knothe/model/compress/low_rank.hpp"

namespace knothe::offline {

using Eigen::MatrixXd;
using Eigen::VectorXd;

MatrixXd LatinBasis::to_archive(const MatrixXd& coordinates) const {
  MatrixXd result(archived() + 1, coordinates.cols());
  result.row(0) = coordinates.row(0);
  result.bottomRows(archived()).noalias() = directions_ * coordinates.bottomRows(size());
  return result;
}

MatrixXd LatinBasis::to_working(const MatrixXd& coordinates) const {
  const Index known = coordinates.rows() - 1;  // stored when there were fewer modes
  MatrixXd result(size() + 1, coordinates.cols());
  result.row(0) = coordinates.row(0);
  result.bottomRows(size()).noalias() =
      directions_.topRows(known).transpose() * coordinates.bottomRows(known);
  return result;
}

bool LatinBasis::add(const VectorXd& force, double threshold) {
  // Forces lead and displacements follow from them: what is left of a direction that the archive nearly holds
  // is small, and the two must still belong together after it has been scaled up.
  VectorXd f = force, direction = VectorXd::Zero(archived());
  for (int pass = 0; pass < 2 && archived() > 0; ++pass) {  // twice is enough
    const VectorXd part = archive_displacements_.transpose() * f;
    f -= archive_forces_ * part;
    direction += part;
  }
  VectorXd u = body_.flexibility() * f;
  // The archive is orthonormal in G: fᵀ G f of the whole force needs no product of its own.
  const double whole = direction.squaredNorm() + u.dot(f);
  if (!(whole > 0) || !std::isfinite(whole)) return false;
  const double scale = 1 / std::sqrt(whole);
  f *= scale;
  u *= scale;
  direction *= scale;
  VectorXd outside = direction;
  for (int pass = 0; pass < 2 && size() > 0; ++pass)
    outside -= directions_ * (directions_.transpose() * outside).eval();
  const double fresh = u.dot(f);
  if (!(outside.squaredNorm() + std::max(0.0, fresh) > threshold * threshold)) return false;
  if (fresh > 1e-14) {
    const Index n = body_.dof_count(), count = archived();
    archive_displacements_.conservativeResize(n, count + 1);
    archive_forces_.conservativeResize(n, count + 1);
    archive_displacements_.col(count) = u / std::sqrt(fresh);
    archive_forces_.col(count) = f / std::sqrt(fresh);
    directions_.conservativeResize(count + 1, Eigen::NoChange);
    directions_.bottomRows(1).setZero();
    outside.conservativeResize(count + 1);
    outside[count] = std::sqrt(fresh);
  }
  append(outside.normalized());
  return true;
}

void LatinBasis::append(const VectorXd& direction) {
  const Index r = size();
  directions_.conservativeResize(Eigen::NoChange, r + 1);
  directions_.col(r) = direction;
  forces_.conservativeResize(body_.dof_count(), r + 1);
  forces_.col(r) = archive_forces_ * direction;
  MatrixXd strains(r + 2, 6 * body_.point_count());
  strains.topRows(r + 1) = strains_;
  strains.bottomRows(1) = body_.strains(archive_displacements_ * direction);
  strains_ = std::move(strains);
  project(r + 1);
}

void LatinBasis::join(LatinBody& body, std::span<const std::int64_t> cells) {
  const Index before = body.dof_count();
  body.join(cells);
  archive_forces_.conservativeResize(body.dof_count(), archived());
  archive_forces_.bottomRows(body.dof_count() - before).setZero();
  archive_displacements_ = body.flexibility() * archive_forces_;
  rebuild();
}

void LatinBasis::rebuild() {
  const Index r = size();
  forces_ = archive_forces_ * directions_;
  strains_.resize(r + 1, 6 * body_.point_count());
  strains_.row(0) = body_.lift_strains();
  if (r > 0) strains_.bottomRows(r) = body_.strains(archive_displacements_ * directions_);
  projected_.resize(packed(r + 9, 0), body_.point_count());
  for (Index mode = 1; mode <= r; ++mode) project(mode);
}

void LatinBasis::restore(const Modes& modes) {
  archive_displacements_ = modes.displacements;
  archive_forces_ = modes.forces;
  directions_ = modes.directions;
  rebuild();
}

void LatinBasis::project(Index mode) {
  const Index points = body_.point_count(), needed = packed(mode + 1, 0);
  if (projected_.rows() < needed) projected_.conservativeResize(packed(mode + 17, 0), points);
  const double lambda = body_.structure().elastic().lambda(), mu = body_.structure().elastic().mu();
  for (Index g = 0; g < points; ++g) {
    Voigt strain;
    for (Index i = 0; i < 6; ++i) strain[i] = strains_(mode, 6 * g + i);
    Voigt stress = elastic_stress(strain, lambda, mu);
    for (double& value : stress) value *= body_.weights()[g];
    const Eigen::Map<const Eigen::Matrix<double, 6, 1>> s(stress.data());
    projected_.col(g).segment(packed(mode, 0), mode + 1).noalias() =
        strains_.block(0, 6 * g, mode + 1, 6) * s;
  }
}

void LatinBasis::recompress(const MatrixXd& states, double allowed) {
  const Index r = size();
  if (r == 0) return;
  const MatrixXd c = to_working(states).bottomRows(r);
  // An error e in the coordinates has the Euclidean norm of U e: with UᵀU = V S² Vᵀ that of S Vᵀ e.
  const MatrixXd displacements = archive_displacements_ * directions_;
  const model::FallingEigenpairs axes = model::falling_eigenpairs(displacements.transpose() * displacements);
  const VectorXd scale = axes.values.cwiseMax(1e-16 * axes.values[0]).cwiseSqrt();
  const MatrixXd scaled = scale.asDiagonal() * (axes.vectors.transpose() * c);
  const model::FallingEigenpairs pairs =
      model::falling_eigenpairs(scaled * scaled.transpose() / states.cols());
  Index kept = r;
  double left_out = 0;
  while (kept > 1 && left_out + pairs.values[kept - 1] <= allowed * allowed) left_out += pairs.values[--kept];
  MatrixXd directions = axes.vectors * scale.cwiseInverse().asDiagonal() * pairs.vectors.leftCols(kept);
  for (Index k = 0; k < kept; ++k) {  // orthonormal in the energy again
    for (int pass = 0; pass < 2 && k > 0; ++pass)
      directions.col(k) -=
          directions.leftCols(k) * (directions.leftCols(k).transpose() * directions.col(k)).eval();
    directions.col(k).normalize();
  }
  directions_ = (directions_ * directions).eval();
  rebuild();
}

}  // namespace knothe::offline
