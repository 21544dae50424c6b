#include "knothe/offline/latin/latin_local_stage.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

namespace knothe::offline {
namespace {

/// The law in lanes beside the law at one point, which has tests of its own.
class LocalStageTest : public testing::Test {
 protected:
  void run(const std::vector<Voigt>& strains, const DamageParameters& parameters, double history) {
    const std::size_t n = padded_lanes(strains.size());
    std::vector<double> strain(6 * n), before(n, history), threshold(n, k_never), brittleness(n, 0.0),
        damaged(n), slope(n), derivative(6 * n);
    for (std::size_t j = 0; j < strains.size(); ++j) {
      threshold[j] = parameters.threshold;
      brittleness[j] = parameters.brittleness;
      for (std::size_t i = 0; i < 6; ++i) strain[i * n + j] = strains[j][i];
    }
    LocalStage stage{n,
                     threshold.data(),
                     brittleness.data(),
                     strain.data(),
                     before.data(),
                     damaged.data(),
                     slope.data(),
                     derivative.data()};
    evaluate_local_stage(stage, elastic_);
    std::vector<double> alone(n);
    LocalStage damage_only = stage;
    damage_only.damage = alone.data();
    damage_only.slope = damage_only.derivative = nullptr;
    evaluate_local_stage(damage_only, elastic_);
    EXPECT_EQ(alone, damaged);
    for (std::size_t j = 0; j < strains.size(); ++j) {
      const PrincipalStrains principal = principal_strains(strains[j]);
      const double current = damage(energy_release_rate(principal, elastic_), parameters);
      EXPECT_NEAR(damaged[j], std::max(current, history), 1e-11);
      if (std::abs(current - history) < 1e-9) continue;
      const double expected =
          current > history ? parameters.brittleness * (1 - current) * (1 - current) : 0.0;
      EXPECT_NEAR(slope[j], expected, 1e-9 * parameters.brittleness);
      const Voigt exact = energy_release_rate_derivative(principal, elastic_);
      double size = 0, error = 0;
      for (std::size_t i = 0; i < 6; ++i) {
        size = std::max(size, std::abs(strains[j][i]));
        error = std::max(error, std::abs(derivative[i * n + j] - exact[i]));
      }
      EXPECT_LE(error, derivative_tolerance_ * elastic_.young_modulus * size) << "lane " << j;
    }
  }
  ElasticConstants elastic_;
  DamageParameters parameters_;
  double derivative_tolerance_ = 1e-7;
};

TEST_F(LocalStageTest, RandomStrainsGiveWhatTheLawAtOnePointGives) {
  std::mt19937_64 random(1);
  std::normal_distribution<double> normal;
  std::vector<Voigt> strains(1003);
  for (Voigt& strain : strains)
    for (double& value : strain) value = 2e-4 * normal(random);
  run(strains, parameters_, 0.0);
  run(strains, parameters_, 0.4);
  run(strains, {0.0, 1e-2}, 0.0);
}

TEST_F(LocalStageTest, RepeatedAndVanishingPrincipalStrains) {
  derivative_tolerance_ = 1e-6;
  const double e = 2e-4;
  run({{0, 0, 0, 0, 0, 0},
       {e, 0, 0, 0, 0, 0},
       {e, e, e, 0, 0, 0},
       {e, e, -e, 0, 0, 0},
       {-e, -e, e, 0, 0, 0},
       {-e, -e, -e, 0, 0, 0},
       {e, -0.2 * e, -0.2 * e, 0, 0, 0},
       {e, e * (1 + 1e-9), 0.5 * e, 1e-12, 0, 0},
       {0.1 * e, 0.2 * e, 0.3 * e, 0, 0, 0}},
      parameters_, 0.0);
}

TEST_F(LocalStageTest, PaddingStaysWithoutDamage) {
  const std::vector<double> strain(6 * k_lanes, 1e-3), history(k_lanes, 0.0), brittleness(k_lanes, 0.0),
      threshold(k_lanes, k_never);
  std::vector<double> damaged(k_lanes, 7.0);
  evaluate_local_stage({k_lanes, threshold.data(), brittleness.data(), strain.data(), history.data(),
                        damaged.data(), nullptr, nullptr},
                       elastic_);
  for (const double value : damaged) EXPECT_EQ(value, 0.0);
}

}  // namespace
}  // namespace knothe::offline
