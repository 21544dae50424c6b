#include "knothe/offline/law/damage_law.hpp"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <cmath>
#include <random>

#include "knothe/base/error.hpp"

namespace {

using namespace knothe::offline;

const ElasticConstants k_concrete;
const DamageParameters k_reference;

Eigen::Matrix3d tensor(const Voigt& e) {
  Eigen::Matrix3d m;
  m << e[0], e[3] / 2, e[5] / 2, e[3] / 2, e[1], e[4] / 2, e[5] / 2, e[4] / 2, e[2];
  return m;
}
Voigt voigt(const Eigen::Matrix3d& m) {
  return {m(0, 0), m(1, 1), m(2, 2), 2 * m(0, 1), 2 * m(1, 2), 2 * m(2, 0)};
}
Eigen::Matrix3d random_rotation(std::mt19937& generator) {
  std::normal_distribution<double> normal;
  return Eigen::Quaterniond(normal(generator), normal(generator), normal(generator), normal(generator))
      .normalized()
      .toRotationMatrix();
}
/// A strain with the given principal values in a random frame.
Voigt strain_with(const Eigen::Vector3d& principal, std::mt19937& generator) {
  const Eigen::Matrix3d q = random_rotation(generator);
  return voigt(q * principal.asDiagonal() * q.transpose());
}

/// Principal values (in 1e-4): generic, repeated, nearly repeated, with signs mixed, but none near zero
/// beside a positive one, where ∂Y/∂ε jumps.
const std::vector<Eigen::Vector3d> k_principal_cases = {
    {2.0, 1.0, 0.5},          {2.0, 1.0, -0.5},       {3.0, -0.7, -0.7},       {2.0, 2.0, 2.0},
    {2.0, 2.0, 0.5},          {2.0, 2.0, -0.5},       {2.0, 2.0 + 1e-9, -0.5}, {2.0, 2.0 + 1e-6, 0.5},
    {3.0, -0.7, -0.7 + 1e-8}, {2.5, 0.4, 0.4 + 1e-7}, {2.0, -1.0, -2.0},       {2.0, 2.0, 2.0 + 1e-7},
    {2.0, 2.0 + 1e-4, -1e-1}, {1.8, 0.3, -1.2}};

TEST(PrincipalStrains, agree_with_an_iterative_eigensolver_at_repeated_values_too) {
  std::mt19937 generator(1);
  for (const auto& principal : k_principal_cases) {
    for (int repeat = 0; repeat < 20; ++repeat) {
      const Voigt strain = strain_with(1e-4 * principal, generator);
      const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> reference(tensor(strain));
      const PrincipalStrains result = principal_strains(strain);
      Eigen::Matrix3d rebuilt = Eigen::Matrix3d::Zero(), gram;
      for (int i = 0; i < 3; ++i) {
        EXPECT_NEAR(result.values[i], reference.eigenvalues()(2 - i), 1e-18);
        const Eigen::Vector3d n(result.directions[i][0], result.directions[i][1], result.directions[i][2]);
        rebuilt += result.values[i] * n * n.transpose();
        for (int j = 0; j < 3; ++j)
          gram(i, j) = n.dot(
              Eigen::Vector3d(result.directions[j][0], result.directions[j][1], result.directions[j][2]));
      }
      EXPECT_LT((gram - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff(), 1e-13);
      EXPECT_LT((rebuilt - tensor(strain)).cwiseAbs().maxCoeff(), 1e-17);
    }
  }
}

TEST(PrincipalStrains, of_no_strain_and_of_a_pure_expansion_are_finite) {
  EXPECT_EQ(principal_strains({}).values[0], 0.0);
  const PrincipalStrains expansion = principal_strains({1e-4, 1e-4, 1e-4, 0, 0, 0});
  for (const double value : expansion.values) EXPECT_DOUBLE_EQ(value, 1e-4);
  EXPECT_EQ(energy_release_rate(Voigt{}, k_concrete), 0.0);
}

TEST(EnergyReleaseRate, takes_the_elastic_form_of_the_positive_part_only) {
  // All positive: the elastic energy. All negative: nothing.
  const Voigt expansion{2e-4, 1e-4, 3e-4, 0.4e-4, -0.2e-4, 0.1e-4};
  const Voigt stress = elastic_stress(expansion, k_concrete.lambda(), k_concrete.mu());
  double energy = 0;
  for (int i = 0; i < 6; ++i) energy += 0.5 * stress[i] * expansion[i];
  EXPECT_NEAR(energy_release_rate(expansion, k_concrete), energy, 1e-12 * energy);
  Voigt compression = expansion;
  for (double& component : compression) component = -component;
  EXPECT_EQ(energy_release_rate(compression, k_concrete), 0.0);
  // Mixed: by hand, ε⁺ = diag(2, 0, 0)·1e-4, tr ε⁺ = 2e-4 although tr ε = 0.
  const double expected = (0.5 * k_concrete.lambda() + k_concrete.mu()) * 4e-8;
  EXPECT_NEAR(energy_release_rate(Voigt{2e-4, -1e-4, -1e-4, 0, 0, 0}, k_concrete), expected,
              1e-12 * expected);
}

TEST(EnergyReleaseRate, derivative_agrees_with_finite_differences) {
  std::mt19937 generator(2);
  for (const auto& principal : k_principal_cases) {
    const Voigt strain = strain_with(1e-4 * principal, generator);
    const Voigt derivative = energy_release_rate_derivative(principal_strains(strain), k_concrete);
    double scale = 0;
    for (const double component : derivative) scale = std::max(scale, std::abs(component));
    for (int i = 0; i < 6; ++i) {
      const double step = 1e-9;
      Voigt plus = strain, minus = strain;
      plus[i] += step;
      minus[i] -= step;
      const double difference =
          (energy_release_rate(plus, k_concrete) - energy_release_rate(minus, k_concrete)) / (2 * step);
      EXPECT_NEAR(derivative[i], difference, 2e-7 * scale)
          << "component " << i << ", principal " << principal.transpose();
    }
  }
}

TEST(DamageLaw, tangent_agrees_with_finite_differences) {
  std::mt19937 generator(3);
  for (const auto& principal : k_principal_cases) {
    const Voigt strain = strain_with(1e-4 * principal, generator);
    const MaterialResponse response = respond(strain, 0.0, k_concrete, k_reference);
    ASSERT_TRUE(response.growing);
    for (int j = 0; j < 6; ++j) {
      const double step = 1e-9;
      Voigt plus = strain, minus = strain;
      plus[j] += step;
      minus[j] -= step;
      const Voigt above = respond(plus, 0.0, k_concrete, k_reference).stress;
      const Voigt below = respond(minus, 0.0, k_concrete, k_reference).stress;
      for (int i = 0; i < 6; ++i)
        EXPECT_NEAR(response.tangent[6 * i + j], (above[i] - below[i]) / (2 * step),
                    1e-6 * k_concrete.young_modulus)
            << i << "," << j << ", principal " << principal.transpose();
    }
  }
}

TEST(DamageLaw, uniaxial_tension_follows_the_closed_form) {
  // Uniaxial stress: lateral strains -ν ε are negative, so Y = (λ/2 + μ) ε².
  const double modulus = 0.5 * k_concrete.lambda() + k_concrete.mu();
  for (const double axial : {5e-5, 1.1e-4, 1.3e-4, 3e-4, 1e-3}) {
    const double lateral = -k_concrete.poisson_ratio * axial;
    const MaterialResponse response =
        respond({axial, lateral, lateral, 0, 0, 0}, 0.0, k_concrete, k_reference);
    const double excess = 2.25e-3 * (modulus * axial * axial - 216.0);
    const double expected = k_concrete.young_modulus * axial / (1 + std::max(excess, 0.0));
    EXPECT_NEAR(response.stress[0], expected, 1e-12 * expected);
    EXPECT_NEAR(response.stress[1], 0.0, 1e-6);
    EXPECT_EQ(response.growing, excess > 0);
  }
}

TEST(DamageLaw, slope_at_onset_is_that_of_the_one_dimensional_law) {
  // Just above the threshold dσ/dε = C - A_d (Cε) ⊗ ∂Y/∂ε; along the axis of uniaxial strain, where ∂Y/∂ε =
  // Cε and Y = ½ ε·Cε = Y₀, that is (λ + 2μ)(1 - 2 A_d Y₀).
  const double modulus = k_concrete.lambda() + 2 * k_concrete.mu();
  const double axial = std::sqrt(2 * k_reference.threshold / modulus) * (1 + 1e-12);
  const MaterialResponse response = respond({axial, 0, 0, 0, 0, 0}, 0.0, k_concrete, k_reference);
  const double expected = modulus * (1 - 2 * k_reference.brittleness * k_reference.threshold);
  EXPECT_NEAR(response.tangent[0], expected, 1e-6 * modulus);
}

TEST(DamageLaw, damage_is_irreversible_and_never_negative) {
  std::mt19937 generator(4);
  std::normal_distribution<double> normal(0.0, 1.5e-4);
  double previous = 0;
  for (int step = 0; step < 500; ++step) {
    Voigt strain;
    for (double& component : strain) component = normal(generator);
    const MaterialResponse response = respond(strain, previous, k_concrete, k_reference);
    EXPECT_GE(response.damage, previous);
    EXPECT_LT(response.damage, 1.0);
    previous = response.damage;
  }
  EXPECT_GT(previous, 0.1);
  EXPECT_EQ(damage(0.0, k_reference), 0.0);
  EXPECT_EQ(damage(216.0, k_reference), 0.0);
  // Unloading is elastic with the damage that is there.
  const MaterialResponse unloaded = respond({1e-6, 0, 0, 0, 0, 0}, 0.5, k_concrete, k_reference);
  EXPECT_FALSE(unloaded.growing);
  EXPECT_NEAR(unloaded.tangent[0], 0.5 * (k_concrete.lambda() + 2 * k_concrete.mu()), 1.0);
}

TEST(ExponentialLaw, the_stress_falls_exponentially_with_the_opening_on_elements_of_any_size) {
  const double modulus = 37e9, strength = 3.9e6, fracture_energy = 80, reference_size = 0.005;
  const double threshold = strength * strength / (2 * modulus);
  const DamageParameters p{threshold, brittleness_of(fracture_energy, reference_size),
                           SofteningLaw::exponential};
  for (const double size : {0.00125, 0.005, 0.02}) {
    EXPECT_EQ(band_damage(0.999 * threshold, p, reference_size / size).damage, 0.0);
    for (const double opening : {1e-9, 1e-6, 1e-5, 5e-5, 2e-4}) {  // m
      const double stress = strength * std::exp(-strength * opening / fracture_energy);
      const double strain = stress / modulus + opening / size, rate = 0.5 * modulus * strain * strain;
      const BandDamage d = band_damage(rate, p, reference_size / size);
      EXPECT_NEAR((1 - d.damage) * modulus * strain, stress, 1e-9 * modulus * strain);
      EXPECT_NEAR(d.damage * strain * size, opening, 1e-10 * opening + 1e-18);
      const double h = 2e-4 * rate, next = band_damage(rate + h, p, reference_size / size).damage,
                   before = band_damage(rate - h, p, reference_size / size).damage;
      if (opening > 1e-8) {
        EXPECT_NEAR(d.slope, (next - before) / (2 * h), 1e-6 * d.slope + 1e-12 / rate);
      }
    }
  }
  // An element in which the strain would have to go back: 2 h Y₀ > G_f.
  EXPECT_NEAR(reference_size / smallest_band_ratio(p), fracture_energy / (2 * threshold), 1e-12);
}

/// Petersson (1981): f_t/3 at 0.8 G_f/f_t, nothing from 3.6 G_f/f_t on; the area below is G_f.
TEST(BilinearLaw, the_stress_falls_along_two_lines_on_elements_of_any_size) {
  const double modulus = 37e9, strength = 3.9e6, fracture_energy = 80, reference_size = 0.005;
  const double threshold = strength * strength / (2 * modulus), unit = fracture_energy / strength;
  const DamageParameters p{threshold, brittleness_of(fracture_energy, reference_size),
                           SofteningLaw::bilinear};
  const auto expected = [&](double opening) {
    const double v = opening / unit;
    return v < 0.8 ? strength * (1 - v * (2.0 / 3) / 0.8)
                   : std::max(strength / 3 * (3.6 - v) / (3.6 - 0.8), 0.0);
  };
  double energy = 0;
  for (int i = 0; i < 3600; ++i) energy += 1e-3 * unit * expected((i + 0.5) * 1e-3 * unit);
  EXPECT_NEAR(energy, fracture_energy, 1e-5 * fracture_energy);
  for (const double size : {0.00125, 0.005, 0.02}) {
    EXPECT_EQ(band_damage(0.999 * threshold, p, reference_size / size).damage, 0.0);
    for (const double v : {1e-4, 0.1, 0.5, 0.79, 0.81, 1.5, 3.0, 3.59}) {
      const double opening = v * unit, stress = expected(opening);
      const double strain = stress / modulus + opening / size, rate = 0.5 * modulus * strain * strain;
      const BandDamage d = band_damage(rate, p, reference_size / size);
      EXPECT_NEAR((1 - d.damage) * modulus * strain, stress, 1e-9 * modulus * strain) << v;
      EXPECT_NEAR(d.damage * strain * size, opening, 1e-10 * opening + 1e-18) << v;
      const double h = 1e-6 * rate, next = band_damage(rate + h, p, reference_size / size).damage,
                   before = band_damage(rate - h, p, reference_size / size).damage;
      if (v > 1e-3) EXPECT_NEAR(d.slope, (next - before) / (2 * h), 1e-5 * d.slope + 1e-9 / rate) << v;
    }
    const double broken = 0.5 * modulus * std::pow(4 * unit / size, 2);
    EXPECT_NEAR(band_damage(broken, p, reference_size / size).damage, 1, 1e-8);
    EXPECT_LT(band_damage(broken, p, reference_size / size).damage, 1);
    EXPECT_EQ(band_damage(broken, p, reference_size / size).slope, 0);
  }
  // The strain would have to go back where 2 h Y₀ > 6/5 G_f.
  EXPECT_NEAR(reference_size / smallest_band_ratio(p), 1.2 * fracture_energy / (2 * threshold), 1e-12);
}

TEST(DamageLaw, senseless_constants_are_refused_with_the_reason) {
  const auto message = [](auto constants) -> std::string {
    try {
      constants.validate();
    } catch (const knothe::ProjectError& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_NE(message(ElasticConstants{-1, 0.2}).find("Young's modulus is -1"), std::string::npos);
  EXPECT_NE(message(ElasticConstants{30e9, 0.5}).find("between -1 and 0.5"), std::string::npos);
  EXPECT_NE(message(DamageParameters{-3, 1e-3}).find("Y0 is -3"), std::string::npos);
  EXPECT_NE(message(DamageParameters{216, 0}).find("Ad is 0"), std::string::npos);
  EXPECT_EQ(message(ElasticConstants{}), "");
}

}  // namespace
