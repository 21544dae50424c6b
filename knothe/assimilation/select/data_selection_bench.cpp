/// @file Time of choosing 30 among 20,000 dofs: the claim of docs/explanation/assimilation.md. Prints
/// machine, threads, median, maximum.
///
/// Usage: data_selection_bench [nodes a side] [repeats]
#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <ctime>

#include "knothe/assimilation/select/data_selection.hpp"
#include "knothe/likelihood/testing/bench_models.hpp"

namespace {

using namespace knothe;
using namespace knothe::posterior;
using namespace knothe::likelihood;
using namespace knothe::assimilation;

/// Of this thread, ms: other jobs do not count.
double cpu_ms() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return 1e3 * static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_nsec);
}

void run(const char* what, int side, int repeats, bool correlated, Eigen::Index points) {
  const Eigen::Index n = 2 * side * side;
  std::mt19937_64 random(1);
  const auto model = likelihood::bench::large_model(n, 30, 30, 100, random);
  NoiseModel noise = NoiseModel::independent(Eigen::VectorXd::Ones(n));
  if (correlated)
    noise = NoiseModel::correlated(likelihood::bench::correlation_matrix(side, 1)).with_shared_reference(1);
  const std::vector<Prior> priors(2, Prior::normal(1, 0.3).truncated(0.5, 1.5, "p"));
  Eigen::Matrix<double, Eigen::Dynamic, 3> positions(n, 3);
  for (Eigen::Index i = 0; i < n; ++i)
    positions.row(i) << static_cast<double>(i / 2 % side), static_cast<double>(i / 2 / side), 0.0;
  std::vector<double> ms;
  for (int repeat = 0; repeat < repeats; ++repeat) {
    const double start = cpu_ms();
    const SensorDesign design(*model, noise, Eigen::Vector2d(0.3, 0.3), prior_points(priors, points),
                              positions);
    const Selection selection = design.choose(30, 2.5);
    ms.push_back(cpu_ms() - start);
    if (selection.dofs.size() != 30) std::exit(1);
  }
  std::sort(ms.begin(), ms.end());
  fmt::print("  {:<56} median {:6.0f} ms   max {:6.0f} ms\n", what, ms[ms.size() / 2], ms.back());
}

}  // namespace

int main(int argc, char** argv) {
  const int side = argc > 1 ? std::atoi(argv[1]) : 100, repeats = argc > 2 ? std::atoi(argv[2]) : 7;
  fmt::print("{}, 1 thread; 30 of {} dofs, l = r = 30, 100 steps\n", bench::processor(), 2 * side * side);
  run("D-optimal, independent noise", side, repeats, false, 1);
  run("D-optimal, noise of correlation and shared reference", side, repeats, true, 1);
  run("information gain at 8 points, independent noise", side, repeats, false, 8);
  run("information gain at 8 points, noise of correlation", side, repeats, true, 8);
  return 0;
}
