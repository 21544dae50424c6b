#include "knothe/posterior/draws/polar_scan.hpp"

#include <cassert>
#include <cmath>
#include <limits>
#include <numbers>

#include "knothe/numerics/statistics/weighted_statistics.hpp"

namespace knothe::posterior {

PolarScan::PolarScan(CheckedDensity& target, const Eigen::VectorXd& centre, const Eigen::MatrixXd& lower,
                     double first, double last, double spacing) {
  const Eigen::Index d = centre.size();
  assert(d >= 1 && d <= k_max_dimension);
  rings_ = 1 + std::ceil(std::log(last / first) / spacing);
  directions_ = d == 1 ? 2 : std::ceil(2 * std::numbers::pi / spacing);
  const double turn = 2 * std::numbers::pi / directions_;
  const Eigen::Index n = 1 + rings_ * directions_;
  Eigen::MatrixXd unit(2 * directions_, d);  // the directions of even rings, then those of odd ones
  for (Eigen::Index j = 0; j < directions_; ++j) {
    if (d == 1) {
      unit(j, 0) = unit(directions_ + j, 0) = j == 0 ? 1 : -1;
      continue;
    }
    for (const Eigen::Index odd : {0, 1}) {
      const double angle = turn * (j + 0.5 * odd);
      unit(odd * directions_ + j, 0) = std::cos(angle), unit(odd * directions_ + j, 1) = std::sin(angle);
    }
  }
  unit *= lower.transpose();
  points_.resize(n, d);
  points_.row(0) = centre.transpose();
  const double log_determinant = lower.diagonal().array().log().sum();
  const double log_innermost = std::log(first) - 0.5 * spacing;
  log_mass_.resize(n);
  log_mass_[0] = log_determinant + (d == 1 ? std::log(2.0) : std::log(std::numbers::pi)) + d * log_innermost;
  for (Eigen::Index i = 0; i < rings_; ++i) {
    const double log_radius = std::log(first) + spacing * i;
    const Eigen::Index at = 1 + i * directions_;
    points_.middleRows(at, directions_) =
        (std::exp(log_radius) * unit.middleRows((i % 2) * directions_, directions_)).rowwise() +
        centre.transpose();
    log_mass_.segment(at, directions_)
        .setConstant(log_determinant + std::log(spacing) + d * log_radius + (d == 1 ? 0 : std::log(turn)));
  }
  LogDensityBatch batch;
  target.evaluate(points_, 0, batch);
  values_ = batch.value;
  log_mass_ += values_;
}

double PolarScan::log_evidence() const {
  return numerics::log_sum(log_mass_);
}

std::vector<Eigen::Index> PolarScan::local_maxima() const {
  std::vector<Eigen::Index> found;
  const auto below = [&](Eigen::Index i, Eigen::Index other) {
    return values_[i] < values_[other] || (values_[i] == values_[other] && other < i);
  };
  for (Eigen::Index r = 0; r < rings_; ++r)
    for (Eigen::Index j = 0; j < directions_; ++j) {
      const auto at = [&](Eigen::Index ring, Eigen::Index direction) {
        return ring < 0 ? 0 : 1 + ring * directions_ + (direction + directions_) % directions_;
      };
      const Eigen::Index i = at(r, j);
      if (!std::isfinite(values_[i])) continue;
      bool is_highest = true;
      const auto look = [&](Eigen::Index other) { is_highest = is_highest && !below(i, other); };
      // On odd rings direction j lies between j and j + 1 of the even ones.
      const Eigen::Index other_side = r % 2 == 0 ? j - 1 : j + 1;
      for (const Eigen::Index ring : {r - 1, r + 1}) {
        if (ring == rings_) continue;
        look(at(ring, j));
        if (points_.cols() > 1) look(at(ring, other_side));
      }
      if (points_.cols() > 1) look(at(r, j - 1)), look(at(r, j + 1));
      if (is_highest) found.push_back(i);
    }
  return found;
}

std::vector<Eigen::Index> PolarScan::sample(Eigen::Index count) const {
  const Eigen::ArrayXd mass = (log_mass_.array() - log_evidence()).exp();
  std::vector<Eigen::Index> chosen;
  double cumulative = 0.5;
  for (Eigen::Index i = 0; i < mass.size(); ++i) {
    cumulative += count * mass[i];
    for (; cumulative >= 1 && std::ssize(chosen) < count; cumulative -= 1) chosen.push_back(i);
  }
  return chosen;
}

}  // namespace knothe::posterior
