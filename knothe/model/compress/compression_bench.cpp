// Compression of snapshots on 7 × 7 parameters, 100 steps, 7,500 dofs (290 MB): a synthetic travelling front.
#include <benchmark/benchmark.h>

#include <cmath>

#include "knothe/model/compress/compression.hpp"
#include "knothe/model/testing/test_models.hpp"

namespace {

using namespace knothe::model;

constexpr std::size_t k_dofs = 7500, k_steps = 100;

const Snapshots& front() {
  static const Snapshots snapshots = [] {
    const std::vector<double> nodes{0.5, 0.6666, 0.8333, 1.0, 1.1666, 1.3333, 1.5};
    std::vector<double> time;
    for (std::size_t i = 1; i <= k_steps; ++i) time.push_back(0.01 * static_cast<double>(i));
    const std::vector<double> rough = normal_values(3 * k_dofs, 1);
    const auto field = [&](std::size_t dof, double t, std::span<const double> p) {
      const double x = static_cast<double>(dof) / k_dofs;
      const double crack = 1.0 / (1.0 + std::exp(-30.0 * (t * (0.7 + 0.3 * p[1]) - 0.2 * p[0] - 0.6 * x)));
      return 1e-4 * (t * x + 0.3 * crack * (1.0 + 0.3 * rough[dof]) + 0.02 * p[0] * t * rough[k_dofs + dof]);
    };
    return snapshots_of(field, {{"Y0", nodes, "1", "", 1.0}, {"Ad", nodes, "1", "", 1.0}}, time, k_dofs);
  }();
  return snapshots;
}

void tree(benchmark::State& state) {
  CompressionOptions options;
  options.modes = static_cast<std::size_t>(state.range(0));
  for (auto _ : state) {
    const ModelContents model = compress(front(), options);
    state.counters["space_modes"] = static_cast<double>(model.space_modes);
    state.counters["relative_error"] = model.relative_error;
    state.counters["max_error_um"] = 1e6 * model.max_error_m;
  }
}

void canonical(benchmark::State& state) {
  CompressionOptions options;
  options.form = Form::canonical;
  options.modes = static_cast<std::size_t>(state.range(0));
  for (auto _ : state) {
    const ModelContents model = compress(front(), options);
    state.counters["relative_error"] = model.relative_error;
    state.counters["max_error_um"] = 1e6 * model.max_error_m;
  }
}

BENCHMARK(tree)->Arg(10)->Arg(30)->Unit(benchmark::kSecond)->Iterations(1)->UseRealTime();
BENCHMARK(canonical)->Arg(10)->Arg(20)->Unit(benchmark::kSecond)->Iterations(1)->UseRealTime();

}  // namespace

BENCHMARK_MAIN();
