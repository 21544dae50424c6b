#include "knothe/likelihood/noise/predictive.hpp"

#include <Eigen/Cholesky>
#include <Eigen/SparseCholesky>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "knothe/base/index.hpp"
#include "knothe/numerics/statistics/random.hpp"

namespace knothe::likelihood {

Eigen::MatrixXd noise_draws(const GaussianNoise& noise, Eigen::Index rows, Eigen::Index count,
                            std::uint64_t seed) {
  using Sparse = Eigen::SparseMatrix<double>;
  const Eigen::MatrixXd normal = numerics::monte_carlo_normal_points(count, rows, seed).transpose();
  if (noise.is_independent())
    return noise.inverse_variance().head(rows).cwiseSqrt().cwiseInverse().asDiagonal() * normal;
  Sparse precision = noise.precision().topLeftCorner(rows, rows);
  for (Eigen::Index i = 0; i < rows; ++i)
    if (!noise.is_measured(i)) precision.coeffRef(i, i) = 1;
  // P R⁻¹ Pᵀ = L Lᵀ, so that Pᵀ L⁻ᵀ z has the covariance R.
  const Eigen::SimplicialLLT<Sparse> factor(precision);
  Eigen::MatrixXd draws = factor.permutationPinv() * factor.matrixU().solve(normal).eval();
  for (Eigen::Index i = 0; i < rows; ++i)
    if (!noise.is_measured(i)) draws.row(i).setConstant(std::numeric_limits<double>::quiet_NaN());
  return draws;
}

Eigen::VectorXd log_likelihoods(const Eigen::Ref<const Eigen::MatrixXd>& predictions,
                                const Eigen::Ref<const Eigen::VectorXd>& values, const GaussianNoise& noise) {
  std::vector<Eigen::Index> present;
  for (Eigen::Index i = 0; i < values.size(); ++i)
    if (!std::isnan(values[i]) && noise.is_measured(i)) present.push_back(i);
  const auto n = std::ssize(present);
  if (n == 0) return Eigen::VectorXd::Zero(predictions.cols());
  const bool all = n == noise.size() && noise.is_complete();
  const GaussianNoise seen = all ? noise : noise.restricted(present);
  const Eigen::MatrixXd residual =
      (-predictions(present, Eigen::all)).colwise() + Eigen::VectorXd(values(present));
  const Eigen::VectorXd misfit = residual.cwiseProduct(seen.apply(residual)).colwise().sum().transpose();
  const double constant = n * std::log(2 * std::numbers::pi) + seen.log_determinant();
  return -0.5 * (misfit.array() + constant).matrix();
}

bool can_be_split(const Eigen::Ref<const Eigen::VectorXd>& values, const GaussianNoise& noise) {
  if (noise.is_independent()) return true;
  for (Eigen::Index i = 0; i < noise.size(); ++i)
    if (noise.is_measured(i) && (i >= values.size() || std::isnan(values[i]))) return false;
  return true;
}

Eigen::MatrixXd pointwise_log_likelihoods(const Eigen::Ref<const Eigen::MatrixXd>& predictions,
                                          const Eigen::Ref<const Eigen::VectorXd>& values,
                                          const GaussianNoise& noise) {
  // With P = R⁻¹ and r the residual, value i given the others is N(y_i − (P r)_i / P_ii, 1 / P_ii).
  const Eigen::VectorXd diagonal = noise.precision().diagonal();
  Eigen::MatrixXd residual = Eigen::MatrixXd::Zero(noise.size(), predictions.cols());
  for (Eigen::Index i = 0; i < values.size(); ++i)
    if (!std::isnan(values[i])) residual.row(i) = values[i] - predictions.row(i).array();
  const Eigen::MatrixXd weighted = noise.apply(residual);
  Eigen::MatrixXd logarithms = Eigen::MatrixXd::Zero(values.size(), predictions.cols());
  for (Eigen::Index i = 0; i < values.size(); ++i) {
    if (std::isnan(values[i]) || !noise.is_measured(i)) continue;
    const double constant = std::log(diagonal[i] / (2 * std::numbers::pi));
    logarithms.row(i) = 0.5 * (constant - weighted.row(i).array().square() / diagonal[i]);
  }
  return logarithms;
}

Eigen::VectorXd expected_step_error(const Eigen::Ref<const Eigen::VectorXd>& residual,
                                    const GaussianNoise& noise, const Eigen::MatrixXd& factor) {
  std::vector<Index> kept;
  for (Index i = 0; i < residual.size(); ++i)
    if (!std::isnan(residual[i]) && noise.is_measured(i)) kept.push_back(i);
  const Eigen::MatrixXd f = factor(kept, Eigen::all);
  const Eigen::MatrixXd weighted = noise.restricted(kept).apply(f);
  const Eigen::MatrixXd information =
      Eigen::MatrixXd::Identity(f.cols(), f.cols()) + f.transpose() * weighted;
  return factor * information.ldlt().solve(weighted.transpose() * residual(kept));
}

}  // namespace knothe::likelihood
