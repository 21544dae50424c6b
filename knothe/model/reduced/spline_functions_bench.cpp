// w(p) with and without derivatives, per point (target: 60 ns and 150 ns at r = 10, d = 2).
#include <benchmark/benchmark.h>

#include <random>

#include "knothe/model/reduced/spline_functions.hpp"

namespace {

using namespace knothe::model;

constexpr Eigen::Index k_points = 256;

std::vector<double> random_values(std::size_t n) {
  std::mt19937_64 random(1);
  std::normal_distribution<double> normal;
  std::vector<double> values(n);
  for (double& value : values) value = normal(random);
  return values;
}

void run(benchmark::State& state, const ParameterFunctions& functions) {
  const int derivatives = static_cast<int>(state.range(1));
  const Eigen::MatrixXd points =
      (0.5 * Eigen::MatrixXd::Random(k_points, functions.dimension()).array() + 1.0);
  FunctionBatch batch;
  batch.resize(k_points, functions.dimension(), functions.count(), derivatives);
  for (auto _ : state) {
    functions.evaluate(points, derivatives, batch);
    benchmark::DoNotOptimize(batch.value.data());
  }
  state.counters["per_point"] =
      benchmark::Counter(static_cast<double>(k_points),
                         benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}

const std::vector<std::vector<double>> k_nodes(2, {0.5, 0.6666, 0.8333, 1.0, 1.1666, 1.3333, 1.5});

void joint(benchmark::State& state) {
  const auto r = static_cast<std::size_t>(state.range(0));
  run(state, JointFunctions(k_nodes, random_values(r * 49), state.range(0)));
}

void canonical(benchmark::State& state) {
  const auto r = static_cast<std::size_t>(state.range(0));
  const std::vector<std::vector<double>> values(2, random_values(r * 7));
  run(state, CanonicalFunctions(k_nodes, values, state.range(0)));
}

BENCHMARK(joint)->ArgsProduct({{10, 30}, {0, 1, 2}})->ArgNames({"r", "derivatives"});
BENCHMARK(canonical)->ArgsProduct({{10, 30}, {0, 1, 2}})->ArgNames({"r", "derivatives"});

}  // namespace

BENCHMARK_MAIN();
