// A posterior given as a C++ function: from the logarithm of a density to moments, marginals and evidence.
//
// Run:  build/release/examples/example_density_function
//
// Biochemical oxygen demand (Sullivan et al. 2010; Bigoni et al. 2016): y(t) = A (1 − exp(−B t)), measured at
// t = 1 … 5 with errors N(0, 1e-3), A = 0.8 + 0.4 erf(z_1/√2), B = 0.16 + 0.15 erf(z_2/√2), z ~ N(0, I). The
// posterior of z is a bent ridge. Shows
//   1. a density as a class (values and gradients),   2. mode, map, verification,   3. corrected answers,
//   4. what the map is good for afterwards: samples, marginal densities, quantiles,   5. exact samples by
//   Metropolis.
#include <array>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "knothe/transport/diagnose/map_evidence.hpp"
#include "knothe/transport/extras/map_distribution.hpp"
#include "knothe/transport/extras/metropolis_correction.hpp"
#include "knothe/transport/solve/map_solver.hpp"

namespace {

// 1. The density: log π̄(z) with its gradient, at n points at once, one column per coordinate. The solver
// makes second
//    derivatives do without: a target with gradients is minimised by BFGS.
class OxygenDemand final : public knothe::sampling::LogDensity {
 public:
  [[nodiscard]] Eigen::Index dimension() const override { return 2; }
  [[nodiscard]] int available_derivatives() const override { return 1; }
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& z, int derivatives,
                knothe::sampling::LogDensityBatch& out) override {
    constexpr std::array data = {0.18, 0.32, 0.42, 0.49, 0.54};
    constexpr double variance = 1e-3;
    const double slope = std::sqrt(2 / std::numbers::pi);  // d/dz erf(z/√2) = slope exp(−z²/2)
    for (Eigen::Index i = 0; i < z.rows(); ++i) {
      const double a = 0.8 + 0.4 * std::erf(z(i, 0) / std::numbers::sqrt2),
                   da = 0.4 * slope * std::exp(-0.5 * z(i, 0) * z(i, 0));
      const double b = 0.16 + 0.15 * std::erf(z(i, 1) / std::numbers::sqrt2),
                   db = 0.15 * slope * std::exp(-0.5 * z(i, 1) * z(i, 1));
      double value = -0.5 * z.row(i).squaredNorm() - std::log(2 * std::numbers::pi) -
                     2.5 * std::log(2 * std::numbers::pi * variance);
      double by_a = 0, by_b = 0;
      for (std::size_t k = 0; k < data.size(); ++k) {
        const double t = static_cast<double>(k + 1), decay = std::exp(-b * t),
                     residual = a * (1 - decay) - data[k];
        value -= 0.5 * residual * residual / variance;
        by_a -= residual / variance * (1 - decay);
        by_b -= residual / variance * a * t * decay;
      }
      out.value[i] = value;
      if (derivatives >= 1) {
        out.gradient(i, 0) = by_a * da - z(i, 0);
        out.gradient(i, 1) = by_b * db - z(i, 1);
      }
    }
  }
};

/// Mean, standard deviation and log-evidence by the trapezoidal rule, to check against.
struct Reference {
  double mean[2] = {0, 0}, std[2] = {0, 0}, log_evidence = 0;
};
Reference dense_quadrature(OxygenDemand& target) {
  constexpr int n = 700;
  const double step = 14.0 / n;
  double sum = 0, first[2] = {0, 0}, second[2] = {0, 0};
  Eigen::MatrixXd row(n + 1, 2);
  knothe::sampling::LogDensityBatch batch;
  batch.resize(n + 1, 2, 0);
  for (int i = 0; i <= n; ++i) {
    for (int j = 0; j <= n; ++j) row.row(j) << -7 + step * i, -7 + step * j;
    target.evaluate(row, 0, batch);
    for (int j = 0; j <= n; ++j) {
      const double p = std::exp(batch.value[j]);
      sum += p;
      for (int k = 0; k < 2; ++k) first[k] += p * row(j, k), second[k] += p * row(j, k) * row(j, k);
    }
  }
  Reference r;
  r.log_evidence = std::log(sum * step * step);
  for (int k = 0; k < 2; ++k) {
    r.mean[k] = first[k] / sum;
    r.std[k] = std::sqrt(second[k] / sum - r.mean[k] * r.mean[k]);
  }
  return r;
}

}  // namespace

int main() {
  using namespace knothe::transport;
  OxygenDemand target;

  // 2. Mode, Laplace pre-map, maps of order 1, 2, …, each warm-started, until one is good on points not used
  // for training.
  MapSolverOptions options;
  options.tolerance = 5e-3;
  options.orientation = Orientation::given;  // step 4 wants a map that is triangular in z itself
  MapSolver solver(options);
  const MapResult result = solver.solve(target);
  std::printf("order %d, variance diagnostic %.1e on independent points, %ld evaluations%s%s\n", result.order,
              result.verified_diagnostic, static_cast<long>(result.density_evaluations),
              result.reason.empty() ? "" : ": ", result.reason.c_str());

  // 3. Weights make the answer right where the map is only nearly so, and say how nearly.
  const ImportanceCorrection answer = solver.correct(target, result);
  const Reference exact = dense_quadrature(target);
  std::printf("%s, effective sample size %.3f\n", answer.trusted ? "trusted" : "not trusted", answer.ess);
  std::printf("                 knothe            dense quadrature\n");
  for (int k = 0; k < 2; ++k)
    std::printf("z_%d              %7.4f ± %.4f   %7.4f ± %.4f\n", k + 1, answer.mean[k],
                std::sqrt(answer.covariance(k, k)), exact.mean[k], exact.std[k]);
  std::printf("log evidence     %8.4f ± %.4f  %8.4f    (the map's own bound: %.4f)\n", answer.log_evidence,
              answer.log_evidence_error, exact.log_evidence, answer.map_log_evidence);

  // 4. The map is a distribution: draw from it, ask it for marginals.
  const MapDistribution distribution(result.composed());
  const std::array levels = {0.025, 0.5, 0.975};
  const Eigen::VectorXd quantiles = distribution.marginal_quantiles(1, levels);
  std::printf("z_2: median %.3f, 95 %% between %.3f and %.3f; density at the median %.3f\n", quantiles[1],
              quantiles[0], quantiles[2], distribution.marginal_density(1, std::array{quantiles[1]})[0]);

  // 5. Exact samples: propose by the map, accept by the weights.
  const auto chain = metropolis_correction(distribution.map(), target);
  std::printf("Metropolis correction: %.1f %% accepted, R-hat %.4f, mean of z_2 %.4f\n",
              100 * chain.acceptance, chain.r_hat.maxCoeff(), chain.points.col(1).mean());

  bool good = answer.trusted && std::abs(answer.log_evidence - exact.log_evidence) < 0.01 && chain.converged;
  for (int k = 0; k < 2; ++k)
    good = good && std::abs(answer.mean[k] - exact.mean[k]) < 0.02 * exact.std[k] &&
           std::abs(std::sqrt(answer.covariance(k, k)) / exact.std[k] - 1) < 0.02;
  std::printf("%s\n", good ? "agrees with dense quadrature" : "DOES NOT agree with dense quadrature");
  return good ? 0 : 1;
}
