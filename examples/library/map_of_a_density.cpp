// Solves a transport map of a density that is known as a function. Run: map_of_a_density
#include <cmath>
#include <cstdio>
#include <knothe/knothe.hpp>

int main() {
  // A bent ridge, not normalised: x ~ N(0, 1) and y ~ N(x²/2, 0.5²) given x.
  const auto residual = [](std::span<const double> p) { return (p[1] - 0.5 * p[0] * p[0]) / 0.5; };
  const knothe::Density ridge{
      .dimension = 2,
      .log_value = [=](auto p) { return -0.5 * (p[0] * p[0] + residual(p) * residual(p)); },
      .gradient = [=](auto p, auto g) { g[0] = -p[0] + 2 * residual(p) * p[0], g[1] = -2 * residual(p); }};

  const auto [map, posterior] = knothe::solve_map(ridge);
  std::printf("order %d, %s\n", posterior.map_order,
              posterior.trusted ? "trusted" : posterior.remark.c_str());
  for (std::size_t k = 0; k < 2; ++k) std::printf("%.4f +- %.4f\n", posterior.mean[k], posterior.std(k));
  std::printf("log evidence %.5f, exactly %.5f\n", posterior.log_evidence, std::log(2 * M_PI * 0.5));
  std::printf("a draw: %.3f\n", map.sample(1, 1)[0]);
}
