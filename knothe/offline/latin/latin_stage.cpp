#include "knothe/offline/latin/latin_stage.hpp"

#include <algorithm>
#include <cmath>

#include "knothe/base/index.hpp"

namespace knothe::offline {

using Eigen::MatrixXd;
using Eigen::VectorXd;

LatinCorrection correct(const LatinBody& body, const LatinBasis& basis, const LatinCandidate& candidate) {
  LatinLocalResult local(body, basis);
  local.evaluate(candidate.lane, candidate.coordinates, true);
  LatinCorrection result;
  for (const SearchDirection direction : {SearchDirection::tangent, SearchDirection::secant})
    if (body.correct(local.lost_material(0, direction), candidate.residual, result.displacement,
                     result.force)) {
      result.size = result.displacement.cwiseAbs().maxCoeff();
      return result;
    }
  return {body.flexibility() * candidate.residual, candidate.residual, candidate.elastic_error};
}

/// Working coordinates of the batch's points at a step before, in this window or not.
MatrixXd LatinStage::states(int step, const LatinStageResult& result) const {
  if (step < 0) return MatrixXd::Zero(basis.size() + 1, std::ssize(result.points));
  if (step >= first && step - first < std::ssize(result.coordinates)) return result.coordinates[step - first];
  const MatrixXd& all = found[step];
  MatrixXd mine(all.rows(), std::ssize(result.points));
  for (Index i = 0; i < mine.cols(); ++i) mine.col(i) = all.col(result.points[i]);
  return basis.to_working(mine);
}

MatrixXd LatinStage::guess(int step, const LatinStageResult& result) const {
  MatrixXd coordinates = states(fresh ? step - 1 : step, result);
  if (fresh && expected.empty()) coordinates += coordinates - states(step - 2, result);
  if (fresh && !expected.empty()) {
    const std::size_t now = step - first + 1;
    for (Index i = 0; i < coordinates.cols(); ++i) {
      const Index point = result.points[i];
      coordinates.col(i).tail(basis.size()) += expected[now].col(point) - expected[now - 1].col(point);
    }
  }
  coordinates.row(0).setConstant(imposed(step));
  return coordinates;
}

void LatinStage::balance(LatinStep& stepper, const LaneBatch& batch, int step,
                         LatinStageResult& result) const {
  const MatrixXd& coordinates = result.coordinates.back();
  stepper.local().evaluate(batch, coordinates, false);
  VectorXd reaction;
  MatrixXd forces = body.damage_forces(stepper.local().lost_stress(batch.size()), reaction);
  reaction += body.structure().unit_reaction() * coordinates.row(0).transpose();
  forces *= -1;
  if (basis.size() > 0)
    forces.noalias() += coordinates.bottomRows(basis.size()).transpose() * basis.forces().transpose();
  const MatrixXd elastic = forces * body.flexibility();
  const Index column = step - first;
  for (Index i = 0; i < batch.size(); ++i) {
    const double scale =
        std::max(std::abs(reaction[i]), 1e-5 * imposed(step) * body.structure().unit_reaction());
    result.residual(i, column) = forces.row(i).norm() / scale;
    result.reaction(i, column) = 2 * reaction[i];
    const double error = body.dof_count() > 0 ? elastic.row(i).cwiseAbs().maxCoeff() : 0.0;
    LatinCandidate& candidate = result.candidates[i];
    if (error > candidate.elastic_error)
      candidate = {error, step, forces.row(i).transpose(), batch.only({i}), coordinates.col(i)};
  }
}

void LatinStage::retry(LatinStep& stepper, LaneBatch& batch, int step, MatrixXd& coordinates,
                       MatrixXd& damage, std::vector<char>& converged, LatinStageResult& result) const {
  std::vector<Index> failed;
  for (Index i = 0; i < batch.size(); ++i)
    if (converged[i] == 0) failed.push_back(i);
  if (failed.empty()) return;
  const MatrixXd before = states(step - 1, result);
  const auto count = std::ssize(failed);
  const LaneBatch part = batch.only(failed);
  MatrixXd start(before.rows(), count), end(before.rows(), count), end_damage(part.padded(), damage.cols());
  for (Index k = 0; k < count; ++k) {
    start.col(k) = before.col(failed[k]);
    end.col(k) = coordinates.col(failed[k]);
    end_damage.row(k) = damage.row(failed[k]);
  }
  const auto done = stepper.solve_from(part, start, end, end_damage);
  for (Index k = 0; k < count; ++k) {
    const Index i = failed[k];
    bool solved = done[k] != 0;
    if (!solved && rescue) {
      LaneBatch alone = batch.only({i});
      MatrixXd last = coordinates.col(i);
      solved = stepper.advance(alone, before.col(i), last);
      if (last.allFinite()) {
        end.col(k) = last;
        end_damage.row(k) = alone.history.row(0);
        batch.history.row(i) = alone.history.row(0);  // what was passed on the way stays
      }
    }
    coordinates.col(i) = end.col(k);
    damage.row(i) = end_damage.row(k);
    converged[i] = solved ? 1 : 0;
    if (!solved) result.solved[i] = 0;
  }
}

LatinStageResult LatinStage::run(LaneBatch batch) const {
  LatinStep stepper(body, basis, options);
  LatinStageResult result;
  result.points = batch.points;
  result.residual.resize(batch.size(), last - first);
  result.reaction.resize(batch.size(), last - first);
  result.candidates.resize(batch.points.size());
  result.solved.assign(batch.points.size(), 1);
  for (int step = first; step < last; ++step) {
    MatrixXd coordinates = guess(step, result), damage;
    std::vector<char> converged = stepper.solve(batch, coordinates, damage);
    retry(stepper, batch, step, coordinates, damage, converged, result);
    result.coordinates.push_back(std::move(coordinates));
    balance(stepper, batch, step, result);
    batch.history = std::move(damage);
  }
  result.history = batch.history.topRows(batch.size());
  result.local_points = stepper.points_evaluated();
  return result;
}

}  // namespace knothe::offline
