#include "knothe/numerics/statistics/random.hpp"

#include "knothe/base/index.hpp"
#include "knothe/numerics/statistics/normal_distribution.hpp"

namespace knothe::numerics {

Eigen::MatrixXd monte_carlo_points(Index n, Index d, std::uint64_t seed, std::uint64_t first) {
  Eigen::MatrixXd points(n, d);
  const std::array<std::uint32_t, 2> key = {static_cast<std::uint32_t>(seed),
                                            static_cast<std::uint32_t>(seed >> 32)};
  for (Index k = 0; k < d; k += 2)  // one call of the generator serves two coordinates
    for (Index i = 0; i < n; ++i) {
      const std::uint64_t index = first + i;
      const auto bits = philox({static_cast<std::uint32_t>(index), static_cast<std::uint32_t>(index >> 32),
                                static_cast<std::uint32_t>(k / 2), 0},
                               key);
      points(i, k) = unit_interval(std::uint64_t{bits[0]} << 32 | bits[1]);
      if (k + 1 < d) points(i, k + 1) = unit_interval(std::uint64_t{bits[2]} << 32 | bits[3]);
    }
  return points;
}

Eigen::MatrixXd monte_carlo_normal_points(Index n, Index d, std::uint64_t seed, std::uint64_t first) {
  return monte_carlo_points(n, d, seed, first).unaryExpr([](double u) { return normal_quantile(u); });
}

}  // namespace knothe::numerics
