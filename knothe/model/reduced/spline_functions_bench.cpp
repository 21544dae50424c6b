// w(p) with and without derivatives, per point (target: 60 ns and 150 ns at r = 10, d = 2); and a quadratic
// form of 24 functions of three parameters, as polynomials of the cells and, where its terms are too large
// for these, as sums of squares.
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

void quadratic_form(benchmark::State& state) {
  constexpr Eigen::Index k_functions = 24;
  const double size = state.range(0) != 0 ? 1e4 : 1;
  const std::vector<std::vector<double>> nodes(3, k_nodes[0]);
  const JointFunctions functions(nodes, random_values(k_functions * 343), k_functions);
  const auto form = functions.make_quadratic_form();
  const Eigen::MatrixXd a = size * Eigen::MatrixXd::Identity(k_functions, k_functions);
  const Eigen::VectorXd none = Eigen::VectorXd::Zero(k_functions);
  const Eigen::MatrixXd points = 0.2 * Eigen::MatrixXd::Random(k_points, 3).array() + 1.0;  // a posterior's
  Eigen::VectorXd value(k_points);
  Eigen::MatrixXd gradient(k_points, 3), hessian(k_points, 6);
  for (auto _ : state) {
    form->set(a, none, none, 0);
    for (int iteration = 0; iteration < 10; ++iteration)  // of a map's training
      form->evaluate(points, 2, value, gradient, hessian);
    benchmark::DoNotOptimize(value.data());
  }
}

BENCHMARK(quadratic_form)->ArgNames({"squares"})->Arg(0)->Arg(1)->Unit(benchmark::kMicrosecond);
BENCHMARK(joint)->ArgsProduct({{10, 30}, {0, 1, 2}})->ArgNames({"r", "derivatives"});
BENCHMARK(canonical)->ArgsProduct({{10, 30}, {0, 1, 2}})->ArgNames({"r", "derivatives"});

}  // namespace

BENCHMARK_MAIN();
