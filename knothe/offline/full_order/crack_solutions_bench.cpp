/// The 80 crack solutions of the paper (0 to 79 mm, 1 mm elements along the crack line), and their
/// interpolation to the full-order model's degrees of freedom.
#include <benchmark/benchmark.h>

#include "knothe/offline/full_order/offline.hpp"

namespace {

using namespace knothe::offline;

void eighty_lengths(benchmark::State& state) {
  const BeamProblem problem;
  const auto places = dofs(make_mesh(problem));
  for (auto _ : state) {
    const CrackTable table = crack_table(problem, {}, places);
    benchmark::DoNotOptimize(table.values.data());
  }
}

BENCHMARK(eighty_lengths)
    ->Unit(benchmark::kMillisecond)
    ->Repetitions(5)
    ->Iterations(1)
    ->ReportAggregatesOnly();

}  // namespace

BENCHMARK_MAIN();
