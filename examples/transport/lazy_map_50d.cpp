// Fifty parameters, three of whose combinations the data inform: a lazy map.
//
// Run:  build/release/examples/example_lazy_map_50d
//
// A field of 50 standardised coefficients, z ~ N(0, I), three measurements of nonlinear functions of three
// combinations Wᵀz. A triangular map of order 3 in 50 variables would have some 316,000 coefficients; the
// lazy map has a hundred. Gradients of the log density are all that is needed. Shows
//   1. the solve: Laplace, directions, map on the subspace, verification,   2. what the spectrum says,
//   3. corrected answers beside dense quadrature in 3 dimensions,   4. marginals of single coefficients.
#include <cmath>
#include <cstdio>

#include "knothe/transport/extras/lazy_map.hpp"
#include "knothe/transport/extras/map_distribution.hpp"
#include "knothe/transport/testing/lazy_map_targets.hpp"

int main() {
  using namespace knothe::transport;
  targets::NonlinearSubspace target(50);

  // 1. The solve.
  const LazyMapResult result = solve_lazy_map(target);
  std::printf("Laplace alone: variance diagnostic %.3f; with %zu layer(s): %.4f%s%s; %ld evaluations\n",
              result.laplace_diagnostic, result.layers.size(), result.verified_diagnostic,
              result.reason.empty() ? "" : ": ", result.reason.c_str(),
              static_cast<long>(result.density_evaluations));

  // 2. The eigenvalues of H: how much each direction has to say beyond Laplace. Half the sum of those left
  // out bounds the
  //    divergence.
  for (const LazyLayer& layer : result.layers)
    std::printf("layer of rank %d, order %d: eigenvalues %.3g, %.3g, %.3g | %.1e; bound %.1e\n", layer.rank,
                layer.order, layer.eigenvalues[0], layer.eigenvalues[1], layer.eigenvalues[2],
                layer.eigenvalues[3], layer.bound);

  // 3. Corrected answers.
  const ImportanceCorrection answer = correct(result);
  const auto exact = target.dense_quadrature();
  const Eigen::Vector3d mean = target.w.transpose() * answer.mean;
  const Eigen::Matrix3d covariance = target.w.transpose() * answer.covariance * target.w;
  bool good = answer.trusted && std::abs(answer.log_evidence - exact.log_evidence) < 0.02;
  std::printf("%s, effective sample size %.3f\nlog evidence %.4f ± %.4f, exactly %.4f\n",
              answer.trusted ? "trusted" : "not trusted", answer.ess, answer.log_evidence,
              answer.log_evidence_error, exact.log_evidence);
  for (Eigen::Index k = 0; k < 3; ++k) {
    const double std = std::sqrt(exact.covariance(k, k));
    std::printf("u_%ld = %7.4f ± %.4f, exactly %7.4f ± %.4f\n", static_cast<long>(k + 1), mean[k],
                std::sqrt(covariance(k, k)), exact.mean[k], std);
    good = good && std::abs(mean[k] - exact.mean[k]) < 0.03 * std &&
           std::abs(std::sqrt(covariance(k, k)) / std - 1) < 0.03;
  }

  // 4. A marginal density of one of the 50, exactly Gaussian across the subspace and averaged along it.
  const MapDistribution distribution(result.map);
  const double at[] = {-1, 0, 1};
  const Eigen::VectorXd density = distribution.marginal_density(7, at);
  std::printf("density of z_8 at -1, 0, 1: %.3f %.3f %.3f\n", density[0], density[1], density[2]);
  std::printf("%s\n", good ? "agrees with dense quadrature in 3 dimensions" : "DOES NOT agree");
  return good ? 0 : 1;
}
