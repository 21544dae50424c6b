#include "knothe/numerics/integrate/hermite.hpp"

#include <array>
#include <cmath>

#include "knothe/base/index.hpp"

namespace knothe::numerics {

namespace {

/// √k and 1/√k for the degrees that occur in inner loops.
struct Roots {
  static constexpr std::size_t k_count = 130;
  std::array<double, k_count> root{}, inverse{};
  Roots() {
    for (std::size_t k = 1; k < k_count; ++k) root[k] = std::sqrt(k), inverse[k] = 1 / root[k];
  }
};
const Roots k_roots;

}  // namespace

void normalised_hermite(double x, std::span<double> values) {
  if (values.empty()) return;
  values[0] = 1;
  if (values.size() > 1) values[1] = x;
  for (Index k = 2; k < std::ssize(values); ++k) {
    const double n = k;
    values[k] = k < std::ssize(k_roots.root)
                    ? (x * values[k - 1] - k_roots.root[k - 1] * values[k - 2]) * k_roots.inverse[k]
                    : (x * values[k - 1] - std::sqrt(n - 1) * values[k - 2]) / std::sqrt(n);
  }
}

}  // namespace knothe::numerics
