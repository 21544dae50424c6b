#include "knothe/likelihood/discrepancy/time_extrapolation.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cassert>

namespace knothe::likelihood {

double extrapolate(int order, int window, std::span<const double> times, std::span<const double> series,
                   double time) {
  assert(!series.empty() && times.size() == series.size() && time > times.back() && order >= 0);
  // Least squares with orthogonal polynomials of the points themselves (Forsythe 1957): no matrix, no loss of
  // digits.
  const std::size_t n = std::min<std::size_t>(series.size(), std::max(window, order + 1));
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
  for (int degree = 0; degree <= std::min<int>(order, n - 1); ++degree) {
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

}  // namespace knothe::likelihood
