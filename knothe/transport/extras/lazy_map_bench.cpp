/// @file A lazy map in 50 dimensions with a 3-dimensional informed subspace, from gradients alone: mode,
/// Laplace, layers, verification, correction. Prints machine, threads, median, p99.
///
/// Usage: lazy_map_bench [repetitions]
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <string>
#include <vector>

#include "knothe/transport/extras/lazy_map.hpp"
#include "knothe/transport/testing/lazy_map_targets.hpp"

namespace {

std::string processor() {
  std::ifstream file("/proc/cpuinfo");
  for (std::string line; std::getline(file, line);)
    if (line.rfind("model name", 0) == 0) return line.substr(line.find(':') + 2);
  return "unknown processor";
}

}  // namespace

int main(int argc, char** argv) {
  using namespace knothe::transport;
  using Clock = std::chrono::steady_clock;
  const int repetitions = std::max(1, argc > 1 ? std::atoi(argv[1]) : 20);
  std::printf("%s, 1 thread, %d repetitions\n", processor().c_str(), repetitions);
  targets::NonlinearSubspace target(50);
  LazyMapResult result;
  ImportanceCorrection corrected;
  std::vector<double> ms;
  for (int i = 0; i < repetitions; ++i) {
    const auto start = Clock::now();
    result = solve_lazy_map(target);
    corrected = correct(result);
    ms.push_back(std::chrono::duration<double, std::milli>(Clock::now() - start).count());
  }
  std::sort(ms.begin(), ms.end());
  std::printf(
      "lazy map, d = 50: median %.1f ms p99 %.1f ms | %zu layers, rank %d, order %d | Laplace diagnostic "
      "%.2e, "
      "verified %.2e, ess %.3f, trusted %d | %ld evaluations\n",
      ms[ms.size() / 2], ms[ms.size() * 99 / 100], result.layers.size(),
      result.layers.empty() ? 0 : result.layers.back().rank,
      result.layers.empty() ? 0 : result.layers.back().order, result.laplace_diagnostic,
      result.verified_diagnostic, corrected.ess, corrected.trusted ? 1 : 0,
      static_cast<long>(result.density_evaluations));
  return corrected.trusted ? 0 : 1;
}
