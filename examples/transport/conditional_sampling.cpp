// Conditional sampling: from joint samples of data and parameter to the posterior, without a likelihood.
//
// Run:  build/release/examples/example_conditional_sampling
//
// A simulator draws a parameter p ~ N(0, 1) and answers with data y = p + 0.2 p³ + 0.4 e, e ~ N(0, 1). We
// only have 5,000 such pairs, and a measured y. Shows
//   1. a map of the pairs (y, p), data first,   2. samples of p given the measured y,   3. the conditional
//   density, all beside the exact posterior; and   4. the same question to a map made from a density.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "knothe/numerics/statistics/random.hpp"
#include "knothe/transport/extras/map_distribution.hpp"
#include "knothe/transport/extras/sample_map.hpp"
#include "knothe/transport/solve/map_solver.hpp"

namespace {

double simulator(double p) {
  return p + 0.2 * p * p * p;
}

/// The joint density of (y, p), for step 4.
class Joint final : public knothe::sampling::LogDensity {
 public:
  [[nodiscard]] Eigen::Index dimension() const override { return 2; }
  [[nodiscard]] int available_derivatives() const override { return 1; }
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& z, int derivatives,
                knothe::sampling::LogDensityBatch& out) override {
    for (Eigen::Index i = 0; i < z.rows(); ++i) {
      const double p = z(i, 1), u = (z(i, 0) - simulator(p)) / 0.4;
      out.value[i] = -0.5 * (p * p + u * u) - std::log(2 * std::numbers::pi * 0.4);
      if (derivatives >= 1)
        out.gradient(i, 0) = -u / 0.4, out.gradient(i, 1) = -p + u * (1 + 0.6 * p * p) / 0.4;
    }
  }
};

}  // namespace

int main() {
  using namespace knothe::transport;

  // 1. What is to be given stands first. The order comes from cross-validation.
  Eigen::MatrixXd pairs = knothe::numerics::monte_carlo_normal_points(5000, 2, 1);
  for (Eigen::Index i = 0; i < pairs.rows(); ++i) {
    const double p = pairs(i, 1);
    pairs.row(i) << simulator(p) + 0.4 * pairs(i, 0), p;
  }
  const SampleMap map = map_from_samples(pairs);
  std::printf("map of %ld pairs: orders %d and %d\n", static_cast<long>(pairs.rows()), map.orders[0],
              map.orders[1]);

  Joint joint;
  MapSolverOptions options;
  options.orientation = Orientation::given;  // triangular in (y, p) itself: conditionals are exact
  options.tolerance = 1e-4;
  MapSolver solver(options);
  const MapDistribution from_density(solver.solve(joint).composed());

  double worst = 0, worst_of_density = 0;
  for (const double measured : {-1.5, 0.3, 2.0}) {
    // The exact posterior, by quadrature.
    double sum = 0, first = 0, second = 0;
    for (double p = -6; p <= 6; p += 1e-3) {
      const double u = (measured - simulator(p)) / 0.4, w = std::exp(-0.5 * (p * p + u * u));
      sum += w, first += w * p, second += w * p * p;
    }
    const double mean = first / sum, std = std::sqrt(second / sum - mean * mean);

    // 2. Samples of p given y: the first component of S at y, fresh normal draws for the second, back through
    // S⁻¹.
    const Eigen::VectorXd given = Eigen::VectorXd::Constant(1, measured);
    const Eigen::VectorXd p = map.conditional_sample(given, 20000, 2).col(1);
    const double sampled_mean = p.mean(), sampled_std = std::sqrt((p.array() - sampled_mean).square().mean());

    // 3. The density of p given y.
    const double density =
        std::exp(map.conditional_log_density(given, Eigen::MatrixXd::Constant(1, 1, mean))[0]);
    const double u = (measured - simulator(mean)) / 0.4;
    const double exact_density = std::exp(-0.5 * (mean * mean + u * u)) / (sum * 1e-3);

    // 4. With a map made from the joint density the conditional is as good as that map.
    const Eigen::VectorXd q = from_density.conditional_sample(given, 20000, 3).col(1);
    std::printf(
        "y = %4.1f: p = %6.3f ± %.3f from pairs, %6.3f ± %.3f exactly, %6.3f ± %.3f from the joint density; "
        "density at the mean %.3f, exactly %.3f\n",
        measured, sampled_mean, sampled_std, mean, std, q.mean(),
        std::sqrt((q.array() - q.mean()).square().mean()), density, exact_density);
    worst = std::max({worst, std::abs(sampled_mean - mean) / std, std::abs(sampled_std / std - 1)});
    worst_of_density = std::max(worst_of_density, std::abs(q.mean() - mean) / std);
  }
  const bool good = worst < 0.2 && worst_of_density < 0.15;
  std::printf("largest error %.3f standard deviations from pairs, %.3f from the density: %s\n", worst,
              worst_of_density, good ? "good" : "NOT good");
  return good ? 0 : 1;
}
