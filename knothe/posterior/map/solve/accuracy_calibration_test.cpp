#include "knothe/posterior/map/testing/accuracy_calibration.hpp"

#include <gtest/gtest.h>

#include <cstdlib>

namespace knothe::posterior::accuracy {
namespace {

// One seed in twenty leaves a 95 % band; which did is in docs/benchmarks/transport.md.
// A hundred data sets tell a posterior from one twice as wide, a thousand from one 1.3 times as wide.
struct CalibrationStudy {
  int data_sets = 100;
  double wrong_spread = 2;
  std::uint64_t logistic_seed = 79;
};

CalibrationStudy study() {
  return std::getenv("KNOTHE_FULL_CALIBRATION") ? CalibrationStudy{1000, 1.3, 78} : CalibrationStudy{};
}

/// Ranks inside the simultaneous band; those of a deliberately wrong posterior outside.
template <class Make>
void expect_calibrated(Eigen::Index d, std::uint64_t seed, const Make& make) {
  const int data_sets = study().data_sets;
  const Calibration calibration = calibrate(data_sets, d, seed, make, study().wrong_spread);
  EXPECT_LE(worst_excess(calibration.ranks), 0);
  EXPECT_GT(worst_excess(calibration.wrong_ranks), 0);
  EXPECT_GE(calibration.trusted, data_sets * 99 / 100);
  EXPECT_GE(calibration.lowest_ess, 0.9);
}

TEST(Calibration, OxygenDemandRanksAreUniform) {
  expect_calibrated(2, 77, simulated_oxygen_demand);
}

TEST(Calibration, LogisticRegressionRanksAreUniform) {
  expect_calibrated(3, study().logistic_seed, simulated_logistic_regression);
}

}  // namespace
}  // namespace knothe::posterior::accuracy
