#pragma once
/// @file Log-densities with known answers, for tests and benchmarks.
#include <Eigen/Dense>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>

#include "knothe/posterior/log_density.hpp"

namespace knothe::posterior::targets {

/// log N(z; mean, precision⁻¹) + log_evidence.
struct Gaussian : LogDensity {
  Eigen::VectorXd mean;
  Eigen::MatrixXd precision;
  double log_evidence = 0;
  int derivatives = 2;

  Gaussian(Eigen::VectorXd m, Eigen::MatrixXd p, double e = 0)
      : mean(std::move(m)), precision(std::move(p)), log_evidence(e) {}
  [[nodiscard]] Eigen::Index dimension() const override { return mean.size(); }
  [[nodiscard]] int available_derivatives() const override { return derivatives; }
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& z, int order, LogDensityBatch& out) override {
    const Eigen::Index d = dimension();
    const Eigen::MatrixXd centred = z.rowwise() - mean.transpose(), scaled = centred * precision;
    out.value = (-0.5 * centred.cwiseProduct(scaled).rowwise().sum()).array() + log_evidence +
                0.5 * std::log(precision.determinant()) -
                0.5 * static_cast<double>(d) * std::log(2 * std::numbers::pi);
    if (order >= 1) out.gradient = -scaled;
    if (order >= 2)
      for (Eigen::Index a = 0; a < d; ++a)
        for (Eigen::Index b = 0; b <= a; ++b)
          out.hessian.col(packed_index(a, b)).setConstant(-precision(a, b));
  }
};

/// A target in the plane given point by point: f(x, y, out) fills value, two first and three second
/// derivatives (xx, yx, yy).
struct Planar : LogDensity {
  using Function = std::function<void(double, double, double*)>;
  Function function;
  int derivatives = 2;
  explicit Planar(Function f, int available = 2) : function(std::move(f)), derivatives(available) {}
  [[nodiscard]] Eigen::Index dimension() const override { return 2; }
  [[nodiscard]] int available_derivatives() const override { return derivatives; }
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& z, int order, LogDensityBatch& out) override {
    double r[6];
    for (Eigen::Index i = 0; i < z.rows(); ++i) {
      function(z(i, 0), z(i, 1), r);
      out.value[i] = r[0];
      if (order >= 1) out.gradient(i, 0) = r[1], out.gradient(i, 1) = r[2];
      if (order >= 2)
        for (Eigen::Index k = 0; k < 3; ++k) out.hessian(i, k) = r[3 + k];
    }
  }
};

/// log N(x) + log N(y; b x² + c x³, s²): evidence 1.
inline Planar::Function banana(double b = 1, double c = 0, double s = 1) {
  return [=](double x, double y, double* r) {
    const double f = b * x * x + c * x * x * x, f1 = 2 * b * x + 3 * c * x * x, f2 = 2 * b + 6 * c * x;
    const double u = (y - f) / s;
    r[0] = -0.5 * (x * x + u * u) - std::log(2 * std::numbers::pi * s);
    r[1] = -x + u * f1 / s;
    r[2] = -u / s;
    r[3] = -1 - f1 * f1 / (s * s) + u * f2 / s;
    r[4] = f1 / (s * s);
    r[5] = -1 / (s * s);
  };
}

/// Two parameters uniform on the box (0.5, 1.5)², standardised: p = 0.5 + Φ(z), prior N(0, I) in z. A precise
/// measurement of a curved combination of both, p₁ᵅ p₂, and a vague one of p₁: a narrow bent ridge that may
/// lean against the box.
struct Ridge {
  double alpha = 1, product = 1, product_std = 0.02, first = 1, first_std = 0.2;

  void operator()(double x, double y, double* r) const {
    const double phi[2] = {0.3989422804014327 * std::exp(-0.5 * x * x),
                           0.3989422804014327 * std::exp(-0.5 * y * y)};
    const double p = 0.5 + 0.5 * std::erfc(-x / std::numbers::sqrt2),
                 q = 0.5 + 0.5 * std::erfc(-y / std::numbers::sqrt2);
    const double pa = std::pow(p, alpha), w = pa * q, wp = alpha * w / p,
                 wpp = alpha * (alpha - 1) * w / (p * p);
    const double wpq = alpha * pa / p;
    const double i1 = 1 / (product_std * product_std), i2 = 1 / (first_std * first_std);
    const double e1 = w - product, e2 = p - first;
    const double gp = -e1 * wp * i1 - e2 * i2, gq = -e1 * pa * i1;
    const double hpp = -(wp * wp + e1 * wpp) * i1 - i2, hpq = -(wp * pa + e1 * wpq) * i1, hqq = -pa * pa * i1;
    r[0] = -0.5 * (e1 * e1 * i1 + e2 * e2 * i2 + x * x + y * y) - std::log(2 * std::numbers::pi);
    r[1] = gp * phi[0] - x;
    r[2] = gq * phi[1] - y;
    r[3] = hpp * phi[0] * phi[0] - gp * x * phi[0] - 1;
    r[4] = hpq * phi[0] * phi[1];
    r[5] = hqq * phi[1] * phi[1] - gq * y * phi[1] - 1;
  }
};

/// ½ N(−a, 1) + ½ N(a, 1) in x, N(0, 1) in y.
inline Planar::Function mixture(double a, double weight = 0.5) {
  return [=](double x, double y, double* r) {
    const double l = std::log(weight) - 0.5 * (x + a) * (x + a),
                 u = std::log(1 - weight) - 0.5 * (x - a) * (x - a);
    const double top = std::max(l, u), sum = std::exp(l - top) + std::exp(u - top);
    const double share = std::exp(l - top) / sum;  // of the left one
    const double slope = -(x + a) * share - (x - a) * (1 - share);
    r[0] = top + std::log(sum) - 0.5 * y * y - std::log(2 * std::numbers::pi);
    r[1] = slope;
    r[2] = -y;
    r[3] = -1 + share * (x + a) * (x + a) + (1 - share) * (x - a) * (x - a) - slope * slope;
    r[4] = 0;
    r[5] = -1;
  };
}

/// What dense quadrature says about a density in the plane.
struct Reference {
  double log_evidence = 0;
  Eigen::Vector2d mean, standard_deviation;
  double correlation = 0;
  Eigen::MatrixXd quantiles;  ///< 2 × levels
};

/// Trapezoidal sums on a grid that is first found coarse, then laid over the mass; the error is far below any
/// tolerance tested.
inline Reference dense_quadrature(const Planar::Function& f, const std::vector<double>& levels,
                                  double half_width = 9) {
  double box[2][2] = {{-half_width, half_width}, {-half_width, half_width}};
  double r[6];
  const int n = 700;
  Eigen::MatrixXd log_density(n, n);
  double top = 0;
  for (int round = 0; round < 3; ++round) {
    for (int j = 0; j < n; ++j)
      for (int i = 0; i < n; ++i) {
        f(box[0][0] + (box[0][1] - box[0][0]) * i / (n - 1),
          box[1][0] + (box[1][1] - box[1][0]) * j / (n - 1), r);
        log_density(i, j) = r[0];
      }
    top = log_density.maxCoeff();
    if (round == 2) break;
    int low[2] = {n, n}, high[2] = {-1, -1};
    for (int j = 0; j < n; ++j)
      for (int i = 0; i < n; ++i)
        if (log_density(i, j) > top - 34) {
          low[0] = std::min(low[0], i), high[0] = std::max(high[0], i);
          low[1] = std::min(low[1], j), high[1] = std::max(high[1], j);
        }
    for (int a = 0; a < 2; ++a) {
      const double left = box[a][0], step = (box[a][1] - box[a][0]) / (n - 1);
      box[a][0] = left + step * std::max(0, low[a] - 2);
      box[a][1] = left + step * std::min(n - 1, high[a] + 2);
    }
  }
  const double dx = (box[0][1] - box[0][0]) / (n - 1), dy = (box[1][1] - box[1][0]) / (n - 1);
  const Eigen::MatrixXd w = (log_density.array() - top).exp();
  const double sum = w.sum();
  Reference result;
  result.log_evidence = top + std::log(sum * dx * dy);
  const Eigen::VectorXd x = Eigen::VectorXd::LinSpaced(n, box[0][0], box[0][1]),
                        y = Eigen::VectorXd::LinSpaced(n, box[1][0], box[1][1]);
  const Eigen::VectorXd px = w.rowwise().sum() / sum, py = w.colwise().sum().transpose() / sum;
  result.mean << px.dot(x), py.dot(y);
  const Eigen::VectorXd cx = x.array() - result.mean[0], cy = y.array() - result.mean[1];
  result.standard_deviation << std::sqrt(px.dot(cx.cwiseAbs2())), std::sqrt(py.dot(cy.cwiseAbs2()));
  result.correlation = (cx.transpose() * w * cy)(0) / sum / result.standard_deviation.prod();
  result.quantiles.resize(2, static_cast<Eigen::Index>(levels.size()));
  for (int a = 0; a < 2; ++a) {
    const auto& p = a == 0 ? px : py;
    const auto& at = a == 0 ? x : y;
    for (std::size_t l = 0; l < levels.size(); ++l) {
      double cumulative = 0.5 * p[0];
      Eigen::Index i = 1;
      for (; i < n - 1; ++i) {
        const double next = cumulative + 0.5 * (p[i - 1] + p[i]);
        if (next >= levels[l]) break;
        cumulative = next;
      }
      const double share = (levels[l] - cumulative) / (0.5 * (p[i - 1] + p[i]));
      result.quantiles(a, static_cast<Eigen::Index>(l)) = at[i - 1] + share * (at[i] - at[i - 1]);
    }
  }
  return result;
}

}  // namespace knothe::posterior::targets
