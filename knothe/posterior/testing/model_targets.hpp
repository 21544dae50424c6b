#pragma once
/// @file Posteriors of statistical models, with exact gradients and Hessians, for tests and benchmarks: the
/// problems on which methods of Bayesian inference are commonly compared.
#include <Eigen/Dense>
#include <array>
#include <cmath>
#include <numbers>

#include "knothe/numerics/statistics/random.hpp"
#include "knothe/posterior/log_density.hpp"

namespace knothe::posterior::targets {

inline constexpr double k_log_two_pi = 1.8378770664093454836;

/// A density given point by point.
struct Pointwise : LogDensity {
  /// The value at z; gradient and Hessian (lower triangle) are sized, zero, and filled for order ≥ 1, 2.
  virtual double at(const Eigen::VectorXd& z, int order, Eigen::VectorXd& gradient,
                    Eigen::MatrixXd& hessian) const = 0;
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int order, LogDensityBatch& out) override {
    const Eigen::Index d = dimension();
    z_.resize(d);
    gradient_.resize(d);
    hessian_.resize(d, d);
    for (Eigen::Index i = 0; i < points.rows(); ++i) {
      z_ = points.row(i);
      if (order >= 1) gradient_.setZero();
      if (order >= 2) hessian_.setZero();
      out.value[i] = at(z_, order, gradient_, hessian_);
      if (order >= 1) out.gradient.row(i) = gradient_;
      if (order >= 2)
        for (Eigen::Index a = 0; a < d; ++a)
          for (Eigen::Index b = 0; b <= a; ++b) out.hessian(i, packed_index(a, b)) = hessian_(a, b);
    }
  }

 protected:
  /// Adds log N(z; 0, I).
  static double standard_normal_prior(const Eigen::VectorXd& z, int order, Eigen::VectorXd& gradient,
                                      Eigen::MatrixXd& hessian) {
    if (order >= 1) gradient -= z;
    if (order >= 2) hessian.diagonal().array() -= 1;
    return -0.5 * z.squaredNorm() - 0.5 * k_log_two_pi * static_cast<double>(z.size());
  }

 private:
  Eigen::VectorXd z_, gradient_;
  Eigen::MatrixXd hessian_;
};

/// y = A z + e, e ~ N(0, noise_std² I), prior N(0, I): everything known.
struct LinearGaussian : Pointwise {
  Eigen::MatrixXd matrix;  ///< A, m × d
  Eigen::VectorXd data;    ///< m
  double noise_std;

  LinearGaussian(Eigen::MatrixXd a, Eigen::VectorXd y, double s)
      : matrix(std::move(a)), data(std::move(y)), noise_std(s), normal_(matrix.transpose() * matrix) {}
  [[nodiscard]] Eigen::Index dimension() const override { return matrix.cols(); }
  double at(const Eigen::VectorXd& z, int order, Eigen::VectorXd& gradient,
            Eigen::MatrixXd& hessian) const override {
    const double precision = 1 / (noise_std * noise_std);
    const Eigen::VectorXd residual = data - matrix * z;
    const double prior = standard_normal_prior(z, order, gradient, hessian);
    if (order >= 1) gradient += precision * (matrix.transpose() * residual);
    if (order >= 2) hessian -= precision * normal_;
    return prior - 0.5 * precision * residual.squaredNorm() -
           static_cast<double>(data.size()) * (0.5 * k_log_two_pi + std::log(noise_std));
  }
  /// Posterior by conjugacy: covariance (I + AᵀA/s²)⁻¹, mean covariance Aᵀy/s².
  [[nodiscard]] Eigen::MatrixXd covariance() const {
    const Eigen::Index d = dimension();
    return (Eigen::MatrixXd::Identity(d, d) + normal_ / (noise_std * noise_std)).inverse();
  }
  [[nodiscard]] Eigen::VectorXd mean() const {
    return covariance() * (matrix.transpose() * data) / (noise_std * noise_std);
  }
  /// log N(y; 0, A Aᵀ + s² I).
  [[nodiscard]] double log_evidence() const {
    const Eigen::Index m = data.size();
    const Eigen::MatrixXd joint =
        matrix * matrix.transpose() + noise_std * noise_std * Eigen::MatrixXd::Identity(m, m);
    const Eigen::LLT<Eigen::MatrixXd> factor(joint);
    const Eigen::VectorXd white = factor.matrixL().solve(data);
    return -0.5 * white.squaredNorm() - factor.matrixLLT().diagonal().array().log().sum() -
           0.5 * k_log_two_pi * static_cast<double>(m);
  }

 private:
  Eigen::MatrixXd normal_;  ///< AᵀA
};

/// A = G D/√m, G of standard normal entries, D diagonal from 1 down to `smallest`; data from a random z.
inline LinearGaussian random_linear_gaussian(Eigen::Index d, double smallest, double noise_std,
                                             std::uint64_t seed) {
  const Eigen::Index m = d + 3;
  Eigen::MatrixXd a = numerics::monte_carlo_normal_points(m, d, seed);
  for (Eigen::Index k = 0; k < d; ++k)
    a.col(k) *= std::pow(smallest, static_cast<double>(k) / static_cast<double>(d - 1)) /
                std::sqrt(static_cast<double>(m));
  const Eigen::VectorXd truth = numerics::monte_carlo_normal_points(1, d, seed + 1).row(0),
                        noise = numerics::monte_carlo_normal_points(1, m, seed + 2).row(0);
  Eigen::VectorXd y = a * truth + noise_std * noise;
  return {std::move(a), std::move(y), noise_std};
}

/// P(y_i = 1) = 1/(1 + exp(−x_iᵀ β)), β = prior_std z, prior N(0, I) in z.
struct LogisticRegression : Pointwise {
  Eigen::MatrixXd covariates;  ///< d × m, one column per outcome
  Eigen::VectorXd outcomes;    ///< m, 0 or 1
  double prior_std = 1;

  LogisticRegression(Eigen::MatrixXd x, Eigen::VectorXd y, double s)
      : covariates(std::move(x)), outcomes(std::move(y)), prior_std(s) {}
  [[nodiscard]] Eigen::Index dimension() const override { return covariates.rows(); }
  double at(const Eigen::VectorXd& z, int order, Eigen::VectorXd& gradient,
            Eigen::MatrixXd& hessian) const override {
    double value = standard_normal_prior(z, order, gradient, hessian);
    const Eigen::Index d = dimension();
    for (Eigen::Index i = 0; i < covariates.cols(); ++i) {
      const double* x = covariates.data() + i * d;
      double eta = 0;
      for (Eigen::Index k = 0; k < d; ++k) eta += prior_std * x[k] * z.data()[k];
      const double tail = std::exp(-std::abs(eta));  // no overflow in either direction
      value += outcomes.data()[i] * eta - std::max(eta, 0.0) - std::log1p(tail);
      if (order < 1) continue;
      const double p = eta >= 0 ? 1 / (1 + tail) : tail / (1 + tail);
      const double first = (outcomes.data()[i] - p) * prior_std,
                   second = -p * (1 - p) * prior_std * prior_std;
      for (Eigen::Index a = 0; a < d; ++a) gradient.data()[a] += first * x[a];
      if (order < 2) continue;
      for (Eigen::Index a = 0; a < d; ++a)
        for (Eigen::Index b = 0; b <= a; ++b) hessian(a, b) += second * x[a] * x[b];
    }
    return value;
  }
};

/// Covariates: a constant and standard normal ones; outcomes drawn with the coefficients β = prior_std z.
inline LogisticRegression synthetic_logistic_regression(Eigen::Index observations, const Eigen::VectorXd& z,
                                                        double prior_std, std::uint64_t covariate_seed,
                                                        std::uint64_t outcome_seed) {
  const Eigen::Index d = z.size();
  Eigen::MatrixXd x = numerics::monte_carlo_normal_points(observations, d, covariate_seed);  // m × d
  x.col(0).setOnes();
  const Eigen::VectorXd u = numerics::monte_carlo_points(observations, 1, outcome_seed).col(0);
  Eigen::VectorXd y(observations);
  for (Eigen::Index i = 0; i < observations; ++i)
    y[i] = u[i] < 1 / (1 + std::exp(-prior_std * x.row(i).dot(z))) ? 1 : 0;
  return {x.transpose(), std::move(y), prior_std};
}

/// The eight schools (D. Rubin 1981), not centred: θ_j = μ + τ η_j, y_j ~ N(θ_j, σ_j²), μ = 5 z_0, τ = exp(1
/// + z_1), η_j = z_{1+j}; prior N(0, I).
struct EightSchools : Pointwise {
  std::array<double, 8> effect = {28, 8, -3, 7, -1, 1, 18, 12};
  std::array<double, 8> standard_error = {15, 10, 16, 11, 9, 11, 10, 18};

  [[nodiscard]] Eigen::Index dimension() const override { return 10; }
  double at(const Eigen::VectorXd& z, int order, Eigen::VectorXd& gradient,
            Eigen::MatrixXd& hessian) const override {
    double value = standard_normal_prior(z, order, gradient, hessian);
    const double tau = std::exp(1 + z[1]);
    for (Eigen::Index j = 0; j < 8; ++j) {
      const double s = standard_error[static_cast<std::size_t>(j)], eta = z[2 + j];
      const double residual = (effect[static_cast<std::size_t>(j)] - 5 * z[0] - tau * eta) / s;
      value -= 0.5 * residual * residual + std::log(s) + 0.5 * k_log_two_pi;
      if (order < 1) continue;
      // θ/s has the derivatives 5/s, τη/s, τ/s in z_0, z_1, z_{2+j}, and second ones τη/s (1,1), τ/s (1,
      // 2+j).
      const double mu1 = 5 / s, tau1 = tau * eta / s, eta1 = tau / s;
      gradient[0] += residual * mu1;
      gradient[1] += residual * tau1;
      gradient[2 + j] += residual * eta1;
      if (order < 2) continue;
      hessian(0, 0) -= mu1 * mu1;
      hessian(1, 0) -= mu1 * tau1;
      hessian(1, 1) += residual * tau1 - tau1 * tau1;
      hessian(2 + j, 0) -= mu1 * eta1;
      hessian(2 + j, 1) += residual * eta1 - tau1 * eta1;
      hessian(2 + j, 2 + j) -= eta1 * eta1;
    }
    return value;
  }
};

struct ExactMoments {
  Eigen::VectorXd mean, standard_deviation;
  double log_evidence = 0;
};

/// Given z_1, hence τ, the model is linear in the other nine variables: closed form for each τ, and the sum
/// over an even grid of z_1, which converges faster than any power of the spacing.
inline ExactMoments exact_moments(const EightSchools& target) {
  const int n = 801;
  const double step = 18.0 / (n - 1);
  Eigen::VectorXd log_weight(n);
  Eigen::MatrixXd first(n, 10), second(n, 10);  // moments given z_1
  for (int i = 0; i < n; ++i) {
    const double z1 = -12 + step * i, tau = std::exp(1 + z1);
    Eigen::MatrixXd a = Eigen::MatrixXd::Zero(8, 9);
    Eigen::VectorXd y(8);
    double log_scale = 0;
    for (Eigen::Index j = 0; j < 8; ++j) {
      const double s = target.standard_error[static_cast<std::size_t>(j)];
      a(j, 0) = 5 / s;
      a(j, 1 + j) = tau / s;
      y[j] = target.effect[static_cast<std::size_t>(j)] / s;
      log_scale += std::log(s);
    }
    const LinearGaussian given(a, y, 1);
    const Eigen::VectorXd mean = given.mean(), variance = given.covariance().diagonal();
    first(i, 0) = mean[0], second(i, 0) = variance[0] + mean[0] * mean[0];
    first(i, 1) = z1, second(i, 1) = z1 * z1;
    first.row(i).tail(8) = mean.tail(8);
    second.row(i).tail(8) = variance.tail(8) + mean.tail(8).cwiseAbs2();
    log_weight[i] = given.log_evidence() - log_scale - 0.5 * (z1 * z1 + k_log_two_pi) + std::log(step);
  }
  const double top = log_weight.maxCoeff();
  const Eigen::VectorXd weight = (log_weight.array() - top).exp();
  ExactMoments exact;
  exact.log_evidence = top + std::log(weight.sum());
  exact.mean = first.transpose() * weight / weight.sum();
  exact.standard_deviation =
      (second.transpose() * weight / weight.sum() - exact.mean.cwiseAbs2()).cwiseSqrt();
  return exact;
}

/// Stochastic volatility (S. Kim, N. Shephard, S. Chib 1998): y_t = exp(x_t/2) ξ_t, x_{t+1} = μ + φ (x_t − μ)
/// + σ ε_t, x_1 from the stationary law, σ = ¼ known, μ ~ N(0, 1), log((1 + φ)/(1 − φ)) ~ N(3, 1). Variables
/// in the order μ, that logit less 3, x_1 … x_T: x_t is, given μ, φ and its neighbours, independent of the
/// others.
struct StochasticVolatility : Pointwise {
  Eigen::VectorXd data;  ///< T
  double innovation_std = 0.25;

  explicit StochasticVolatility(Eigen::VectorXd y) : data(std::move(y)) {}
  [[nodiscard]] Eigen::Index dimension() const override { return 2 + data.size(); }
  double at(const Eigen::VectorXd& z, int order, Eigen::VectorXd& g, Eigen::MatrixXd& h) const override {
    const Eigen::Index count = data.size();
    const double mu = z[0], half = 0.5 * (3 + z[1]), phi = std::tanh(half);
    const double log_s = std::log(4.0) - 2 * (std::abs(half) + std::log1p(std::exp(-2 * std::abs(half))));
    const double s = std::exp(log_s);                 // 1 − φ²
    const double phi1 = 0.5 * s, phi2 = -phi * phi1;  // derivatives in z_1
    const double s1 = -2 * phi * phi1, s2 = -2 * phi1 * phi1 - 2 * phi * phi2;
    const double precision = 1 / (innovation_std * innovation_std);
    const double each = std::log(innovation_std) + 0.5 * k_log_two_pi;
    double value = -0.5 * (mu * mu + z[1] * z[1]) - k_log_two_pi;
    const double first = z[2] - mu;
    value += 0.5 * log_s - 0.5 * precision * s * first * first - each;
    if (order >= 1) {
      g[0] += -mu + precision * s * first;
      g[1] += -z[1] - 0.5 * phi - 0.5 * precision * s1 * first * first;  // ½ (log s)' = −φ/2
      g[2] -= precision * s * first;
    }
    if (order >= 2) {
      h(0, 0) += -1 - precision * s;
      h(1, 0) += precision * s1 * first;
      h(1, 1) += -1 - 0.5 * phi1 - 0.5 * precision * s2 * first * first;
      h(2, 0) += precision * s;
      h(2, 1) -= precision * s1 * first;
      h(2, 2) -= precision * s;
    }
    for (Eigen::Index t = 0; t < count; ++t) {
      const Eigen::Index a = 2 + t;
      const double x = z[a], square = data[t] * data[t] * std::exp(-x);
      value -= 0.5 * (square + x + k_log_two_pi);
      if (order >= 1) g[a] += 0.5 * (square - 1);
      if (order >= 2) h(a, a) -= 0.5 * square;
      if (t + 1 == count) continue;
      const Eigen::Index b = a + 1;
      const double e = z[b] - mu - phi * (x - mu), p = precision;
      value -= 0.5 * p * e * e + each;
      if (order < 1) continue;
      const double e_mu = phi - 1, e_phi = -phi1 * (x - mu), e_a = -phi;  // and 1 in z_b
      g[0] -= p * e * e_mu;
      g[1] -= p * e * e_phi;
      g[a] -= p * e * e_a;
      g[b] -= p * e;
      if (order < 2) continue;
      h(0, 0) -= p * e_mu * e_mu;
      h(1, 0) -= p * (e_phi * e_mu + e * phi1);
      h(1, 1) -= p * (e_phi * e_phi - e * phi2 * (x - mu));
      h(a, 0) -= p * e_a * e_mu;
      h(a, 1) -= p * (e_a * e_phi - e * phi1);
      h(a, a) -= p * e_a * e_a;
      h(b, 0) -= p * e_mu;
      h(b, 1) -= p * e_phi;
      h(b, a) -= p * e_a;
      h(b, b) -= p;
    }
    return value;
  }
};

/// Data of the model itself with μ = −0.5, φ = 0.95.
inline StochasticVolatility synthetic_stochastic_volatility(Eigen::Index count, std::uint64_t seed) {
  const Eigen::MatrixXd normal = numerics::monte_carlo_normal_points(count, 2, seed);
  const double mu = -0.5, phi = 0.95;
  Eigen::VectorXd y(count);
  double x = mu + 0.25 / std::sqrt(1 - phi * phi) * normal(0, 0);
  for (Eigen::Index t = 0; t < count; ++t) {
    if (t > 0) x = mu + phi * (x - mu) + 0.25 * normal(t, 0);
    y[t] = std::exp(0.5 * x) * normal(t, 1);
  }
  return StochasticVolatility(std::move(y));
}

/// Biochemical oxygen demand: y_t = A (1 − exp(−B t)) + N(0, noise_std²), t = 1 … 5, A = 0.4 + 0.8 Φ(z_0), B
/// = 0.01 + 0.3 Φ(z_1), prior N(0, I).
struct OxygenDemandDensity : Pointwise {
  std::array<double, 5> data = {0.18, 0.32, 0.42, 0.49, 0.54};
  double noise_std = std::sqrt(1e-3);

  [[nodiscard]] Eigen::Index dimension() const override { return 2; }
  [[nodiscard]] static std::array<double, 5> model(double z0, double z1) {
    const double a = 0.4 + 0.4 * std::erfc(-z0 / std::numbers::sqrt2),
                 b = 0.01 + 0.15 * std::erfc(-z1 / std::numbers::sqrt2);
    std::array<double, 5> y{};
    for (std::size_t t = 0; t < 5; ++t) y[t] = -a * std::expm1(-b * static_cast<double>(t + 1));
    return y;
  }
  double at(const Eigen::VectorXd& z, int order, Eigen::VectorXd& g, Eigen::MatrixXd& h) const override {
    double value = standard_normal_prior(z, order, g, h);
    const double a = 0.4 + 0.4 * std::erfc(-z[0] / std::numbers::sqrt2),
                 b = 0.01 + 0.15 * std::erfc(-z[1] / std::numbers::sqrt2);
    const double a1 = 0.8 * std::exp(-0.5 * (z[0] * z[0] + k_log_two_pi)), a2 = -z[0] * a1,
                 b1 = 0.3 * std::exp(-0.5 * (z[1] * z[1] + k_log_two_pi)), b2 = -z[1] * b1;
    const double precision = 1 / (noise_std * noise_std);
    for (std::size_t i = 0; i < 5; ++i) {
      const double t = static_cast<double>(i + 1), decay = std::exp(-b * t), rise = 1 - decay;
      const double e = data[i] - a * rise;
      value -= 0.5 * precision * e * e + std::log(noise_std) + 0.5 * k_log_two_pi;
      if (order < 1) continue;
      const double f0 = a1 * rise, f1 = a * t * decay * b1;
      g[0] += precision * e * f0;
      g[1] += precision * e * f1;
      if (order < 2) continue;
      const double f00 = a2 * rise, f01 = a1 * t * decay * b1, f11 = a * t * decay * (b2 - t * b1 * b1);
      h(0, 0) += precision * (e * f00 - f0 * f0);
      h(1, 0) += precision * (e * f01 - f0 * f1);
      h(1, 1) += precision * (e * f11 - f1 * f1);
    }
    return value;
  }
};

}  // namespace knothe::posterior::targets
