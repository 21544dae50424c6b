/// @file One verified update of two parameters: mode, map, importance correction. Prints machine, threads,
/// median, p99 of the processor time, which a busy machine does not lengthen by its other work.
///
/// Usage: map_solver_bench [repetitions]
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <string>
#include <vector>

#include "knothe/posterior/map/solve/map_solver.hpp"
#include "knothe/posterior/testing/hard_targets.hpp"

namespace {

using namespace knothe;
using namespace knothe::posterior;

double processor_us() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return 1e6 * static_cast<double>(now.tv_sec) + 1e-3 * static_cast<double>(now.tv_nsec);
}

/// A target without indirection, so that its own cost is small and known.
template <class Function>
struct Direct final : posterior::LogDensity {
  Function function;
  explicit Direct(Function f) : function(f) {}
  [[nodiscard]] Eigen::Index dimension() const override { return 2; }
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& z, int order,
                posterior::LogDensityBatch& out) override {
    double r[6];
    for (Eigen::Index i = 0; i < z.rows(); ++i) {
      function(z(i, 0), z(i, 1), r);
      out.value[i] = r[0];
      if (order >= 1) out.gradient(i, 0) = r[1], out.gradient(i, 1) = r[2];
      if (order >= 2)
        for (Eigen::Index k = 0; k < 3; ++k) out.hessian(i, k) = r[3 + k];
    }
  }
};

std::string processor() {
  std::ifstream file("/proc/cpuinfo");
  for (std::string line; std::getline(file, line);)
    if (line.rfind("model name", 0) == 0) return line.substr(line.find(':') + 2);
  return "unknown processor";
}

template <class Body>
std::pair<double, double> median_and_p99(int repetitions, Body body) {
  std::vector<double> us;
  for (int i = 0; i < repetitions; ++i) {
    const double start = processor_us();
    body();
    us.push_back(processor_us() - start);
  }
  std::sort(us.begin(), us.end());
  return {us[us.size() / 2], us[us.size() * 99 / 100]};
}

template <class Function>
void measure(const char* name, Function function, int repetitions) {
  Direct<Function> target(function);
  MapSolver solver;
  MapResult result;
  ImportanceCorrection correction;
  solver.solve(target, result);
  solver.correct(target, result, correction);
  const auto [solve, solve_p99] = median_and_p99(repetitions, [&] { solver.solve(target, result); });
  const auto [correct, correct_p99] =
      median_and_p99(repetitions, [&] { solver.correct(target, result, correction); });
  posterior::LogDensityBatch batch;
  batch.resize(1024, 2, 2);
  const auto value =
      median_and_p99(200, [&] { target.evaluate(result.verification.points, 0, batch); }).first;
  std::printf(
      "%-24s order %d  diagnostic %.1e  ess %.3f  points %5ld | solve median %7.1f us p99 %7.1f us | "
      "correction median %6.1f us p99 %6.1f us | %ld evaluations at %.0f ns\n",
      name, result.order, result.verified_diagnostic, correction.ess,
      static_cast<long>(correction.points.rows()), solve, solve_p99, correct, correct_p99,
      static_cast<long>(result.density_evaluations), value / 1.024);
}

/// A new solver each time: mode search, tables of every order needed, map, verification.
template <class Function>
void measure_cold(const char* name, Function function, double tolerance, int repetitions) {
  Direct<Function> target(function);
  MapSolverOptions options;
  options.tolerance = tolerance;
  MapResult result;
  const auto [median, p99] = median_and_p99(repetitions, [&] {
    MapSolver solver(options);
    result = solver.solve(target);
  });
  std::printf("%-24s order %d  diagnostic %.1e (tolerance %.1e) | cold start median %7.1f us p99 %7.1f us\n",
              name, result.order, result.verified_diagnostic, tolerance, median, p99);
}

}  // namespace

int main(int argc, char** argv) {
  const int repetitions = argc > 1 ? std::atoi(argv[1]) : 1000;
  std::printf("%s, 1 thread, %d repetitions, processor time\n", processor().c_str(), repetitions);
  const auto banana = [](double x, double y, double* r) {
    const double u = y - x * x;
    r[0] = -0.5 * (x * x + u * u), r[1] = -x + 2 * u * x, r[2] = -u, r[3] = -1 - 4 * x * x + 2 * u,
    r[4] = 2 * x, r[5] = -1;
  };
  measure("banana", banana, repetitions);
  measure("ridge, box beside it", posterior::targets::Ridge{1, 1.0, 0.02, 1.8, 0.2}, repetitions);
  measure("ridge, wide", posterior::targets::Ridge{1, 1.0, 0.05, 1.0, 0.1}, repetitions);
  measure("ridge against the box", posterior::targets::Ridge{1, 1.05, 0.01, 1.35, 0.15}, repetitions);
  measure("ridge, more bent", posterior::targets::Ridge{3, 1, 0.02, 1.0, 0.4}, repetitions / 4 + 1);
  measure("oxygen demand", posterior::targets::OxygenDemand{}, repetitions / 4 + 1);
  measure_cold("oxygen demand", posterior::targets::OxygenDemand{}, 5e-3, repetitions / 10 + 1);
  measure_cold("oxygen demand", posterior::targets::OxygenDemand{}, 3.2e-2, repetitions / 10 + 1);
}
