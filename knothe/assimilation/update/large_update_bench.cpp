/// @file Time of one update with a whole field of measured dofs, correlated in space and, through the shared
/// reference picture, in time: the claim of docs/explanation/assimilation.md. Prints machine, threads,
/// median, p99.
///
/// Usage: large_update_bench [nodes a side] [steps]
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <random>

#include "knothe/assimilation/update/sequential_update.hpp"
#include "knothe/likelihood/testing/bench_models.hpp"

namespace {

using namespace knothe;
using namespace knothe::posterior;
using namespace knothe::likelihood;
using namespace knothe::assimilation;
using Clock = std::chrono::steady_clock;

void run(const char* what, int side, int steps, bool shared) {
  const Eigen::Index n = 2 * side * side, l = 20, r = 10;
  std::mt19937_64 random(1);
  const auto model = likelihood::bench::large_model(n, l, r, steps, random);
  NoiseModel noise = NoiseModel::correlated(likelihood::bench::correlation_matrix(side, 1));
  if (shared) noise = noise.with_shared_reference(1);
  const std::vector<Prior> priors(2, Prior::normal(1, 0.3));
  SequentialUpdate update(model, noise, priors);
  std::vector<double> us, projection;
  for (int t = 0; t < steps; ++t) {
    const Eigen::VectorXd values = model->predict(Eigen::Vector2d(1.1, 0.9), static_cast<std::size_t>(t)) +
                                   0.8 * likelihood::bench::normal_matrix(n, 1, random);
    const auto start = Clock::now();
    const UpdateResult& result =
        update.update(static_cast<std::size_t>(t), static_cast<std::size_t>(t), values);
    if (t == 0) continue;  // tables are made
    us.push_back(std::chrono::duration<double, std::micro>(Clock::now() - start).count());
    projection.push_back(result.elapsed_us.projection);
  }
  std::sort(us.begin(), us.end());
  std::sort(projection.begin(), projection.end());
  fmt::print("  {:<40} median {:7.0f} µs   p99 {:7.0f} µs   of which projection {:7.0f} µs\n", what,
             us[us.size() / 2], us[us.size() * 99 / 100], projection[projection.size() / 2]);
}

}  // namespace

int main(int argc, char** argv) {
  const int side = argc > 1 ? std::atoi(argv[1]) : 100, steps = argc > 2 ? std::atoi(argv[2]) : 60;
  fmt::print("{}, 1 thread; {} dofs, noise of image correlation, l = 20, r = 10, {} steps\n",
             bench::processor(), 2 * side * side, steps);
  run("pictures independent", side, steps, false);
  run("noise of the reference picture shared", side, steps, true);
  return 0;
}
