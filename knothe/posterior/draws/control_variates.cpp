#include "knothe/posterior/draws/control_variates.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

namespace knothe::posterior {
namespace {

/// 1, v_k and v_k² of variables v (n × k) about `centre`, in units of `scale`.
Eigen::MatrixXd functions_of(const Eigen::MatrixXd& variables, const Eigen::RowVectorXd& centre,
                             const Eigen::RowVectorXd& scale) {
  const Eigen::Index k = variables.cols();
  Eigen::MatrixXd functions(variables.rows(), 1 + 2 * k);
  functions.col(0).setOnes();
  functions.middleCols(1, k) = ((variables.rowwise() - centre).array().rowwise() / scale.array()).matrix();
  functions.rightCols(k) = functions.middleCols(1, k).cwiseAbs2();
  return functions;
}

}  // namespace

ControlVariates control_variates(const MixtureProduct& h, const Eigen::MatrixXd& points,
                                 const Eigen::VectorXd& log_q,
                                 const std::function<Eigen::MatrixXd(const Eigen::MatrixXd&)>& variables,
                                 RandomNumbers& random) {
  constexpr Eigen::Index k_draws = 200'000;
  Eigen::MatrixXd drawn;
  h.sample(k_draws, random, drawn);
  if (variables) drawn = variables(drawn);
  const Eigen::RowVectorXd centre = drawn.colwise().mean(),
                           scale = ((drawn.rowwise() - centre).colwise().norm() / std::sqrt(k_draws))
                                       .cwiseMax(1e-300);
  Eigen::MatrixXd functions = functions_of(drawn, centre, scale);
  const Eigen::RowVectorXd means = functions.colwise().mean();
  functions.rowwise() -= means;
  Eigen::VectorXd ratio;
  h.log_density(points, ratio);
  ratio = (ratio - log_q).array().exp();
  ControlVariates controls;
  controls.covariance_of_means = functions.transpose() * functions / k_draws / k_draws;
  controls.values = functions_of(variables ? variables(points) : points, centre, scale);
  controls.values.array().colwise() *= ratio.array();
  controls.values.rowwise() -= means;
  return controls;
}

std::optional<CalibratedWeights> calibrate(const ControlVariates& controls, const Eigen::VectorXd& weights,
                                           const Eigen::MatrixXd& variables) {
  constexpr double k_ridge = 1e-10;
  const Eigen::Index n = weights.size();
  const Eigen::RowVectorXd mean = controls.values.colwise().mean();
  Eigen::MatrixXd centred = controls.values.rowwise() - mean;
  const Eigen::RowVectorXd unit = (centred.colwise().norm() / std::sqrt(n)).cwiseMax(1e-300);
  centred.array().rowwise() /= unit.array();
  Eigen::MatrixXd gram = centred.transpose() * centred / n;
  gram.diagonal().array() += k_ridge;
  const Eigen::LDLT<Eigen::MatrixXd> solver(gram);
  const Eigen::VectorXd shift = solver.solve((mean.array() / unit.array()).matrix().transpose());
  CalibratedWeights calibrated;
  calibrated.weights = weights.cwiseProduct((1 - (centred * shift).array()).matrix());
  if (!calibrated.weights.allFinite() || calibrated.weights.minCoeff() < 0) return std::nullopt;
  calibrated.weights /= calibrated.weights.sum();
  const Eigen::MatrixXd of_means =
      unit.cwiseInverse().asDiagonal() * controls.covariance_of_means * unit.cwiseInverse().asDiagonal();
  // Of what one draw adds to a moment, what the controls do not explain; and the errors of their own means.
  const auto error_of = [&](const Eigen::ArrayXd& influence) {
    const Eigen::VectorXd about_mean = (influence - influence.mean()).matrix();
    const Eigen::VectorXd slope = solver.solve(centred.transpose() * about_mean / n);
    return std::sqrt((about_mean - centred * slope).squaredNorm() +
                     std::pow(n, 2) * slope.dot(of_means * slope));
  };
  // Where the bulk is explained, what is left is made by a few draws far out, and known less well.
  constexpr double k_max_gain = 1.5;
  const MomentErrors before = standard_errors(variables, weights);
  calibrated.errors = {before.mean / k_max_gain, before.deviation / k_max_gain};
  const auto& w = calibrated.weights;
  for (Eigen::Index k = 0; k < variables.cols(); ++k) {
    const auto x = variables.col(k).array();
    const double centre = x.matrix().dot(w), variance = (w.array() * (x - centre).square()).sum();
    if (!(variance > 0)) continue;
    const Eigen::ArrayXd t = (x - centre) / std::sqrt(variance);
    calibrated.errors.mean = std::max(calibrated.errors.mean, error_of(weights.array() * t));
    calibrated.errors.deviation =
        std::max(calibrated.errors.deviation, error_of(0.5 * weights.array() * (t.square() - 1)));
  }
  return calibrated;
}

}  // namespace knothe::posterior
