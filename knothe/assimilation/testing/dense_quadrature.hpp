#pragma once
/// @file A posterior by the trapezoidal rule on a dense tensor grid, written out plainly: what the answers of
/// the program are compared with.
#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <vector>

#include "knothe/posterior/log_density.hpp"

namespace knothe::assimilation::test {

/// Moments of f(z) (coordinate by coordinate), marginals in z and evidence of exp(log-density), 1 to 3
/// variables. The density decays at the ends of the window, so the rule converges faster than any power as
/// long as it is resolved.
class DenseQuadrature {
 public:
  using Transform = std::function<double(Eigen::Index k, double z)>;

  /// `points` per axis, on the part of |z| ≤ 8.5 where the log-density is within 45 of its maximum.
  DenseQuadrature(posterior::LogDensity& target, const Transform& transform, Eigen::Index points = 301)
      : target_(target), d_(target.dimension()), n_(points) {
    first_ = Eigen::VectorXd::Constant(d_, -8.5);
    last_ = -first_;
    while (zoom() < 0.8) {
    }
    integrate(transform);
  }

  Eigen::VectorXd mean;        ///< d, of f(z)
  Eigen::MatrixXd covariance;  ///< d × d
  double log_evidence = 0;
  bool resolved = true;  ///< the narrowest marginal spans at least 6 nodes per standard deviation

  [[nodiscard]] double node(Eigen::Index k, Eigen::Index i) const {
    return first_[k] + static_cast<double>(i) * spacing(k);
  }
  [[nodiscard]] double spacing(Eigen::Index k) const {
    return (last_[k] - first_[k]) / static_cast<double>(n_ - 1);
  }

  /// Quantile of z_k. The marginal is that of its nodes by sinc interpolation, exact as far as it is
  /// resolved: P(z_k ≤ x) = Σ mass_i (½ + Si(π (x − node_i)/h)/π).
  [[nodiscard]] double quantile(Eigen::Index k, double level) const {
    double low = first_[k], high = last_[k];
    while (high - low > 1e-9) {
      const double x = 0.5 * (low + high);
      double below = 0;
      for (Eigen::Index i = 0; i < n_; ++i)
        below +=
            marginal_(i, k) * spacing(k) * (0.5 + sine_integral(M_PI * (x - node(k, i)) / spacing(k)) / M_PI);
      (below < level ? low : high) = x;
    }
    return low;
  }

  /// Given each node of the first axis: mass (sum 1), and mass times mean and mean square of f(z_k), n × d.
  struct ByFirst {
    Eigen::VectorXd mass;
    Eigen::MatrixXd first, second;
  };
  [[nodiscard]] ByFirst by_first(const Transform& transform) const {
    ByFirst r{Eigen::VectorXd::Zero(n_), Eigen::MatrixXd::Zero(n_, d_), Eigen::MatrixXd::Zero(n_, d_)};
    Eigen::MatrixXd value(n_, d_);
    for (Eigen::Index k = 0; k < d_; ++k)
      for (Eigen::Index i = 0; i < n_; ++i) value(i, k) = transform(k, node(k, i));
    for_each_node([&](const std::array<Eigen::Index, 3>& index, double log_density) {
      const double weight = std::exp(log_density - maximum_) / total_;
      const Eigen::Index row = index[0];
      r.mass[row] += weight;
      for (Eigen::Index k = 0; k < d_; ++k) {
        const double f = value(index[static_cast<std::size_t>(k)], k);
        r.first(row, k) += weight * f;
        r.second(row, k) += weight * f * f;
      }
    });
    return r;
  }

  /// Σ f(z) π(z) cell, for any f of a point.
  [[nodiscard]] double expectation(const std::function<double(const Eigen::VectorXd&)>& f) const {
    double sum = 0;
    Eigen::VectorXd z(d_);
    for_each_node([&](const std::array<Eigen::Index, 3>& index, double value) {
      for (Eigen::Index k = 0; k < d_; ++k) z[k] = node(k, index[static_cast<std::size_t>(k)]);
      sum += std::exp(value - maximum_) / total_ * f(z);
    });
    return sum;
  }

 private:
  /// Si(x) = ∫ sin(t)/t from 0 to x, to 1e-6: its series, and far out its asymptotic one.
  static double sine_integral(double x) {
    const double y = std::abs(x), q = y * y;
    double sum = 0;
    if (y < 16) {
      double term = y;  // (−1)ⁿ y²ⁿ⁺¹/(2n + 1)!
      for (int n = 0; n < 60; ++n) {
        sum += term / (2 * n + 1);
        term *= -q / ((2.0 * n + 2) * (2.0 * n + 3));
      }
    } else {
      sum = M_PI / 2 - std::cos(y) / y * (1 - 2 / q + 24 / (q * q) - 720 / (q * q * q)) -
            std::sin(y) / q * (1 - 6 / q + 120 / (q * q) - 5040 / (q * q * q));
    }
    return x < 0 ? -sum : sum;
  }

  /// body(multi-index, log-density), the last axis fastest.
  template <class Body>
  void for_each_node(const Body& body) const {
    Eigen::MatrixXd z(n_, d_);
    for (Eigen::Index i = 0; i < n_; ++i) z(i, d_ - 1) = node(d_ - 1, i);
    posterior::LogDensityBatch batch;
    batch.resize(n_, d_, 0);
    std::array<Eigen::Index, 3> index{};
    const Eigen::Index rows = d_ == 1 ? 1 : d_ == 2 ? n_ : n_ * n_;
    for (Eigen::Index row = 0; row < rows; ++row) {
      if (d_ == 2) index[0] = row;
      if (d_ == 3) index[0] = row / n_, index[1] = row % n_;
      for (Eigen::Index k = 0; k + 1 < d_; ++k)
        z.col(k).setConstant(node(k, index[static_cast<std::size_t>(k)]));
      target_.evaluate(z, 0, batch);
      for (Eigen::Index i = 0; i < n_; ++i) {
        index[static_cast<std::size_t>(d_ - 1)] = i;
        body(index, batch.value[i]);
      }
    }
  }

  /// Makes the window smaller; by how much, on the axis where it is most.
  double zoom() {
    maximum_ = -std::numeric_limits<double>::infinity();
    for_each_node([&](const auto&, double value) { maximum_ = std::max(maximum_, value); });
    std::array<Eigen::Index, 3> low{n_, n_, n_}, high{};
    for_each_node([&](const std::array<Eigen::Index, 3>& index, double value) {
      if (!(value > maximum_ - 45)) return;
      for (std::size_t k = 0; k < 3; ++k) {
        low[k] = std::min(low[k], index[k]);
        high[k] = std::max(high[k], index[k]);
      }
    });
    double shrink = 1;
    const Eigen::VectorXd before = last_ - first_;
    for (Eigen::Index k = 0; k < d_; ++k) {
      const auto axis = static_cast<std::size_t>(k);
      const double from = node(k, std::max<Eigen::Index>(low[axis] - 1, 0));
      last_[k] = node(k, std::min<Eigen::Index>(high[axis] + 1, n_ - 1));
      first_[k] = from;
      shrink = std::min(shrink, (last_[k] - first_[k]) / before[k]);
    }
    return shrink;
  }

  void integrate(const Transform& transform) {
    marginal_.setZero(n_, d_);
    Eigen::VectorXd first = Eigen::VectorXd::Zero(d_), here(d_), origin(d_);
    Eigen::MatrixXd second = Eigen::MatrixXd::Zero(d_, d_), value(n_, d_);
    for (Eigen::Index k = 0; k < d_; ++k) {
      for (Eigen::Index i = 0; i < n_; ++i) value(i, k) = transform(k, node(k, i));
      origin[k] = value(n_ / 2, k);  // moments about a point of the window lose no digits
    }
    total_ = 0;
    for_each_node([&](const std::array<Eigen::Index, 3>& index, double log_density) {
      const double weight = std::exp(log_density - maximum_);
      if (weight == 0) return;
      for (Eigen::Index k = 0; k < d_; ++k) {
        const Eigen::Index i = index[static_cast<std::size_t>(k)];
        marginal_(i, k) += weight;
        here[k] = value(i, k) - origin[k];
      }
      total_ += weight;
      first += weight * here;
      second.noalias() += weight * here * here.transpose();
    });
    log_evidence = maximum_ + std::log(total_);
    mean = origin + first / total_;
    covariance = second / total_ - (first / total_) * (first / total_).transpose();
    for (Eigen::Index k = 0; k < d_; ++k) {
      log_evidence += std::log(spacing(k));
      marginal_.col(k) /= total_ * spacing(k);
      const Eigen::ArrayXd at = Eigen::ArrayXd::LinSpaced(n_, first_[k], last_[k]);
      const Eigen::ArrayXd mass = marginal_.col(k).array() * spacing(k);
      const double m = (mass * at).sum();
      if (std::sqrt((mass * (at - m).square()).sum()) < 6 * spacing(k)) resolved = false;
    }
  }

  posterior::LogDensity& target_;
  Eigen::Index d_, n_;
  Eigen::VectorXd first_, last_;
  double maximum_ = 0, total_ = 0;
  Eigen::MatrixXd marginal_;  ///< points per axis × d, density of z_k
};

}  // namespace knothe::assimilation::test
