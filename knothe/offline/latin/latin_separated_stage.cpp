#include "knothe/offline/latin/latin_separated_stage.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "knothe/base/index.hpp"
#include "knothe/base/threads.hpp"

namespace knothe::offline {

using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr double k_stagnation = 0.05;  // relative change of the product λ Π γ in a pass of the fixed point

constexpr std::size_t k_corrected_points = 6;

/// Sums of the energy error over a batch.
struct BatchSums {
  double energy = 0, size = 0;
};

}  // namespace

std::size_t LatinSeparatedStage::batches() const {
  return (parameters.size() + k_lanes_of_a_batch - 1) / k_lanes_of_a_batch;
}

LaneBatch LatinSeparatedStage::make_batch(std::size_t batch) const {
  const std::size_t end = std::min(parameters.size(), (batch + 1) * k_lanes_of_a_batch);
  std::vector<int> points(end - batch * k_lanes_of_a_batch);
  std::iota(points.begin(), points.end(), static_cast<int>(batch * k_lanes_of_a_batch));
  return make_lanes(points, parameters, body.point_count());
}

std::vector<MatrixXd> LatinSeparatedStage::states() const {
  const MatrixXd functions = terms.on_grid().transpose();
  std::vector<MatrixXd> result;
  for (int step = 0; step < steps(); ++step) {
    MatrixXd state = MatrixXd::Zero(basis.size() + 1, grid.points());
    state.row(0).setConstant(imposed(step));
    if (terms.count() > 0)
      state.bottomRows(basis.size()).noalias() =
          terms.space * (terms.time.row(step).asDiagonal() * functions).eval();
    result.push_back(std::move(state));
  }
  return result;
}

void LatinSeparatedStage::march(const Visit& visit) const {
  const std::vector<MatrixXd> all = states();
  parallel_for(batches(), threads, [&](std::size_t b) {
    LaneBatch lanes = make_batch(b);
    LatinLocalResult local(body, basis);
    for (int step = 0; step < steps(); ++step) {
      const MatrixXd coordinates = all[step].middleCols(b * k_lanes_of_a_batch, lanes.size());
      local.evaluate(lanes, coordinates, false);
      visit(b, step, lanes, coordinates, local);
      lanes.history = local.damage();
    }
  });
}

SeparatedStageResult LatinSeparatedStage::run() const {
  const Index r = basis.size(), points = grid.points();
  SeparatedStageResult result;
  result.projection.weights = grid.point_weights();
  result.projection.stiffness.assign(steps(), MatrixXd(r * r, points));
  result.projection.load.assign(steps(), MatrixXd(r, points));
  result.residual = result.reaction = MatrixXd::Zero(points, steps());
  const double unit_reaction = body.structure().unit_reaction();
  std::vector<BatchSums> sums(batches());
  result.worst.resize(parameters.size());
  march([&](std::size_t b, int step, const LaneBatch& lanes, const MatrixXd& c, LatinLocalResult& local) {
    local.project();
    VectorXd reaction;
    MatrixXd forces = -body.damage_forces(local.lost_stress(lanes.size()), reaction);
    reaction += unit_reaction * c.row(0).transpose();
    if (r > 0) forces.noalias() += c.bottomRows(r).transpose() * basis.forces().transpose();
    const MatrixXd elastic = forces * body.flexibility();
    const std::size_t t = step;
    for (Index i = 0; i < lanes.size(); ++i) {
      const Index p = lanes.points[i];
      const MatrixXd stiffness = local.stiffness(i, SearchDirection::secant);
      result.projection.stiffness[t].col(p) = stiffness.reshaped();
      result.projection.load[t].col(p) = stiffness * c.col(i).tail(r) - local.residual(i, c);
      const double scale = std::max(std::abs(reaction[i]), 1e-5 * imposed(step) * unit_reaction);
      result.residual(p, step) = forces.row(i).norm() / scale;
      result.reaction(p, step) = 2 * reaction[i];
      const double weight = result.projection.weights[p];
      sums[b].energy += weight * std::max(0.0, forces.row(i).dot(elastic.row(i)));
      sums[b].size += weight * c.col(i).tail(r).squaredNorm();
      const double error = body.dof_count() > 0 ? elastic.row(i).cwiseAbs().maxCoeff() : 0.0;
      LatinCandidate& candidate = result.worst[p];
      if (error > candidate.elastic_error)
        candidate = {error, step, forces.row(i).transpose(), lanes.only({i}), c.col(i)};
    }
  });
  double energy = 0, size = 0;
  for (const BatchSums& batch : sums) {
    energy += batch.energy;
    size += batch.size;
  }
  std::stable_sort(
      result.worst.begin(), result.worst.end(),
      [](const LatinCandidate& a, const LatinCandidate& b) { return a.elastic_error > b.elastic_error; });
  result.energy_error = energy > 0 ? std::sqrt(energy / std::max(size, energy)) : 0;
  return result;
}

WorstCorrection LatinSeparatedStage::correct_worst(const std::vector<LatinCandidate>& worst) const {
  std::vector<LatinCorrection> corrections(std::min(k_corrected_points, worst.size()));
  parallel_for(corrections.size(), threads, [&](std::size_t k) {
    if (worst[k].elastic_error > 0) corrections[k] = correct(body, basis, worst[k]);
  });
  std::size_t largest = 0;
  double softness = 1;
  for (Index k = 0; k < std::ssize(corrections); ++k) {
    if (worst[k].elastic_error > 0)
      softness = std::max(softness, corrections[k].size / worst[k].elastic_error);
    if (corrections[k].size > corrections[largest].size) largest = k;
  }
  double bound = corrections[largest].size;
  if (corrections.size() < worst.size())
    bound = std::max(bound, softness * worst[corrections.size()].elastic_error);
  return {std::move(corrections[largest]), bound};
}

RankOne LatinSeparatedStage::functions_for(const VectorXd& mode) const {
  // a = Uᵀ K(1 − d̂) U and b = −Uᵀ ρ at every (t, p). C is isotropic: ε(U) : d C ε(u) needs lost stresses
  // alone.
  const MatrixXd strain = body.strains(mode);  // 1 × 6 n_g
  const Index n_g = body.point_count();
  const ElasticConstants& elastic = body.structure().elastic();
  VectorXd weighted = strain.row(0).transpose(), own(n_g);
  for (Index g = 0; g < n_g; ++g) {
    Voigt e;
    for (Index i = 0; i < 6; ++i) e[i] = strain(0, 6 * g + i);
    const Voigt s = elastic_stress(e, elastic.lambda(), elastic.mu());
    double sum = 0;
    for (std::size_t i = 0; i < 6; ++i) sum += s[i] * e[i];
    own[g] = body.weights()[g] * sum;
    weighted.segment(6 * g, 6) *= body.weights()[g];
  }
  const Eigen::RowVectorXd onto = mode.transpose() * basis.forces();
  MatrixXd a(steps(), grid.points()), b(steps(), grid.points());
  march([&](std::size_t, int step, const LaneBatch& lanes, const MatrixXd& c, LatinLocalResult& local) {
    const VectorXd softer = local.damage().topRows(lanes.size()) * own;
    const VectorXd lost = local.lost_stress(lanes.size()) * weighted;
    for (Index i = 0; i < lanes.size(); ++i) {
      const Index p = lanes.points[i];
      a(step, p) = 1 - softer[i];
      b(step, p) = lost[i] - (basis.size() > 0 ? onto.dot(c.col(i).tail(basis.size())) : 0.0);
    }
  });
  return rank_one_functions(a, b, grid);
}

bool LatinSeparatedStage::solve_space(const MatrixXd& values, NewTerm& term) const {
  const Index n_g = body.point_count(), r = basis.size();
  const VectorXd weights = grid.point_weights();
  std::vector<VectorXd> damage(batches(), VectorXd::Zero(n_g)), states(batches(), VectorXd::Zero(r));
  std::vector<MatrixXd> lost(batches(), MatrixXd::Zero(1, 6 * n_g));
  march([&](std::size_t batch, int step, const LaneBatch& lanes, const MatrixXd& c, LatinLocalResult& local) {
    VectorXd once(lanes.size()), twice(lanes.size());
    for (Index i = 0; i < lanes.size(); ++i) {
      const Index p = lanes.points[i];
      once[i] = weights[p] * values(step, p);
      twice[i] = once[i] * values(step, p);
    }
    damage[batch] += local.damage().topRows(lanes.size()).transpose() * twice;
    lost[batch] += once.transpose() * local.lost_stress(lanes.size());
    states[batch] += c.bottomRows(r) * once;
  });
  for (std::size_t k = 1; k < batches(); ++k) {
    damage[0] += damage[k];
    lost[0] += lost[k];
    states[0] += states[k];
  }
  double all = 0;
  for (Index step = 0; step < values.rows(); ++step)
    all += weights.dot(values.row(step).cwiseAbs2().transpose());
  VectorXd unused;
  VectorXd rest = body.damage_forces(lost[0], unused).row(0).transpose();
  if (r > 0) rest -= basis.forces() * states[0];
  const ElasticConstants& elastic = body.structure().elastic();
  std::vector<VoigtMatrix> material(n_g);
  for (Index g = 0; g < n_g; ++g) {
    const double d = damage[0][g] / all;
    VoigtMatrix& matrix = material[g];
    for (std::size_t i = 0; i < 3; ++i) {
      for (std::size_t j = 0; j < 3; ++j)
        matrix[6 * i + j] = d * (elastic.lambda() + (i == j ? 2 * elastic.mu() : 0.0));
      matrix[6 * (i + 3) + i + 3] = d * elastic.mu();
    }
  }
  return body.correct(material, rest / all, term.displacement, term.force);
}

std::optional<NewTerm> LatinSeparatedStage::rank_one(const LatinCorrection& start, int passes) const {
  NewTerm term{start.displacement, start.force, {}, 0};
  MatrixXd before;
  while (true) {
    const double energy = term.displacement.dot(term.force);
    if (!(energy > 0) || !std::isfinite(energy)) return std::nullopt;
    term.displacement /= std::sqrt(energy);
    term.force /= std::sqrt(energy);
    term.functions = functions_for(term.displacement);
    MatrixXd values = term.functions.values();
    const double size = values.norm();
    if (!(size > 0) || !std::isfinite(size)) return std::nullopt;
    values /= size;
    const bool stagnates =
        term.passes > 0 && std::min((values - before).norm(), (values + before).norm()) < k_stagnation;
    if (stagnates || term.passes >= passes) return term;
    ++term.passes;
    if (!solve_space(values, term)) return std::nullopt;
    before = std::move(values);
  }
}

}  // namespace knothe::offline
