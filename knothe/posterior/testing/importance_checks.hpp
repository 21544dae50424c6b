#pragma once
/// @file What every kind of adaptive importance sampling keeps: tests with any of them as `draw(target,
/// options)`.
#include <gtest/gtest.h>

#include <cmath>

#include "knothe/posterior/testing/known_mixture.hpp"
#include "knothe/posterior/weighted_sample.hpp"

namespace knothe::posterior::targets {

template <class Options, class Draw>
void expect_a_function_of_target_and_seed(const Draw& draw) {
  KnownMixture target({{1.0, Eigen::VectorXd::Zero(3), 0.3 * Eigen::MatrixXd::Identity(3, 3)}}, 0);
  Options options;
  const auto first = draw(target, options), again = draw(target, options);
  EXPECT_EQ(first.sample.points, again.sample.points);
  EXPECT_EQ(first.sample.weights, again.sample.weights);
  options.seed = 2;
  EXPECT_NE(first.sample.points, draw(target, options).sample.points);
}

/// Over 60 seeds: the mean square error of the mean, in units of the standard error stated.
template <class Options, class Draw>
double errors_in_units_of_those_stated(const Draw& draw, Options options) {
  KnownMixture target({{0.6, Eigen::Vector3d(1, 0, 0), 0.3 * Eigen::MatrixXd::Identity(3, 3)},
                       {0.4, Eigen::Vector3d(-1, 0.5, 0), 0.4 * Eigen::MatrixXd::Identity(3, 3)}},
                      0);
  const Eigen::VectorXd deviation = target.variance().cwiseSqrt();
  double squares = 0, stated = 0;
  for (options.seed = 1; options.seed <= 60; ++options.seed) {
    const auto r = draw(target, options);
    squares += ((mean_of(r.sample) - target.mean()).array() / deviation.array()).square().mean();
    stated += std::pow(r.mean_error / 4, 2);
  }
  return squares / stated;
}

}  // namespace knothe::posterior::targets
