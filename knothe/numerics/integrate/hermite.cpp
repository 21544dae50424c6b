#include "knothe/numerics/integrate/hermite.hpp"

#include <array>
#include <cmath>

namespace knothe::numerics {

namespace {

/// √k and 1/√k for the degrees that occur in inner loops.
struct Roots {
  static constexpr std::size_t k_count = 130;
  std::array<double, k_count> root{}, inverse{};
  Roots() {
    for (std::size_t k = 1; k < k_count; ++k)
      root[k] = std::sqrt(static_cast<double>(k)), inverse[k] = 1 / root[k];
  }
};
const Roots k_roots;

}  // namespace

void normalised_hermite(double x, std::span<double> values) {
  if (values.empty()) return;
  values[0] = 1;
  if (values.size() > 1) values[1] = x;
  for (std::size_t k = 2; k < values.size(); ++k) {
    const double n = static_cast<double>(k);
    values[k] = k < Roots::k_count
                    ? (x * values[k - 1] - k_roots.root[k - 1] * values[k - 2]) * k_roots.inverse[k]
                    : (x * values[k - 1] - std::sqrt(n - 1) * values[k - 2]) / std::sqrt(n);
  }
}

void normalised_hermite_derivative(double x, int derivative, std::span<double> values) {
  normalised_hermite(x, values);
  for (std::size_t k = values.size(); k-- > 0;) {
    if (k < static_cast<std::size_t>(derivative)) {
      values[k] = 0;
      continue;
    }
    double factor = 1;  // √(k (k−1) … (k−m+1))
    for (int m = 0; m < derivative; ++m) factor *= static_cast<double>(k) - m;
    values[k] = std::sqrt(factor) * values[k - static_cast<std::size_t>(derivative)];
  }
}

Eigen::MatrixXd normalised_hermite_coefficients(int n) {
  Eigen::MatrixXd c = Eigen::MatrixXd::Zero(n + 1, n + 1);
  c(0, 0) = 1;
  for (int k = 1; k <= n; ++k) {
    c.row(k).tail(n) = c.row(k - 1).head(n) / std::sqrt(k);
    if (k > 1) c.row(k) -= std::sqrt((k - 1.0) / k) * c.row(k - 2);
  }
  return c;
}

}  // namespace knothe::numerics
