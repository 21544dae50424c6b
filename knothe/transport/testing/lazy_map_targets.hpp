#pragma once
/// @file Targets in many dimensions with few informed directions, and their answers by dense quadrature: for
/// tests, benchmark and example.
#include <Eigen/Dense>
#include <cmath>
#include <numbers>

#include "knothe/numerics/statistics/random.hpp"
#include "knothe/sampling/log_density.hpp"

namespace knothe::transport::targets {

/// Prior N(0, I) in R^d; three measurements with errors of 0.3 of nonlinear functions of u = Wᵀz,
///   f_1 = u_1 + 0.5 u_2²,  f_2 = u_2 + 0.4 u_1 u_3,  f_3 = u_3 + 0.25 u_1²,
/// W (d × 3) orthonormal. Gives first derivatives only.
struct NonlinearSubspace final : sampling::LogDensity {
  Eigen::MatrixXd w;
  Eigen::Vector3d data{0.8, -0.5, 0.4};
  double error = 0.3;

  explicit NonlinearSubspace(Eigen::Index d) {
    const Eigen::MatrixXd random = numerics::monte_carlo_normal_points(d, 3, 1906);
    w = Eigen::HouseholderQR<Eigen::MatrixXd>(random).householderQ() * Eigen::MatrixXd::Identity(d, 3);
  }
  [[nodiscard]] Eigen::Index dimension() const override { return w.rows(); }
  [[nodiscard]] int available_derivatives() const override { return 1; }

  /// log likelihood at u and its gradient.
  double log_likelihood(const Eigen::Vector3d& u, Eigen::Vector3d* gradient) const {
    const Eigen::Vector3d f(u[0] + 0.5 * u[1] * u[1], u[1] + 0.4 * u[0] * u[2], u[2] + 0.25 * u[0] * u[0]);
    const Eigen::Vector3d r = (f - data) / (error * error);
    if (gradient)
      *gradient << -(r[0] + 0.4 * u[2] * r[1] + 0.5 * u[0] * r[2]), -(u[1] * r[0] + r[1]),
          -(0.4 * u[0] * r[1] + r[2]);
    return -0.5 * (f - data).dot(r) - 3 * std::log(error) - 1.5 * std::log(2 * std::numbers::pi);
  }
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& z, int derivatives,
                sampling::LogDensityBatch& out) override {
    const Eigen::MatrixXd u = z * w;
    Eigen::MatrixXd slope(z.rows(), 3);
    Eigen::Vector3d g = Eigen::Vector3d::Zero();
    for (Eigen::Index i = 0; i < z.rows(); ++i) {
      out.value[i] = log_likelihood(u.row(i).transpose(), derivatives >= 1 ? &g : nullptr);
      slope.row(i) = g.transpose();
    }
    out.value.array() += -0.5 * z.rowwise().squaredNorm().array() -
                         0.5 * static_cast<double>(z.cols()) * std::log(2 * std::numbers::pi);
    if (derivatives < 1) return;
    out.gradient = -z;
    out.gradient.noalias() += slope * w.transpose();
  }

  struct Answer {
    double log_evidence = 0;
    Eigen::Vector3d mean;
    Eigen::Matrix3d covariance;
  };
  /// Of u, by the trapezoidal rule on n³ points of the prior's ±5.5.
  [[nodiscard]] Answer dense_quadrature(int n = 80) const {
    const double step = 11.0 / n;
    double sum = 0;
    Eigen::Vector3d first = Eigen::Vector3d::Zero();
    Eigen::Matrix3d second = Eigen::Matrix3d::Zero();
    for (int i = 0; i <= n; ++i)
      for (int j = 0; j <= n; ++j)
        for (int k = 0; k <= n; ++k) {
          const Eigen::Vector3d u(-5.5 + step * i, -5.5 + step * j, -5.5 + step * k);
          const double p = std::exp(log_likelihood(u, nullptr) - 0.5 * u.squaredNorm());
          sum += p;
          first += p * u;
          second.noalias() += (p * u) * u.transpose();
        }
    Answer answer;
    answer.log_evidence = std::log(sum * step * step * step) - 1.5 * std::log(2 * std::numbers::pi);
    answer.mean = first / sum;
    answer.covariance = second / sum - answer.mean * answer.mean.transpose();
    return answer;
  }
};

}  // namespace knothe::transport::targets
