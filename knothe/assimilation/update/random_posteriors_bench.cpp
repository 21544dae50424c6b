/// @file Updates of random separated models with hard posteriors (several modes, rings, funnels): time, what
/// is trusted, and how far off it is from dense quadrature. Prints machine, threads, median, p99.
///
/// Usage: random_posteriors_bench [models per number of parameters] [first seed] [first number] [-v]
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>

#include "knothe/assimilation/testing/random_posteriors.hpp"
#include "knothe/assimilation/update/sequential_update.hpp"
#include "knothe/likelihood/testing/bench_models.hpp"

namespace {

using namespace knothe;
using namespace knothe::posterior;
using namespace knothe::likelihood;
using namespace knothe::assimilation;
using Clock = std::chrono::steady_clock;

void run(Eigen::Index d, int models, unsigned seed, bool verbose) {
  std::vector<double> us;
  int steps = 0, trusted = 0, wrong = 0, maps = 0;
  double worst_mean = 0, worst_std = 0;
  for (int m = 0; m < models; ++m) {
    const test::RandomPosterior situation(d, seed + static_cast<unsigned>(m));
    SequentialUpdate update(situation.model, situation.noise(), situation.priors());
    for (Eigen::Index t = 0; t < situation.steps(); ++t) {
      const auto start = Clock::now();
      const auto step = static_cast<std::size_t>(t);
      const UpdateResult& result = update.update(step, step, situation.datum(t));
      us.push_back(std::chrono::duration<double, std::micro>(Clock::now() - start).count());
      const auto exact = situation.exact(t);
      const double mean = ((result.mean - exact.mean).array() / exact.std.array()).abs().maxCoeff();
      const double std = (result.standard_deviations().array() / exact.std.array() - 1).abs().maxCoeff();
      ++steps;
      maps += result.method == Method::transport;
      const bool off = mean > 0.1 || std > 0.05;
      if (result.trusted) {
        ++trusted;
        wrong += off;
        worst_mean = std::max(worst_mean, mean);
        worst_std = std::max(worst_std, std);
      }
      if (verbose)
        fmt::print(
            "    {} seed {} step {}: {:9.0f} µs method {} {} order {} ess {:.3f}: mean {:.3f}, std {:.1f} % "
            "log-evidence {:+.3f}{} {}\n    {}\n",
            d, seed + static_cast<unsigned>(m), t, us.back(), knothe::to_text(result.method),
            result.trusted ? "trusted" : "-------", result.map_order, result.effective_sample_size, mean,
            100 * std, result.log_evidence - exact.log_evidence, exact.resolved ? "" : " unresolved",
            off ? "OFF" : "", result.remark + " " + situation.name);
    }
  }
  std::sort(us.begin(), us.end());
  fmt::print(
      "  {} parameters  median {:8.0f} µs  p99 {:8.0f} µs  {} steps, {:.1f} % trusted, {} by maps; of the "
      "trusted {} off, at most {:.3f} std in mean and {:.1f} % in std\n",
      d, us[us.size() / 2], us[us.size() * 99 / 100], steps, 100.0 * trusted / steps, maps, wrong, worst_mean,
      100 * worst_std);
}

}  // namespace

int main(int argc, char** argv) {
  const int models = argc > 1 ? std::atoi(argv[1]) : 10;
  const auto seed = static_cast<unsigned>(argc > 2 ? std::atoi(argv[2]) : 1);
  fmt::print("{}, 1 thread; random separated models, 6 steps\n", bench::processor());
  for (Eigen::Index d = argc > 3 ? std::atoi(argv[3]) : 3; d <= 8; ++d) {
    run(d, models, seed, argc > 4);
    std::fflush(stdout);
  }
  return 0;
}
