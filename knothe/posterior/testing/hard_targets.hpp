#pragma once
/// @file Targets in the plane on which transport maps are compared in the literature, with exact derivatives.
#include <array>
#include <cmath>
#include <numbers>

#include "knothe/posterior/testing/test_targets.hpp"

namespace knothe::posterior::targets {

/// The posterior of the biochemical oxygen demand (Sullivan et al. 2010; Marzouk, Moselhy, Parno, Spantini
/// 2016, section 7): B(t) = A (1 − exp(−k t)), A = 0.4 + 0.8 Φ(θ₁), k = 0.01 + 0.3 Φ(θ₂), five data of
/// variance 1e-3, prior N(0, I); all constants included. A bent ridge with a long thin arm.
struct OxygenDemand {
  std::array<double, 5> data = {0.18, 0.32, 0.42, 0.49, 0.54};  ///< at t = 1 … 5
  double variance = 1e-3;

  void operator()(double x, double y, double* r) const {
    const double fx = density(x), fy = density(y);
    const double a = 0.4 + 0.8 * cumulative(x), ax = 0.8 * fx, axx = -x * ax;
    const double k = 0.01 + 0.3 * cumulative(y), ky = 0.3 * fy, kyy = -y * ky;
    r[0] = -0.5 * (x * x + y * y) - 3.5 * std::log(2 * std::numbers::pi) - 2.5 * std::log(variance);
    r[1] = -x, r[2] = -y, r[3] = -1, r[4] = 0, r[5] = -1;
    const double decay = std::exp(-k), p = 1 / variance;
    double e = 1;
    for (int i = 0; i < 5; ++i) {
      const double t = i + 1;
      e *= decay;
      const double u = a * (1 - e) - data[static_cast<std::size_t>(i)];
      const double ux = ax * (1 - e), uy = a * t * e * ky;
      r[0] -= 0.5 * p * u * u;
      r[1] -= p * u * ux;
      r[2] -= p * u * uy;
      r[3] -= p * (ux * ux + u * axx * (1 - e));
      r[4] -= p * (ux * uy + u * ax * t * e * ky);
      r[5] -= p * (uy * uy + u * a * t * e * (kyy - t * ky * ky));
    }
  }

 private:
  static double density(double x) { return 0.3989422804014327 * std::exp(-0.5 * x * x); }
  static double cumulative(double x) { return 0.5 * std::erfc(-x / std::numbers::sqrt2); }
};

/// Rosenbrock's function as a density, exp(−[(1 − x)² + c (y − x²)²]/s): x ~ N(1, s/2), y | x ~ N(x²,
/// s/(2c)); normalised. c = 100, s = 20 is the usual one of the sampling literature.
struct Rosenbrock {
  double c = 100, s = 20;
  void operator()(double x, double y, double* r) const {
    const double u = y - x * x, p = 2 / s, q = 2 * c / s;
    r[0] =
        -0.5 * (p * (1 - x) * (1 - x) + q * u * u) + 0.5 * std::log(p * q) - std::log(2 * std::numbers::pi);
    r[1] = p * (1 - x) + 2 * q * u * x;
    r[2] = -q * u;
    r[3] = -p - 4 * q * x * x + 2 * q * u;
    r[4] = 2 * q * x;
    r[5] = -q;
  }
};

/// Neal's funnel (2003) in the plane: x ~ N(0, s²), y | x ~ N(0, eˣ); normalised. s = 3 is his. As a map:
/// y = e^{x/2} times a standard normal, which no polynomial of moderate order follows over ±3 s.
struct Funnel {
  double s = 3;
  void operator()(double x, double y, double* r) const {
    const double e = std::exp(-x), p = 1 / (s * s);
    r[0] = -0.5 * (p * x * x + y * y * e + x) - std::log(2 * std::numbers::pi * s);
    r[1] = -p * x + 0.5 * y * y * e - 0.5;
    r[2] = -y * e;
    r[3] = -p - 0.5 * y * y * e;
    r[4] = y * e;
    r[5] = -e;
  }
};

}  // namespace knothe::posterior::targets
