#include "knothe/likelihood/step/posterior_functions.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cassert>
#include <cmath>
#include <vector>

#include "knothe/numerics/integrate/sobol.hpp"
#include "knothe/numerics/statistics/normal_distribution.hpp"
#include "knothe/numerics/statistics/weighted_statistics.hpp"

namespace knothe::likelihood {
namespace {

/// F with F Fᵀ = D Dᵀ up to 1e-8 of the trace, by Cholesky with the largest pivot first, on columns made
/// when they are wanted.
Eigen::MatrixXd covariance_factor(const Eigen::MatrixXd& deviation) {
  const Eigen::Index r = deviation.rows();
  Eigen::VectorXd left = deviation.rowwise().squaredNorm();
  const double enough = 1e-8 * left.sum();
  Eigen::MatrixXd factor(r, 0);
  while (factor.cols() < r && left.sum() > enough) {
    Eigen::Index pivot = 0;
    const double largest = left.maxCoeff(&pivot);
    if (!(largest > 0)) break;
    Eigen::VectorXd column = deviation * deviation.row(pivot).transpose();
    column.noalias() -= factor * factor.row(pivot).transpose();
    column /= std::sqrt(largest);
    factor.conservativeResize(Eigen::NoChange, factor.cols() + 1);
    factor.rightCols(1) = column;
    left = (left - column.cwiseAbs2()).cwiseMax(0.0);
    left[pivot] = 0;
  }
  return factor;
}

/// Regression of w on p: Cov(w, p) L⁻ᵀ with L Lᵀ = Cov(p), column by column (Gram-Schmidt on p's deviations).
/// All deviations times the roots of the weights.
Eigen::MatrixXd regression(const Eigen::MatrixXd& deviation, Eigen::MatrixXd p) {
  const Eigen::VectorXd size = p.colwise().norm();
  Eigen::MatrixXd tangent = Eigen::MatrixXd::Zero(deviation.rows(), p.cols());
  for (Eigen::Index a = 0; a < p.cols(); ++a) {
    for (Eigen::Index b = 0; b < a; ++b) p.col(a) -= p.col(b) * p.col(b).dot(p.col(a));
    const double norm = p.col(a).norm();
    if (!(norm > 1e-10 * size[a])) {
      p.col(a).setZero();
      continue;
    }
    p.col(a) /= norm;
    tangent.col(a).noalias() = deviation * p.col(a);
  }
  return tangent;
}

posterior::FewPoints all_alike(Eigen::MatrixXd points) {
  const Eigen::Index n = points.rows();
  return {std::move(points), Eigen::VectorXd::Constant(n, 1.0 / n), {}};
}

}  // namespace

/// Rows at the cumulative weights (j + ½)/n: deterministic; accuracy depends on evenly ordered rows.
Eigen::MatrixXd equally_likely(const Eigen::Ref<const Eigen::MatrixXd>& points,
                               const Eigen::Ref<const Eigen::VectorXd>& weights) {
  assert(points.rows() == weights.size() && points.rows() > 0);
  return points(numerics::equal_draws(weights, k_prediction_points), Eigen::all);
}

posterior::FewPoints few_points(const posterior::Posterior& posterior) {
  if (posterior.few.weights.size() > 0) return posterior.few;
  return all_alike(equally_likely(posterior.points, posterior.weights));
}

PosteriorFunctions functions_at(const model::ParameterFunctions& functions, posterior::FewPoints few) {
  model::FunctionBatch batch;
  batch.resize(few.points.rows(), functions.dimension(), functions.count(), 0);
  functions.evaluate(few.points, 0, batch);
  PosteriorFunctions w;
  w.deviation = batch.value.transpose();
  w.mean = w.deviation * few.weights;
  w.deviation.colwise() -= w.mean;
  const Eigen::VectorXd root = few.weights.cwiseSqrt();
  const Eigen::MatrixXd scaled = w.deviation * root.asDiagonal();
  const Eigen::RowVectorXd centre = few.weights.transpose() * few.points;
  const Eigen::MatrixXd p = root.asDiagonal() * (few.points.rowwise() - centre);
  w.factor = covariance_factor(scaled);
  w.tangent = regression(scaled, p);
  if (few.cell.size() > 0) {
    const Eigen::MatrixXd square = p.transpose() * p;
    w.cell = scaled * (p * square.ldlt().solve(few.cell));
  }
  w.weights = std::move(few.weights);
  return w;
}

PosteriorFunctions posterior_functions(const model::ParameterFunctions& functions,
                                       const Eigen::Ref<const Eigen::MatrixXd>& points,
                                       const Eigen::Ref<const Eigen::VectorXd>& weights) {
  return functions_at(functions, all_alike(equally_likely(points, weights)));
}

PosteriorFunctions prior_functions(const model::ParameterFunctions& functions,
                                   const posterior::PriorTransform& transform) {
  const Eigen::MatrixXd z = numerics::sobol_normal_points(k_prediction_points, transform.dimension(), 1);
  return functions_at(functions, all_alike(transform.points(z)));
}

}  // namespace knothe::likelihood
