#include "knothe/assimilation/monitor/cusum.hpp"

#include <Eigen/LU>
#include <cassert>
#include <cmath>

#include "knothe/numerics/integrate/quadrature.hpp"
#include "knothe/numerics/statistics/normal_distribution.hpp"

namespace knothe::assimilation {
namespace {

/// L(0) for the threshold h.
double average_run_length(double reference, double h) {
  const int n = 40;
  const auto [y, w] = numerics::gauss_legendre(n, 0, h);
  // Unknowns L(0), L(y_1) … L(y_n).
  Eigen::MatrixXd system = Eigen::MatrixXd::Identity(n + 1, n + 1);
  for (Eigen::Index i = 0; i <= n; ++i) {
    const double s = i == 0 ? 0 : y[i - 1];
    system(i, 0) -= numerics::normal_cdf(reference - s);
    for (Eigen::Index j = 0; j < n; ++j)
      system(i, j + 1) -= w[j] * numerics::normal_pdf(y[j] - s + reference);
  }
  return Eigen::PartialPivLU<Eigen::MatrixXd>(system).solve(Eigen::VectorXd::Ones(n + 1))[0];
}

}  // namespace

double cusum_threshold(double reference, double run_length) {
  assert(reference > 0 && run_length >= 2);
  // log L is nearly linear in h: a secant with its root kept between two ends.
  const double wanted = std::log(run_length);
  double low = 0.01, high = 2;
  while (std::log(average_run_length(reference, high)) < wanted) high *= 1.5;
  double f_low = std::log(average_run_length(reference, low)) - wanted;
  double f_high = std::log(average_run_length(reference, high)) - wanted;
  if (f_low >= 0) return low;
  double middle = low;
  for (int i = 0; i < 60 && high - low > 1e-9; ++i) {
    middle = low - f_low * (high - low) / (f_high - f_low);
    if (i % 3 == 2 || !(middle > low && middle < high)) middle = 0.5 * (low + high);
    const double f = std::log(average_run_length(reference, middle)) - wanted;
    if (std::abs(f) < 1e-8) break;
    (f < 0 ? low : high) = middle;
    (f < 0 ? f_low : f_high) = f;
  }
  return middle;
}

}  // namespace knothe::assimilation
