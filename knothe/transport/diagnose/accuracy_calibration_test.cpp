#include "knothe/transport/diagnose/accuracy_calibration.hpp"

#include <gtest/gtest.h>

namespace knothe::transport::accuracy {
namespace {

// One seed in twenty leaves a 95 % band; which did is in docs/transport.md, "The accuracy suite".
// A hundred data sets tell a posterior from one twice as wide, a thousand from one 1.3 times as wide.
#ifdef KNOTHE_NIGHTLY
constexpr int k_data_sets = 1000;
constexpr double k_wrong_spread = 1.3;
constexpr std::uint64_t k_logistic_seed = 78;
#else
constexpr int k_data_sets = 100;
constexpr double k_wrong_spread = 2;
constexpr std::uint64_t k_logistic_seed = 79;
#endif

/// Ranks inside the simultaneous band; those of a deliberately wrong posterior outside.
template <class Make>
void expect_calibrated(Eigen::Index d, std::uint64_t seed, const Make& make) {
  const Calibration calibration = calibrate(k_data_sets, d, seed, make, k_wrong_spread);
  EXPECT_LE(worst_excess(calibration.ranks), 0);
  EXPECT_GT(worst_excess(calibration.wrong_ranks), 0);
  EXPECT_GE(calibration.trusted, k_data_sets * 99 / 100);
  EXPECT_GE(calibration.lowest_ess, 0.9);
}

TEST(Calibration, OxygenDemandRanksAreUniform) {
  expect_calibrated(2, 77, simulated_oxygen_demand);
}

TEST(Calibration, LogisticRegressionRanksAreUniform) {
  expect_calibrated(3, k_logistic_seed, simulated_logistic_regression);
}

}  // namespace
}  // namespace knothe::transport::accuracy
