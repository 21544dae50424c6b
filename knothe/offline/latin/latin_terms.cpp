#include "knothe/offline/latin/latin_terms.hpp"

#include <cmath>

#include "knothe/base/index.hpp"
#include "knothe/base/threads.hpp"
#include "knothe/offline/full_order/dense_solvers.hpp"

namespace knothe::offline {

using Eigen::Map;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

/// x with matrix x = right_side. Terms that are nearly dependent are held by a ridge: the equations are those
/// of increments, so it slows them and does not change where they end.
VectorXd solve(MatrixXd matrix, const VectorXd& right_side) {
  const double ridge = 1e-9 * matrix.diagonal().cwiseAbs().maxCoeff() + 1e-300;
  matrix.diagonal().array() += ridge;
  VectorXd x = right_side;
  if (!solve_dense(std::span(matrix.data(), matrix.size()), std::span(x.data(), x.size()))) x.setZero();
  return x;
}

/// The problem seen from the terms: Sᵀ K S (m² × P for each step) and Sᵀ f (m × P).
struct TermProjection {
  std::vector<MatrixXd> stiffness, load;
};

TermProjection project(const LatinProjection& projection, const MatrixXd& space, std::size_t threads) {
  const Index r = space.rows(), m = space.cols(), points = projection.weights.size();
  TermProjection result;
  result.stiffness.resize(projection.stiffness.size());
  result.load.resize(projection.stiffness.size());
  parallel_for(projection.stiffness.size(), threads, [&](std::size_t t) {
    result.stiffness[t].resize(m * m, points);
    result.load[t].noalias() = space.transpose() * projection.load[t];
    MatrixXd product(r, m);
    for (Index p = 0; p < points; ++p) {
      product.noalias() = Map<const MatrixXd>(projection.stiffness[t].col(p).data(), r, r) * space;
      Map<MatrixXd>(result.stiffness[t].col(p).data(), m, m).noalias() = space.transpose() * product;
    }
  });
  return result;
}

/// Adds one (t, p) to the equations of functions g whose terms are S_k scale_k g_k there.
void add(const TermProjection& problem, std::size_t t, Index p, double weight, const VectorXd& scale,
         const VectorXd& now, MatrixXd& matrix, VectorXd& right_side) {
  const Index m = scale.size();
  const Map<const MatrixXd> stiffness(problem.stiffness[t].col(p).data(), m, m);
  for (Index l = 0; l < m; ++l)
    matrix.col(l).array() += weight * scale[l] * scale.array() * stiffness.col(l).array();
  right_side.array() +=
      weight * scale.array() * (problem.load[t].col(p) - stiffness * scale.cwiseProduct(now)).array();
}

void update_time(const TermProjection& problem, const VectorXd& weights, LatinTerms& terms, double relaxation,
                 std::size_t threads) {
  const MatrixXd functions = terms.on_grid();
  const Index m = terms.count();
  parallel_for(problem.stiffness.size(), threads, [&](std::size_t t) {
    MatrixXd matrix = MatrixXd::Zero(m, m);
    VectorXd right_side = VectorXd::Zero(m);
    const VectorXd now = terms.time.row(t);
    for (Index p = 0; p < weights.size(); ++p)
      add(problem, t, p, weights[p], functions.row(p), now, matrix, right_side);
    terms.time.row(t) += relaxation * solve(std::move(matrix), right_side).transpose();
  });
}

void update_axis(const TermProjection& problem, const VectorXd& weights, LatinTerms& terms, std::size_t axis,
                 double relaxation, std::size_t threads) {
  const MatrixXd others = terms.on_grid(axis);
  const std::vector<Index> nodes = LatinGrid{terms.sizes(), {}}.nodes(axis);
  const Index m = terms.count();
  MatrixXd& mine = terms.parameters[axis];
  parallel_for(mine.rows(), threads, [&](Index node) {
    MatrixXd matrix = MatrixXd::Zero(m, m);
    VectorXd right_side = VectorXd::Zero(m);
    const VectorXd now = mine.row(node);
    for (Index p = 0; p < weights.size(); ++p) {
      if (nodes[p] != node) continue;
      for (Index t = 0; t < std::ssize(problem.stiffness); ++t)
        add(problem, t, p, weights[p], others.row(p).cwiseProduct(terms.time.row(t)).transpose(), now, matrix,
            right_side);
    }
    mine.row(node) += relaxation * solve(std::move(matrix), right_side).transpose();
  });
}

}  // namespace

Index LatinGrid::points() const {
  Index result = 1;
  for (const Index size : sizes) result *= size;
  return result;
}

VectorXd LatinGrid::point_weights() const {
  VectorXd result = VectorXd::Ones(1);
  for (const VectorXd& mine : weights) {
    const MatrixXd outer = mine * result.transpose();  // the last axis is the fastest
    result = outer.reshaped();
  }
  return result;
}

std::vector<Index> LatinGrid::nodes(std::size_t axis) const {
  Index faster = 1;
  for (std::size_t i = axis + 1; i < sizes.size(); ++i) faster *= sizes[i];
  std::vector<Index> result;
  for (Index p = 0; p < points(); ++p) result.push_back(p / faster % sizes[axis]);
  return result;
}

std::vector<Index> LatinTerms::sizes() const {
  std::vector<Index> result;
  for (const MatrixXd& functions : parameters) result.push_back(functions.rows());
  return result;
}

MatrixXd LatinTerms::on_grid(Index left_out) const {
  const LatinGrid grid{sizes(), {}};
  MatrixXd result = MatrixXd::Ones(grid.points(), count());
  for (Index i = 0; i < std::ssize(parameters); ++i) {
    if (i == left_out) continue;
    const std::vector<Index> nodes = grid.nodes(i);
    for (Index p = 0; p < result.rows(); ++p) result.row(p).array() *= parameters[i].row(nodes[p]).array();
  }
  return result;
}

MatrixXd LatinTerms::coordinates(Index step) const {
  return space * time.row(step).asDiagonal() * on_grid().transpose();
}

void LatinTerms::append(const VectorXd& mode, const VectorXd& of_time,
                        const std::vector<VectorXd>& functions) {
  const Index m = count();
  const auto put = [m](MatrixXd& matrix, const VectorXd& column) {
    const Index before = matrix.rows();
    matrix.conservativeResize(column.size(), m + 1);
    if (column.size() > before) matrix.bottomLeftCorner(column.size() - before, m).setZero();
    matrix.col(m) = column;
  };
  put(space, mode);
  put(time, of_time);
  parameters.resize(functions.size());
  for (Index i = 0; i < std::ssize(functions); ++i) put(parameters[i], functions[i]);
}

void LatinTerms::normalise() {
  for (Index k = 0; k < count(); ++k) {
    double scale = space.col(k).norm();
    if (scale > 0) space.col(k) /= scale;
    for (MatrixXd& functions : parameters) {
      double size = functions.col(k).norm() / std::sqrt(functions.rows());
      if (functions.col(k).sum() < 0) size = -size;
      if (size != 0) functions.col(k) /= size;
      scale *= size;
    }
    time.col(k) *= scale;
  }
}

void update_functions(const LatinProjection& projection, LatinTerms& terms, int sweeps, double relaxation,
                      std::size_t threads) {
  if (terms.count() == 0) return;
  terms.normalise();
  const TermProjection problem = project(projection, terms.space, threads);
  for (int sweep = 0; sweep < sweeps; ++sweep) {
    update_time(problem, projection.weights, terms, relaxation, threads);
    for (Index axis = 0; axis < std::ssize(terms.parameters); ++axis)
      update_axis(problem, projection.weights, terms, axis, relaxation, threads);
    terms.normalise();
  }
}

void update_space(const LatinProjection& projection, LatinTerms& terms, double relaxation,
                  std::size_t threads) {
  const Index r = terms.space.rows();
  const MatrixXd functions = terms.on_grid();
  const std::size_t steps = projection.steps();
  std::vector<MatrixXd> states(steps), matrices(steps);
  std::vector<VectorXd> right_sides(steps);
  for (std::size_t t = 0; t < steps; ++t) states[t] = terms.coordinates(t);
  for (Index k = 0; k < terms.count(); ++k) {
    parallel_for(steps, threads, [&](std::size_t t) {
      VectorXd sum = VectorXd::Zero(r * r);
      right_sides[t] = VectorXd::Zero(r);
      for (Index p = 0; p < projection.weights.size(); ++p) {
        const double c = terms.time(t, k) * functions(p, k);
        const auto stiffness = projection.stiffness[t].col(p);
        sum += (projection.weights[p] * c * c) * stiffness;
        right_sides[t] +=
            (projection.weights[p] * c) *
            (projection.load[t].col(p) - Map<const MatrixXd>(stiffness.data(), r, r) * states[t].col(p));
      }
      matrices[t] = Map<const MatrixXd>(sum.data(), r, r);
    });
    MatrixXd matrix = MatrixXd::Zero(r, r);
    VectorXd right_side = VectorXd::Zero(r);
    for (std::size_t t = 0; t < steps; ++t) {
      matrix += matrices[t];
      right_side += right_sides[t];
    }
    const VectorXd change = relaxation * solve(std::move(matrix), right_side);
    terms.space.col(k) += change;
    for (std::size_t t = 0; t < steps; ++t)
      states[t] += change * (terms.time(t, k) * functions.col(k).transpose());
  }
  terms.normalise();
}

MatrixXd RankOne::values() const {
  LatinTerms term;
  term.time = time;
  term.parameters.assign(parameters.begin(), parameters.end());
  return time * term.on_grid().transpose();
}

RankOne rank_one_functions(const MatrixXd& a, const MatrixXd& b, const LatinGrid& grid) {
  const VectorXd weights = grid.point_weights();
  constexpr int k_sweeps = 30;
  LatinTerms term;
  term.time = VectorXd::Ones(a.rows());
  for (const Index size : grid.sizes) term.parameters.emplace_back(VectorXd::Ones(size));
  const auto divide = [](const VectorXd& top, const VectorXd& bottom) {
    const double least = 1e-12 * bottom.maxCoeff() + 1e-300;
    return VectorXd((bottom.array() > least).select(top.array() / bottom.array().max(least), 0.0));
  };
  double before = 0;
  for (int sweep = 0; sweep < k_sweeps; ++sweep) {
    VectorXd c = term.on_grid();
    term.time = divide(b * weights.cwiseProduct(c), a * weights.cwiseProduct(c.cwiseAbs2()));
    for (Index axis = 0; axis < std::ssize(grid.sizes); ++axis) {
      c = term.on_grid(axis);
      const VectorXd b_at = (b.transpose() * term.time).cwiseProduct(weights).cwiseProduct(c);
      const VectorXd a_at =
          (a.transpose() * term.time.cwiseAbs2()).cwiseProduct(weights).cwiseProduct(c.cwiseAbs2());
      const std::vector<Index> nodes = grid.nodes(axis);
      VectorXd top = VectorXd::Zero(grid.sizes[axis]), bottom = top;
      for (Index p = 0; p < weights.size(); ++p) {
        top[nodes[p]] += b_at[p];
        bottom[nodes[p]] += a_at[p];
      }
      term.parameters[axis] = divide(top, bottom);
    }
    // At an alternating minimum the gain is ½ Σ w b c.
    const double gain = term.time.col(0).dot(b * weights.cwiseProduct(VectorXd(term.on_grid())));
    if (gain - before <= 1e-6 * gain) break;
    before = gain;
  }
  RankOne result{term.time, {}};
  for (const MatrixXd& functions : term.parameters) result.parameters.emplace_back(functions);
  return result;
}

}  // namespace knothe::offline
