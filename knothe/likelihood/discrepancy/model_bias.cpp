#include "knothe/likelihood/discrepancy/model_bias.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>

namespace knothe::likelihood {
namespace {

/// Rows of the time modes that are kept: more than any extrapolation looks back.
constexpr Eigen::Index k_window = 32;
/// Weight of the newest error in the running mean of their squares.
constexpr double k_newest = 0.2;

Eigen::Index kept_rank(const BiasOptions& options) {
  return options.rank + 4;
}

}  // namespace

ModelBias::ModelBias(Eigen::VectorXd noise_std, BiasOptions options)
    : noise_std_(std::move(noise_std)),
      options_(options),
      mean_(noise_std_.size(), kept_rank(options), k_window),
      std_(noise_std_.size(), kept_rank(options), k_window) {
  assert(options_.rank >= 1 && (noise_std_.array() > 0).all());
  error_.setZero(options_.rank, options_.rank);
}

Eigen::Index ModelBias::used(const numerics::IncrementalSvd& svd) const {
  return std::min<Eigen::Index>(svd.rank(), options_.rank);
}

Eigen::VectorXd ModelBias::coefficients(const numerics::IncrementalSvd& svd, double time) const {
  const Eigen::MatrixXd series = svd.time() * svd.singular_values().asDiagonal();
  Eigen::VectorXd ahead(used(svd));
  for (Eigen::Index k = 0; k < ahead.size(); ++k) {
    const std::size_t n = series.rows();
    ahead[k] = likelihood::extrapolate(options_.order, options_.window, times_,
                                       std::span(series.col(k).data(), n), time);
  }
  return ahead;
}

ModelBias::Ahead ModelBias::ahead(double time) const {
  Ahead next;
  next.coefficients = coefficients(mean_, time);
  next.mean = mean_.space().leftCols(next.coefficients.size()) * next.coefficients;
  const Eigen::VectorXd spread = coefficients(std_, time);
  next.std = std_.space().leftCols(spread.size()) * spread;
  return next;
}

void ModelBias::add(double time, Eigen::VectorXd mean, const Eigen::VectorXd& prediction_std) {
  assert(times_.empty() || time > times_.back());
  mean.array() /= noise_std_.array();
  const Eigen::VectorXd std = (1 + (prediction_std.array() / noise_std_.array()).square()).sqrt();
  Ahead expected;
  if (steps() > 0) expected = ahead(time);
  for (Eigen::Index i = 0; i < mean.size(); ++i) {
    if (std::isnan(mean[i])) mean[i] = steps() > 0 ? expected.mean[i] : 0.0;
  }
  const Eigen::Index k = expected.coefficients.size();
  const Eigen::MatrixXd before = mean_.space().leftCols(k);
  if (k > 0) {
    // How far the modes were off, in their own coordinates.
    const Eigen::VectorXd miss = before.transpose() * mean - expected.coefficients;
    error_.topLeftCorner(k, k) *= 1 - k_newest;
    error_.topLeftCorner(k, k).noalias() += k_newest * miss * miss.transpose();
    error_weight_ = (1 - k_newest) * error_weight_ + k_newest;
  }
  mean_.append(mean);
  std_.append(std);
  if (k > 0) {
    const Eigen::MatrixXd turn = mean_.space().leftCols(used(mean_)).transpose() * before;
    const Eigen::MatrixXd turned = turn * error_.topLeftCorner(k, k) * turn.transpose();
    error_.setZero();
    error_.topLeftCorner(turned.rows(), turned.cols()) = turned;
  }
  times_.push_back(time);
  if (std::ssize(times_) > k_window) times_.erase(times_.begin());
}

std::optional<Eigen::VectorXd> ModelBias::latest() const {
  if (steps() == 0) return std::nullopt;
  const Eigen::Index k = used(mean_);
  const Eigen::VectorXd coefficients =
      mean_.time().bottomRows(1).leftCols(k).transpose().cwiseProduct(mean_.singular_values().head(k));
  return (mean_.space().leftCols(k) * coefficients).cwiseProduct(noise_std_);
}

std::optional<BiasCorrection> ModelBias::extrapolate(double time) const {
  if (steps() == 0) return std::nullopt;
  const Ahead next = ahead(time);
  BiasCorrection correction;
  correction.mean = next.mean.cwiseProduct(noise_std_);
  // π_B̂ contains the measurement noise: never less than that.
  correction.scale = next.std.cwiseMax(1.0);
  const bool adds_error = options_.way == BiasOptions::Way::modes && error_weight_ > 0;
  correction.factor.setZero(noise_std_.size(), adds_error ? next.coefficients.size() : 0);
  for (Eigen::Index j = 0; j < correction.factor.cols(); ++j) {
    // What a mode was off by beyond the measurement noise in its own coordinate.
    const double variance = std::max(0.0, error_(j, j) / error_weight_ - 1);
    correction.factor.col(j) = std::sqrt(variance) * mean_.space().col(j).cwiseProduct(noise_std_);
  }
  return correction;
}

}  // namespace knothe::likelihood
