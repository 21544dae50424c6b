// Only samples are known: a density, its marginals and new samples from 2,000 points.
//
// Run:  build/release/examples/example_samples_only
//
// The points lie along a parabola, y ~ N(0.5 x², 0.5²). Shows
//   1. a map from samples, its order by cross-validation,   2. its density beside the true one,   3. new
//   samples,
//   4. a sparse map where it is known which variables matter to which.
#include <cmath>
#include <cstdio>
#include <numbers>

#include "knothe/numerics/statistics/random.hpp"
#include "knothe/transport/diagnose/moments.hpp"
#include "knothe/transport/extras/sample_map.hpp"

namespace {

Eigen::MatrixXd draw(Eigen::Index n, std::uint64_t seed) {
  Eigen::MatrixXd z = knothe::numerics::monte_carlo_normal_points(n, 2, seed);
  z.col(1) = (0.5 * z.col(1) + 0.5 * z.col(0).cwiseAbs2()).eval();
  return z;
}

double true_log_density(double x, double y) {
  const double u = (y - 0.5 * x * x) / 0.5;
  return -0.5 * (x * x + u * u) - std::log(2 * std::numbers::pi * 0.5);
}

}  // namespace

int main() {
  using namespace knothe::transport;
  const Eigen::MatrixXd samples = draw(2000, 1), unseen = draw(2000, 2);

  // 1. Each component of the map is fitted by itself, and gets the order that predicts held-out samples best.
  const SampleMap map = map_from_samples(samples);
  std::printf("orders %d and %d, %ld coefficients; held-out log likelihood %.3f ± %.3f a sample\n",
              map.orders[0], map.orders[1], static_cast<long>(map.coefficient_count),
              map.held_out_log_likelihood, map.held_out_error);

  // 2. The log density, here at samples that the map never saw: the mean difference to the truth is
  // KL(truth‖map).
  double truth = 0;
  for (Eigen::Index i = 0; i < unseen.rows(); ++i)
    truth += true_log_density(unseen(i, 0), unseen(i, 1)) / static_cast<double>(unseen.rows());
  const double divergence = truth - map.log_density(unseen).mean();
  SampleMapOptions affine;
  affine.max_order = 1;
  const double of_gaussian = truth - map_from_samples(samples, {}, affine).log_density(unseen).mean();
  std::printf("divergence from the truth %.4f (a Gaussian with the samples' covariance: %.4f)\n", divergence,
              of_gaussian);

  // 3. New samples, through the inverse.
  const Moments moments = moments_of(map.sample(20000, 3), Eigen::VectorXd::Ones(20000));
  std::printf("y of new samples: mean %.3f (0.500), standard deviation %.3f (%.3f), skewness %.2f (%.2f)\n",
              moments.mean[1], std::sqrt(moments.covariance(1, 1)), std::sqrt(0.25 + 0.5),
              moments.skewness[1], 8 * 0.125 / std::pow(0.75, 1.5));

  // 4. A chain x_1 → x_2 → … → x_8: each component of S needs one neighbour only.
  Eigen::MatrixXd chain = knothe::numerics::monte_carlo_normal_points(1000, 8, 4);
  for (Eigen::Index k = 1; k < 8; ++k) chain.col(k) = (0.6 * chain.col(k) + 0.8 * chain.col(k - 1)).eval();
  std::vector<std::pair<int, int>> neighbours;
  for (int k = 1; k < 8; ++k) neighbours.emplace_back(k - 1, k);
  SampleMapOptions sparse;
  sparse.max_order = 2;
  const SampleMap dense_map = map_from_samples(chain, {}, sparse);
  sparse.family = [&](Eigen::Index d, int order) {
    return sparse_map(total_order_map(d, order), parents_by_elimination(d, neighbours));
  };
  const SampleMap sparse_fit = map_from_samples(chain, {}, sparse);
  std::printf("chain of 8: %ld coefficients with the neighbours known, %ld without; held out %.3f and %.3f\n",
              static_cast<long>(sparse_fit.coefficient_count), static_cast<long>(dense_map.coefficient_count),
              sparse_fit.held_out_log_likelihood, dense_map.held_out_log_likelihood);

  const bool good = divergence < 0.03 && of_gaussian > 3 * divergence &&
                    std::abs(moments.mean[1] - 0.5) < 0.06 &&
                    sparse_fit.coefficient_count < dense_map.coefficient_count;
  std::printf("%s\n", good ? "as it should be" : "NOT as it should be");
  return good ? 0 : 1;
}
