#include "knothe/assimilation/monitor/evidence_monitor.hpp"

#include <algorithm>
#include <cmath>

#include "knothe/numerics/statistics/chi_squared.hpp"
#include "knothe/numerics/statistics/normal_distribution.hpp"

namespace knothe::assimilation {
namespace {

/// For each parameter a direction of w, orthonormal in the metric of G to those before, along which the
/// prediction moves with it; zero where it hardly does (less than a thousandth of the noise).
Eigen::MatrixXd moving_directions(const Eigen::MatrixXd& quadratic, const Eigen::MatrixXd& tangent) {
  Eigen::MatrixXd directions = Eigen::MatrixXd::Zero(tangent.rows(), tangent.cols());
  for (Eigen::Index a = 0; a < tangent.cols(); ++a) {
    Eigen::VectorXd h = tangent.col(a);
    for (int pass = 0; pass < 2; ++pass) h -= directions * (directions.transpose() * (quadratic * h)).eval();
    const double square = h.dot(quadratic * h);
    if (square > 1e-6) directions.col(a) = h / std::sqrt(square);
  }
  return directions;
}

}  // namespace

PredictiveCheck predictive_check(const likelihood::StepForm& form, const likelihood::PosteriorFunctions& w,
                                 const Eigen::VectorXd& central) {
  PredictiveCheck check;
  const Eigen::Index d = w.tangent.cols(), n = w.deviation.cols();
  check.lower_probability = Eigen::VectorXd::Constant(d, 0.5);
  if (form.used == 0) return check;
  // With v̄ = w̄ − w₀ the datum's residual from ȳ has misfit c − 2 gᵀv̄ + v̄ᵀGv̄ and slope γ = g − G v̄ in w.
  const Eigen::VectorXd centre = w.mean - central;
  const Eigen::VectorXd slope = form.linear - form.quadratic * centre;
  const double misfit = form.constant - centre.dot(form.linear + slope);
  const Eigen::MatrixXd moved = form.quadratic * w.deviation;
  const Eigen::ArrayXd square = (w.deviation.array() * moved.array()).colwise().sum().transpose();
  const Eigen::ArrayXd along = w.deviation.transpose() * slope;
  const Eigen::ArrayXd log_likelihood = -0.5 * (misfit - 2 * along + square + form.log_normaliser);
  const double largest = log_likelihood.maxCoeff();
  check.log_density = largest + std::log((log_likelihood - largest).exp().matrix().dot(w.weights));

  const Eigen::MatrixXd directions = moving_directions(form.quadratic, w.tangent);
  const Eigen::VectorXd observed = directions.transpose() * slope;
  const Eigen::MatrixXd expected = directions.transpose() * moved;  // d × n, of each point
  Eigen::ArrayXd weight = w.weights;
  // A node of a lattice stands for its cell, evenly: so much more variance along the directions.
  Eigen::VectorXd variance = Eigen::VectorXd::Ones(d);
  if (w.cell.size() > 0)
    variance += (directions.transpose() * (form.quadratic * w.cell)).rowwise().squaredNorm() / 12;
  double degrees = form.used;
  for (Eigen::Index a = 0; a < d; ++a) {
    if (directions.col(a).isZero(0)) continue;
    degrees -= 1;
    const Eigen::ArrayXd miss = observed[a] - expected.row(a).transpose().array();
    double lower = 0;
    for (Eigen::Index k = 0; k < n; ++k)
      lower += weight[k] * numerics::normal_cdf(miss[k] / std::sqrt(variance[a]));
    check.lower_probability[a] = std::min(1.0, lower);
    const Eigen::ArrayXd log_weight = -0.5 / variance[a] * miss.square();
    weight *= (log_weight - log_weight.maxCoeff()).exp();
    const double sum = weight.sum();
    weight = sum > 0 ? Eigen::ArrayXd(weight / sum) : Eigen::ArrayXd(w.weights);
  }
  if (degrees < 1) return check;
  const double outside = std::max(0.0, misfit - observed.squaredNorm());
  const Eigen::ArrayXd lambda = (square - expected.array().square().colwise().sum().transpose()).max(0.0);
  const std::size_t count = n;
  check.upper_probability =
      numerics::mean_noncentral_upper(outside, degrees, {lambda.data(), count}, {weight.data(), count});
  return check;
}

double predictive_score(double probability, double largest) {
  return std::clamp(numerics::normal_quantile(probability), -largest, largest);
}

}  // namespace knothe::assimilation
