/// Full-order run of the paper's case: 5 mm elements, one layer, 100 steps, reference parameters (issue: ≤ 15
/// s CPU). `cold` makes the mesh, the elastic factor and the flexibility too; `warm` is a further run of the
/// same model, as on a grid of parameters; `brittle` is the hardest corner of the parameter box;
/// `uncondensed` is the comparison.
#include <benchmark/benchmark.h>

#include "knothe/offline/full_order/offline.hpp"

namespace {

using namespace knothe::offline;

void report(benchmark::State& state, const FullOrderModel& model, const FullOrderResult& result) {
  state.counters["dofs"] = model.structure().dof_count();
  state.counters["newton"] = result.newton_iterations();
  state.counters["secant"] = result.secant_iterations();
  state.counters["not_in_equilibrium"] = static_cast<double>(result.steps_without_equilibrium().size());
}

void cold(benchmark::State& state) {
  for (auto _ : state) {
    FullOrderModel model = make_full_order_model({});
    const FullOrderResult result = model.run({});
    report(state, model, result);
  }
}

void warm(benchmark::State& state, DamageParameters parameters) {
  FullOrderModel model = make_full_order_model({});
  FullOrderResult result = model.run(parameters);
  for (auto _ : state) result = model.run(parameters);
  report(state, model, result);
}

void uncondensed(benchmark::State& state) {
  BeamProblem problem;
  problem.solver.condensation = Condensation::none;
  FullOrderModel model = make_full_order_model(problem);
  FullOrderResult result;
  for (auto _ : state) result = model.run({});
  report(state, model, result);
}

BENCHMARK(cold)->Unit(benchmark::kMillisecond)->Repetitions(5)->Iterations(1)->ReportAggregatesOnly();
BENCHMARK_CAPTURE(warm, reference, DamageParameters{})
    ->Unit(benchmark::kMillisecond)
    ->Repetitions(5)
    ->Iterations(1)
    ->ReportAggregatesOnly();
BENCHMARK_CAPTURE(warm, brittle, DamageParameters{1.5 * 216, 1.5 * 2.25e-3})
    ->Unit(benchmark::kMillisecond)
    ->Repetitions(5)
    ->Iterations(1)
    ->ReportAggregatesOnly();
BENCHMARK(uncondensed)->Unit(benchmark::kMillisecond)->Iterations(1);

}  // namespace

BENCHMARK_MAIN();
