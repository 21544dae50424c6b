/// The local stage alone: ns for one Gauss point, step and parameter point (target: 40).
#include "knothe/offline/latin/latin_local_stage.hpp"

#include <benchmark/benchmark.h>

#include <random>
#include <vector>

namespace {

using namespace knothe::offline;

void local_stage(benchmark::State& state, bool tangent) {
  constexpr std::size_t k_points = 400, k_parameters = 56;  // 7 × 7, padded
  std::mt19937_64 random(1);
  std::normal_distribution<double> normal;
  std::vector<double> strain(6 * k_points * k_parameters), threshold(k_parameters, 216.0),
      brittleness(k_parameters, 2.25e-3), history(k_points * k_parameters, 0.1), damage(history.size()),
      slope(history.size()), derivative(strain.size());
  for (double& value : strain) value = 2e-4 * normal(random);
  for (auto _ : state) {
    for (std::size_t g = 0; g < k_points; ++g)
      evaluate_local_stage({k_parameters, threshold.data(), brittleness.data(), &strain[6 * k_parameters * g],
                            &history[k_parameters * g], &damage[k_parameters * g],
                            tangent ? &slope[k_parameters * g] : nullptr,
                            tangent ? &derivative[6 * k_parameters * g] : nullptr},
                           ElasticConstants{});
    benchmark::DoNotOptimize(damage.data());
    benchmark::ClobberMemory();
  }
  state.counters["ns_per_point"] =
      benchmark::Counter(static_cast<double>(k_points * k_parameters) * 1e-9,
                         benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}

void damage_alone(benchmark::State& state) {
  local_stage(state, false);
}
void damage_and_tangent(benchmark::State& state) {
  local_stage(state, true);
}
BENCHMARK(damage_alone);
BENCHMARK(damage_and_tangent);

}  // namespace

BENCHMARK_MAIN();
