// `knothe model import` of many parameter points: 5⁵ = 3,125, 3⁸ = 6,561 and 7⁵ = 16,807, of a front that
// widens as it travels. Wall and CPU seconds from file to file, and the largest memory the process had
// (making the snapshots included).
#include <benchmark/benchmark.h>
#include <sys/resource.h>

#include <cmath>
#include <filesystem>

#include "knothe/model/reduced/spline_functions.hpp"
#include "knothe/model/reduced/truncation_error.hpp"
#include "knothe/model/testing/test_models.hpp"

namespace {

using namespace knothe::model;

struct Size {
  std::size_t parameters, nodes, steps, dofs;
};

Field widening_front(std::size_t dofs) {
  return [dofs](std::size_t dof, double t, std::span<const double> p) {
    double where = 0, width = 0;
    for (std::size_t i = 0; i < p.size(); ++i) {
      where += (i % 2 == 0 ? 1 : -0.6) * p[i] / static_cast<double>(i + 1);
      width += p[i] / static_cast<double>(p.size());
    }
    const double x = static_cast<double>(dof) / static_cast<double>(dofs);
    return 1e-4 * (t * x + 0.3 * std::tanh((6 + 4 * width) * (x - t * (0.5 + 0.3 * where))));
  };
}

void write_front(const Size& size, const std::string& path) {
  std::vector<Axis> axes;
  for (std::size_t i = 0; i < size.parameters; ++i) {
    Axis& axis = axes.emplace_back();
    axis.name = "p" + std::to_string(i);
    for (std::size_t k = 0; k < size.nodes; ++k)
      axis.nodes.push_back(static_cast<double>(k) / static_cast<double>(size.nodes - 1));
  }
  std::vector<double> time;
  for (std::size_t i = 1; i <= size.steps; ++i)
    time.push_back(static_cast<double>(i) / static_cast<double>(size.steps));
  write_snapshots(snapshots_of(widening_front(size.dofs), axes, time, size.dofs), path);
}

void import(benchmark::State& state) {
  const auto argument = [&](int i) { return static_cast<std::size_t>(state.range(i)); };
  const std::string from = std::filesystem::temp_directory_path() / "knothe_import_bench.h5";
  const std::string to = from + ".model";
  write_front({argument(0), argument(1), argument(2), argument(3)}, from);
  CompressionOptions options;
  options.modes = argument(4);
  for (auto _ : state) {
    const auto imported = import_model_and_error(from, options);
    write_model(imported.model, imported.truncation, to);
    state.counters["modes"] = static_cast<double>(imported.model.parameter_modes);
    state.counters["space_modes"] = static_cast<double>(imported.model.space_modes);
    state.counters["relative_error"] = imported.model.relative_error;
  }
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  state.counters["memory_MB"] = static_cast<double>(usage.ru_maxrss) / 1024;
  std::filesystem::remove(from);
  std::filesystem::remove(to);
}

/// What the model costs then: a point with its derivatives, of so many parameters.
void evaluate(benchmark::State& state) {
  const auto d = static_cast<std::size_t>(state.range(0)), n = static_cast<std::size_t>(state.range(1));
  const auto r = static_cast<Eigen::Index>(state.range(2));
  std::vector<std::vector<double>> nodes(d);
  std::size_t grid = 1;
  for (auto& axis : nodes) {
    for (std::size_t k = 0; k < n; ++k) axis.push_back(static_cast<double>(k));
    grid *= n;
  }
  const JointFunctions functions(nodes, normal_values(grid * static_cast<std::size_t>(r), 1), r);
  const int derivatives = static_cast<int>(state.range(3));
  FunctionBatch out;
  out.resize(1, static_cast<Eigen::Index>(d), r, derivatives);
  const Eigen::MatrixXd point = Eigen::MatrixXd::Constant(1, static_cast<Eigen::Index>(d), 1.3);
  for (auto _ : state) {
    functions.evaluate(point, derivatives, out);
    benchmark::DoNotOptimize(out.value.data());
  }
}

BENCHMARK(import)
    ->ArgNames({"d", "n", "steps", "dofs", "modes"})
    ->Args({5, 5, 20, 60, 0})
    ->Args({8, 3, 20, 60, 0})
    ->Args({5, 7, 20, 60, 0})
    ->Args({5, 5, 100, 2000, 0})
    ->Unit(benchmark::kSecond)
    ->Iterations(1)
    ->MeasureProcessCPUTime()
    ->UseRealTime();
BENCHMARK(evaluate)
    ->ArgNames({"d", "n", "r", "derivatives"})
    ->ArgsProduct({{5}, {5, 7}, {30}, {0, 2}})
    ->ArgsProduct({{8}, {3}, {30}, {0, 2}})
    ->Unit(benchmark::kMicrosecond);

}  // namespace

BENCHMARK_MAIN();
