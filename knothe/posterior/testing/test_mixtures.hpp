#pragma once
/// @file Mixtures of Gaussians in any dimension, given and random, with derivatives: for tests.
#include <Eigen/Dense>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "knothe/posterior/log_density.hpp"
#include "knothe/posterior/random_numbers.hpp"

namespace knothe::posterior::targets {

/// log Σ w_k N(z; m_k, P_k⁻¹), Σ w = 1: evidence 1.
struct Mixture : LogDensity {
  struct Component {
    double weight;
    Eigen::VectorXd mean;
    Eigen::MatrixXd precision;
  };
  std::vector<Component> components;
  int derivatives = 2;

  explicit Mixture(std::vector<Component> c) : components(std::move(c)) {
    for (const auto& k : components)
      log_factor_.push_back(std::log(k.weight) -
                            0.5 * static_cast<double>(dimension()) * std::log(2 * std::numbers::pi) +
                            Eigen::MatrixXd(k.precision.llt().matrixL()).diagonal().array().log().sum());
  }
  [[nodiscard]] Eigen::Index dimension() const override { return components.front().mean.size(); }
  [[nodiscard]] int available_derivatives() const override { return derivatives; }
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& z, int order, LogDensityBatch& out) override {
    const Eigen::Index d = dimension();
    const std::size_t m = components.size();
    std::vector<double> term(m);
    std::vector<Eigen::VectorXd> slope(m);
    for (Eigen::Index i = 0; i < z.rows(); ++i) {
      double top = -std::numeric_limits<double>::infinity();
      for (std::size_t k = 0; k < m; ++k) {
        const Eigen::VectorXd u = z.row(i).transpose() - components[k].mean;
        slope[k] = -components[k].precision * u;
        term[k] = log_factor_[k] + 0.5 * u.dot(slope[k]);
        top = std::max(top, term[k]);
      }
      double sum = 0;
      for (double t : term) sum += std::exp(t - top);
      out.value[i] = top + std::log(sum);
      if (order < 1) continue;
      Eigen::VectorXd gradient = Eigen::VectorXd::Zero(d);
      Eigen::MatrixXd hessian = Eigen::MatrixXd::Zero(d, d);
      for (std::size_t k = 0; k < m; ++k) {
        const double share = std::exp(term[k] - top) / sum;
        if (share == 0) continue;
        gradient += share * slope[k];
        hessian += share * (slope[k] * slope[k].transpose() - components[k].precision);
      }
      out.gradient.row(i) = gradient.transpose();
      if (order < 2) continue;
      hessian -= gradient * gradient.transpose();
      for (Eigen::Index a = 0; a < d; ++a)
        for (Eigen::Index b = 0; b <= a; ++b) out.hessian(i, packed_index(a, b)) = hessian(a, b);
    }
  }

 private:
  std::vector<double> log_factor_;
};

/// A random covariance: standard deviations `scale` times 1/spread … spread, correlations of a random
/// rotation.
inline Eigen::MatrixXd random_covariance(Eigen::Index d, double scale, double spread, RandomNumbers& random) {
  const Eigen::MatrixXd q = random.normals(d, d).householderQr().householderQ();
  Eigen::VectorXd std(d);
  for (Eigen::Index k = 0; k < d; ++k) std[k] = scale * std::pow(spread, 2 * random.uniform() - 1);
  return q * std.cwiseAbs2().asDiagonal() * q.transpose();
}

/// How random mixtures are made.
struct RandomMixture {
  double min_weight = 0.02;
  double nearest = 6,
         farthest = 40;       ///< each mode from the mode before it, in std of the wider one on the line
  double size_spread = 2;     ///< components are 1/2 … 2 times as wide as each other, and …
  double shape_spread = 1.7;  ///< … their axes 1/1.7 … 1.7 times as long
};

/// 2 to 4 modes in 1 to 5 dimensions, weights down to `min_weight`, none nearer to another than `nearest`
/// standard deviations of the wider one; anywhere within some units of 0, and of any scale from 0.1 to 10.
inline Mixture random_mixture(RandomNumbers& random, const RandomMixture& how = {}) {
  const Eigen::Index d = 1 + random.index(5);
  const auto m = static_cast<std::size_t>(2 + random.index(3));
  const double unit = std::pow(10.0, 2 * random.uniform() - 1);
  std::vector<Mixture::Component> components;
  std::vector<Eigen::MatrixXd> covariances;
  double total = 0;
  for (std::size_t k = 0; k < m; ++k) {
    // Weights from ½ … down to min_weight, evenly on a logarithmic scale.
    const double weight =
        k == 0 ? 0.5 : std::exp(std::log(how.min_weight) * random.uniform() + std::log(0.5) * 0.5);
    const double size = unit * std::pow(how.size_spread, 2 * random.uniform() - 1);
    const Eigen::MatrixXd covariance = random_covariance(d, size, how.shape_spread, random);
    Eigen::VectorXd mean = 3 * unit * random.normals(d, 1).col(0);
    if (k > 0) {
      bool apart = false;
      while (!apart) {
        const Eigen::VectorXd direction = random.normals(d, 1).col(0).normalized();
        const auto along = [&](const Eigen::MatrixXd& c, const Eigen::VectorXd& u) {
          return std::sqrt(u.dot(c * u));
        };
        const double separation = how.nearest * std::pow(how.farthest / how.nearest, random.uniform());
        mean = components[k - 1].mean +
               separation * std::max(along(covariance, direction), along(covariances[k - 1], direction)) *
                   direction;
        apart = true;
        for (std::size_t j = 0; j < k; ++j) {
          const Eigen::VectorXd between = mean - components[j].mean;
          const Eigen::VectorXd u = between.normalized();
          apart = apart && between.norm() >=
                               0.999 * how.nearest * std::max(along(covariance, u), along(covariances[j], u));
        }
      }
    }
    components.push_back({weight, mean, covariance.inverse()});
    covariances.push_back(covariance);
    total += weight;
  }
  for (auto& c : components) c.weight /= total;
  return Mixture(std::move(components));
}

}  // namespace knothe::posterior::targets
