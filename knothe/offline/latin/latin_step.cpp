#include "knothe/offline/latin/latin_step.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "knothe/base/index.hpp"
#include "knothe/offline/full_order/dense_solvers.hpp"
#include "knothe/offline/full_order/increments.hpp"

namespace knothe::offline {

using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

/// x = matrix⁻¹ x, false if singular or not finite.
bool solve_in_place(MatrixXd matrix, VectorXd& x) {
  return solve_dense(std::span(matrix.data(), matrix.size()), std::span(x.data(), x.size()));
}

}  // namespace

LaneBatch LaneBatch::only(const std::vector<Index>& kept) const {
  LaneBatch part;
  for (const Index lane : kept) part.points.push_back(points[lane]);
  const Index rows = part.padded();
  part.threshold = VectorXd::Constant(rows, k_never);
  part.brittleness = VectorXd::Zero(rows);
  part.history.resize(rows, history.cols());
  part.history.bottomRows(rows - part.size()).setZero();
  for (Index i = 0; i < part.size(); ++i) {
    const Index lane = kept[i];
    part.threshold[i] = threshold[lane];
    part.brittleness[i] = brittleness[lane];
  }
  for (Index g = 0; g < history.cols(); ++g)
    for (Index i = 0; i < part.size(); ++i) part.history(i, g) = history(kept[i], g);
  return part;
}

void LatinLocalResult::evaluate(const LaneBatch& batch, const MatrixXd& coordinates, bool tangent) {
  const Index lanes = batch.padded(), points = body_.point_count();
  strain_.resize(lanes, 6 * points);
  strain_.bottomRows(lanes - batch.size()).setZero();
  strain_.topRows(batch.size()).noalias() = coordinates.transpose() * basis_.strains();
  damage_.resize(lanes, points);
  if (tangent) {
    slope_.resize(lanes, points);
    derivative_.resize(lanes, 6 * points);
  }
  for (Index g = 0; g < points; ++g)
    evaluate_local_stage(
        {static_cast<std::size_t>(lanes), batch.threshold.data(), batch.brittleness.data(),
         &strain_(0, 6 * g), &batch.history(0, g), &damage_(0, g), tangent ? &slope_(0, g) : nullptr,
         tangent ? &derivative_(0, 6 * g) : nullptr, body_.band_ratio(g)},
        body_.structure().elastic());
}

void LatinLocalResult::project() {
  // The damaged points alone: at most some hundred.
  std::vector<Index> damaged;
  for (Index g = 0; g < damage_.cols(); ++g)
    if ((damage_.col(g).array() > 0.0).any()) damaged.push_back(g);
  const Index rows = LatinBasis::packed(basis_.size() + 1, 0), count = std::ssize(damaged);
  gathered_.resize(rows, count);
  gathered_damage_.resize(damage_.rows(), count);
  for (Index k = 0; k < count; ++k) {
    gathered_.col(k) = basis_.projected().col(damaged[k]).head(rows);
    gathered_damage_.col(k) = damage_.col(damaged[k]);
  }
  projected_.noalias() = gathered_ * gathered_damage_.transpose();
}

VectorXd LatinLocalResult::residual(Index lane, const MatrixXd& coordinates) const {
  const Index r = basis_.size();
  const auto column = projected_.col(lane);
  const auto c = coordinates.col(lane);
  VectorXd g = c.tail(r);
  for (Index i = 1; i <= r; ++i) {
    const auto row = column.segment(LatinBasis::packed(i, 0), i + 1);
    g[i - 1] -= row.dot(c.head(i + 1));
    if (i > 1) g.head(i - 1) -= c[i] * row.segment(1, i - 1);
  }
  return g;
}

Voigt LatinLocalResult::strain(Index lane, Index point) const {
  Voigt e;
  for (Index i = 0; i < 6; ++i) e[i] = strain_(lane, 6 * point + i);
  return e;
}

MatrixXd LatinLocalResult::stiffness(Index lane, SearchDirection direction) const {
  const Index r = basis_.size();
  MatrixXd matrix = MatrixXd::Identity(r, r);
  if (direction == SearchDirection::elastic) return matrix;
  const auto column = projected_.col(lane);
  for (Index i = 1; i <= r; ++i) {
    const auto row = column.segment(LatinBasis::packed(i, 1), i);
    matrix.col(i - 1).head(i) -= row;
    if (i > 1) matrix.row(i - 1).head(i - 1) -= row.head(i - 1).transpose();
  }
  if (direction == SearchDirection::secant) return matrix;
  std::vector<Index> growing;
  for (Index g = 0; g < slope_.cols(); ++g)
    if (slope_(lane, g) > 0) growing.push_back(g);
  if (growing.empty()) return matrix;
  const auto n = std::ssize(growing);
  const double lambda = body_.structure().elastic().lambda(), mu = body_.structure().elastic().mu();
  MatrixXd stress(r, n), rate(r, n);
  for (Index k = 0; k < n; ++k) {
    const Index g = growing[k];
    const Voigt effective = elastic_stress(strain(lane, g), lambda, mu);
    const auto e = basis_.strains().block(1, 6 * g, r, 6);
    const Eigen::Map<const Eigen::Matrix<double, 6, 1>> s(effective.data());
    Eigen::Matrix<double, 6, 1> t;
    for (Index i = 0; i < 6; ++i) t[i] = derivative_(lane, 6 * g + i);
    stress.col(k).noalias() = e * (body_.weights()[g] * slope_(lane, g) * s);
    rate.col(k).noalias() = e * t;
  }
  matrix.noalias() -= stress * rate.transpose();
  return matrix;
}

MatrixXd LatinLocalResult::lost_stress(Index lanes) const {
  const double lambda = body_.structure().elastic().lambda(), mu = body_.structure().elastic().mu();
  MatrixXd lost(lanes, strain_.cols());
  for (Index g = 0; g < damage_.cols(); ++g) {
    const auto d = damage_.col(g).head(lanes).array();
    const auto e = strain_.middleCols(6 * g, 6).topRows(lanes).array();
    auto s = lost.middleCols(6 * g, 6).array();
    s.col(0) = lambda * d * (e.col(0) + e.col(1) + e.col(2));
    s.col(1) = s.col(0);
    s.col(2) = s.col(0);
    for (int i = 0; i < 3; ++i) {
      s.col(i) += 2 * mu * d * e.col(i);
      s.col(3 + i) = mu * d * e.col(3 + i);
    }
  }
  return lost;
}

std::vector<VoigtMatrix> LatinLocalResult::lost_material(Index lane, SearchDirection direction) const {
  const double lambda = body_.structure().elastic().lambda(), mu = body_.structure().elastic().mu();
  std::vector<VoigtMatrix> result(damage_.cols());
  if (direction == SearchDirection::elastic) return result;
  for (Index g = 0; g < damage_.cols(); ++g) {
    VoigtMatrix& lost = result[g];
    const double d = damage_(lane, g);
    for (std::size_t i = 0; i < 3; ++i) {
      for (std::size_t j = 0; j < 3; ++j) lost[6 * i + j] = d * (lambda + (i == j ? 2 * mu : 0.0));
      lost[6 * (i + 3) + i + 3] = d * mu;
    }
    if (direction == SearchDirection::secant || !(slope_(lane, g) > 0)) continue;
    const Voigt effective = elastic_stress(strain(lane, g), lambda, mu);
    for (std::size_t i = 0; i < 6; ++i)
      for (std::size_t j = 0; j < 6; ++j)
        lost[6 * i + j] += slope_(lane, g) * effective[i] * derivative_(lane, 6 * g + j);
  }
  return result;
}

std::vector<char> LatinStep::solve(const LaneBatch& batch, MatrixXd& coordinates, MatrixXd& damage) {
  const Index r = basis_.size();
  std::vector<char> converged(batch.points.size(), 0);
  damage.setZero(batch.padded(),
                 batch.history.cols());  // padding too: what counts as damaged must not be chance
  std::vector<Index> alive(batch.points.size());
  for (Index i = 0; i < batch.size(); ++i) alive[i] = i;
  std::vector<double> best(alive.size(), std::numeric_limits<double>::infinity());
  LaneBatch working = batch;
  MatrixXd trial = coordinates;
  for (int iteration = 0; iteration <= options_.iterations && !alive.empty(); ++iteration) {
    local_.evaluate(working, trial, options_.direction == SearchDirection::tangent);
    points_evaluated_ += working.size() * damage.cols();
    local_.project();
    std::vector<Index> kept;  // positions in `working`
    for (Index i = 0; i < working.size(); ++i) {
      const std::size_t lane = alive[i];
      VectorXd g = local_.residual(i, trial);
      const double size = g.norm(), scale = trial.col(i).tail(r).norm();
      const bool finite = std::isfinite(size);
      if (finite && (size < best[lane] || !options_.best)) {
        best[lane] = size;
        coordinates.col(alive[i]) = trial.col(i);
        damage.row(alive[i]) = local_.damage().row(i);
      }
      if (finite && size <= options_.tolerance * scale) {
        converged[lane] = 1;
        continue;
      }
      if (!finite || iteration == options_.iterations || (iteration > 3 && size > 1e3 * best[lane])) continue;
      if (!solve_in_place(local_.stiffness(i, options_.direction), g)) continue;
      trial.col(i).tail(r) -= g;
      kept.push_back(i);
    }
    if (std::ssize(kept) == working.size()) continue;
    MatrixXd rest(r + 1, std::ssize(kept));
    std::vector<Index> still;
    for (Index k = 0; k < std::ssize(kept); ++k) {
      rest.col(k) = trial.col(kept[k]);
      still.push_back(alive[kept[k]]);
    }
    working = working.only(kept);
    trial = std::move(rest);
    alive = std::move(still);
  }
  return converged;
}

std::vector<char> LatinStep::solve_from(const LaneBatch& batch, const MatrixXd& before, MatrixXd& coordinates,
                                        MatrixXd& damage) {
  constexpr int k_between = 10;
  const Index r = basis_.size();
  std::vector<char> converged(batch.points.size(), 0);
  std::vector<Index> alive;
  for (Index i = 0; i < batch.size(); ++i) alive.push_back(i);
  LaneBatch working = batch;
  MatrixXd trial = before, end, end_damage;
  trial.row(0) = coordinates.row(0);
  for (int iteration = 1; iteration <= options_.warm_up && !alive.empty(); ++iteration) {
    local_.evaluate(working, trial, false);
    points_evaluated_ += working.size() * damage.cols();
    local_.project();
    for (Index i = 0; i < working.size(); ++i) {
      VectorXd g = local_.residual(i, trial);
      if (g.allFinite() && solve_in_place(local_.stiffness(i, SearchDirection::secant), g))
        trial.col(i).tail(r) -= g;
    }
    if (iteration % k_between != 0) continue;
    end = trial;
    const auto done = solve(working, end, end_damage);
    std::vector<Index> kept, still;
    for (Index i = 0; i < working.size(); ++i) {
      const Index lane = alive[i];
      if (done[i] != 0) {
        converged[lane] = 1;
        coordinates.col(lane) = end.col(i);
        damage.row(lane) = end_damage.row(i);
      } else {
        kept.push_back(i);
        still.push_back(lane);
      }
    }
    MatrixXd rest(r + 1, std::ssize(kept));
    for (Index k = 0; k < std::ssize(kept); ++k) rest.col(k) = trial.col(kept[k]);
    working = working.only(kept);
    trial = std::move(rest);
    alive = std::move(still);
  }
  return converged;
}

bool LatinStep::secant(LaneBatch& lane, MatrixXd& coordinates, MatrixXd& damage) {
  constexpr int k_before_newton = 10;
  const Index r = basis_.size();
  for (int iteration = 1; iteration <= options_.secant_iterations; ++iteration) {
    local_.evaluate(lane, coordinates, false);
    points_evaluated_ += damage.cols();
    lane.history = local_.damage();  // damage that any iterate reaches stays: the sequence is monotone
    local_.project();
    VectorXd g = local_.residual(0, coordinates);
    if (iteration % k_before_newton == 0 ||
        g.norm() <= options_.tolerance * coordinates.col(0).tail(r).norm()) {
      MatrixXd end = coordinates;
      if (solve(lane, end, damage).front() != 0) {
        coordinates = end;
        return true;
      }
      local_.evaluate(lane, coordinates, false);
      local_.project();
      g = local_.residual(0, coordinates);
    }
    if (!g.allFinite() || !solve_in_place(local_.stiffness(0, SearchDirection::secant), g)) return false;
    coordinates.col(0).tail(r) -= g;
  }
  return false;
}

bool LatinStep::advance(LaneBatch& lane, const VectorXd& before, MatrixXd& coordinates) {
  const double target = coordinates(0, 0);
  VectorXd state = before, previous = before;
  bool good = true;
  MatrixXd damage, guess;
  advance_by_increments(
      state[0], target, options_.cuts,
      [&](double next) {
        const double last = state[0] - previous[0];
        guess = state + (last > 0 ? (next - state[0]) / last : 0.0) * (state - previous);
        guess(0, 0) = next;
        if (solve(lane, guess, damage).front() == 0) return false;
        lane.history = damage;  // secant iterations leave theirs there
        return true;
      },
      [&](double next) {
        guess = state;
        guess(0, 0) = next;
        const bool converged = secant(lane, guess, damage);
        if (converged) lane.history = damage;
        good = good && converged;
      },
      [&](double) {
        previous = state;
        state = guess.col(0);
      });
  coordinates.col(0) = state;
  return good;
}

}  // namespace knothe::offline
