// Forecasts of a crack length after a picture: from the posterior's points, and by Eq. 33.
#include <benchmark/benchmark.h>

#include <cmath>

#include "knothe/assimilation/forecast/crack_bridge.hpp"

namespace {

using namespace knothe::assimilation;

struct Case {
  CrackBridge bridge;
  FunctionMoments moments;
  knothe::model::RowMatrix functions;
  Eigen::VectorXd weights;
};

Case make_case(Eigen::Index dofs, Eigen::Index r) {
  std::vector<double> lengths;
  for (int i = 0; i < 80; ++i) lengths.push_back(1e-3 * i);
  Eigen::MatrixXd solutions(80, dofs);
  for (Eigen::Index i = 0; i < 80; ++i)
    for (Eigen::Index j = 0; j < dofs; ++j) {
      const double l = static_cast<double>(i) / 79,
                   s = (static_cast<double>(j) + 0.5) / static_cast<double>(dofs);
      solutions(i, j) = 0.5 * s + 0.3 * l * l * std::cos(3 * s) + 0.2 * std::tanh(4 * (l - s));
    }
  Eigen::MatrixXd modes(dofs, r);
  for (Eigen::Index k = 0; k < r; ++k)
    for (Eigen::Index j = 0; j < dofs; ++j)
      modes(j, k) = 1e-6 * std::sin(static_cast<double>((k + 2) * (j + 1)));
  knothe::model::RowMatrix functions(1024, r);
  for (Eigen::Index i = 0; i < functions.rows(); ++i)
    for (Eigen::Index k = 0; k < r; ++k)
      functions(i, k) = std::cos(0.37 * static_cast<double>((i + 1) * (k + 1)));
  const Eigen::VectorXd weights = Eigen::VectorXd::Constant(1024, 1.0 / 1024);
  return {
      CrackBridge(CrackMetaModel(lengths, solutions), {1e-4 * solutions.row(35).transpose(), modes}, 1e-4),
      moments_of_functions(functions, weights), functions, weights};
}

void crack_published(benchmark::State& state) {
  const Case c = make_case(state.range(0), state.range(1));
  for (auto _ : state) benchmark::DoNotOptimize(c.bridge.published(c.moments, 1e-6));
  state.counters["svd_modes"] = static_cast<double>(c.bridge.meta_model().modes());
}
BENCHMARK(crack_published)->Args({60, 10})->Args({60, 30})->Args({2000, 30})->Unit(benchmark::kMicrosecond);

void crack_published_from_samples(benchmark::State& state) {
  const Case c = make_case(state.range(0), state.range(1));
  for (auto _ : state)
    benchmark::DoNotOptimize(c.bridge.published(moments_of_functions(c.functions, c.weights), 1e-6));
}
BENCHMARK(crack_published_from_samples)->Args({60, 30})->Args({2000, 30})->Unit(benchmark::kMicrosecond);

void crack_update(benchmark::State& state) {
  const Case c = make_case(state.range(0), state.range(1));
  for (auto _ : state) benchmark::DoNotOptimize(c.bridge.update(c.functions, c.weights));
}
BENCHMARK(crack_update)->Args({60, 30})->Args({2000, 30})->Unit(benchmark::kMicrosecond);

void sample_forecast(benchmark::State& state) {
  const Case c = make_case(60, 10);
  const Eigen::VectorXd values = c.functions.rowwise().sum();
  for (auto _ : state) benchmark::DoNotOptimize(forecast_of_samples(values, c.weights, 0.5));
}
BENCHMARK(sample_forecast)->Unit(benchmark::kMicrosecond);

}  // namespace

BENCHMARK_MAIN();
