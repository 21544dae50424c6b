#include "knothe/likelihood/discrepancy/time_extrapolation.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>

namespace knothe::likelihood {
namespace {

using Series = std::span<const double>;

/// Least squares with orthogonal polynomials of the points themselves (Forsythe 1957): no matrix, no loss of
/// digits.
double polynomial(int order, int window, Series times, Series series, double time) {
  const std::size_t n = std::min(series.size(), static_cast<std::size_t>(std::max(window, order + 1)));
  times = times.last(n);
  series = series.last(n);
  const double unit = n > 1 ? times.back() - times.front() : 1;
  Eigen::ArrayXd x(n), y(n);
  for (std::size_t i = 0; i < n; ++i) {
    x[i] = (times[i] - times.back()) / unit;
    y[i] = series[i];
  }
  const double ahead = (time - times.back()) / unit;
  Eigen::ArrayXd before = Eigen::ArrayXd::Zero(x.size()), here = Eigen::ArrayXd::Ones(x.size());
  double before_ahead = 0, here_ahead = 1, value = 0, norm_before = 1;
  for (int degree = 0; degree <= std::min<int>(order, static_cast<int>(n) - 1); ++degree) {
    const double norm = here.square().sum();
    value += (here * y).sum() / norm * here_ahead;
    const double alpha = (x * here.square()).sum() / norm, beta = degree == 0 ? 0 : norm / norm_before;
    const Eigen::ArrayXd next = (x - alpha) * here - beta * before;
    const double next_ahead = (ahead - alpha) * here_ahead - beta * before_ahead;
    before = here, here = next;
    before_ahead = here_ahead, here_ahead = next_ahead;
    norm_before = norm;
  }
  return value;
}

struct Smoothing {
  double level, slope, damping;
};

/// The forecast and, by `error`, the sum of squares of the one-step errors on the way there. Slopes are per
/// step of the series.
double smoothed(const Smoothing& s, Series series, double& error) {
  double level = series[0], slope = series.size() > 1 ? series[1] - series[0] : 0;
  error = 0;
  for (std::size_t i = 1; i < series.size(); ++i) {
    const double expected = level + s.damping * slope, miss = series[i] - expected;
    if (i > 1) error += miss * miss;  // the first slope was made from this value
    slope = s.damping * slope + s.level * s.slope * miss;
    level = expected + s.level * miss;
  }
  return level + s.damping * slope;
}

double damped_trend(Series series) {
  double best = std::numeric_limits<double>::infinity(), value = series.back();
  for (const double level : {0.1, 0.3, 0.6, 0.9}) {
    for (const double slope : {0.05, 0.2, 0.5}) {
      for (const double damping : {0.8, 0.95}) {
        double error = 0;
        const double forecast = smoothed({level, slope, damping}, series, error);
        if (error < best) best = error, value = forecast;
      }
    }
  }
  return value;
}

double matern(double distance) {
  const double x = std::sqrt(3.0) * std::abs(distance);
  return (1 + x) * std::exp(-x);
}

double gaussian_process(Series times, Series series, double time) {
  const std::size_t count = std::min<std::size_t>(series.size(), 24);
  times = times.last(count);
  series = series.last(count);
  const auto n = static_cast<Eigen::Index>(count);
  if (n < 3) return polynomial(1, 2, times, series, time);
  Eigen::VectorXd y = Eigen::Map<const Eigen::VectorXd>(series.data(), n);
  const double mean = y.mean();
  y.array() -= mean;
  const double unit = (times.back() - times.front()) / static_cast<double>(n - 1);
  double best = -std::numeric_limits<double>::infinity(), value = series.back();
  Eigen::MatrixXd kernel(n, n);
  Eigen::VectorXd ahead(n);
  for (const double length : {3.0, 8.0, 20.0}) {
    for (Eigen::Index i = 0; i < n; ++i) {
      for (Eigen::Index j = 0; j <= i; ++j)
        kernel(i, j) = kernel(j, i) = matern((times[i] - times[j]) / (length * unit));
      ahead[i] = matern((time - times[i]) / (length * unit));
    }
    for (const double noise : {1e-4, 1e-2, 0.1, 1.0, 10.0}) {
      Eigen::MatrixXd noisy = kernel;
      noisy.diagonal().array() += noise;
      const Eigen::LLT<Eigen::MatrixXd> factor(noisy);
      const Eigen::VectorXd solution = factor.solve(y);
      const double amplitude = y.dot(solution) / static_cast<double>(n);
      if (!(amplitude > 0)) return mean;  // a constant series
      const double likelihood = -0.5 * static_cast<double>(n) * std::log(amplitude) -
                                factor.matrixLLT().diagonal().array().log().sum();
      if (likelihood > best) best = likelihood, value = mean + ahead.dot(solution);
    }
  }
  return value;
}

}  // namespace

double extrapolate(Extrapolation kind, int order, int window, std::span<const double> times,
                   std::span<const double> series, double time) {
  assert(!series.empty() && times.size() == series.size() && time > times.back() && order >= 0);
  if (series.size() == 1) return series[0];
  switch (kind) {
    case Extrapolation::damped_trend:
      return damped_trend(series);
    case Extrapolation::gaussian_process:
      return gaussian_process(times, series, time);
    case Extrapolation::polynomial:
      break;
  }
  return polynomial(order, window, times, series, time);
}

}  // namespace knothe::likelihood
