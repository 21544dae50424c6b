#include "knothe/offline/law/regularisation.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/files/testing/test_folder.hpp"
#include "knothe/offline/full_order/full_order_model.hpp"
#include "knothe/offline/full_order/gradient_stepping.hpp"
#include "knothe/offline/latin/latin_local_stage.hpp"
#include "knothe/offline/mesh/beam_mesh.hpp"

namespace {

using namespace knothe::offline;
using knothe::files::message_of;

constexpr double k_reference_size = 0.005;

std::shared_ptr<const Structure> beam_of(double element) {
  BeamOptions options;
  options.element = options.notch_width = element;
  options.largest_element = 0.05;
  options.growth = 1.6;
  return std::make_shared<const Structure>(beam_mesh(options), ElasticConstants{}, "beam");
}

std::shared_ptr<const Structure> coarse_beam() {
  static const auto structure = beam_of(0.01);
  return structure;
}

/// Stretching an element of width h by the strain e, uniaxially: stress, and opening = h × inelastic strain.
TEST(CrackBand, keeps_stress_against_opening_for_any_width) {
  const ElasticConstants elastic;
  const DamageParameters parameters;
  for (const double reference_strain : {1.1e-4, 1.3e-4, 2e-4, 1e-3, 1e-2}) {
    const Voigt reference{reference_strain, 0, 0, 0, 0, 0};
    const MaterialResponse expected = respond(reference, 0, elastic, parameters);
    const double opening = k_reference_size * expected.damage * reference_strain;
    for (const double width : {0.00125, 0.0025, 0.005, 0.007}) {
      // The strain at which an element of that width has that opening beside the same elastic strain.
      const double strain = (1 - expected.damage) * reference_strain + opening / width;
      const MaterialResponse scaled =
          respond({strain, 0, 0, 0, 0, 0}, 0, elastic, parameters, k_reference_size / width);
      EXPECT_NEAR(scaled.stress[0], expected.stress[0], 1e-11 * expected.stress[0])
          << "width " << width << ", strain " << reference_strain;
      EXPECT_NEAR(width * scaled.damage * strain, opening, 1e-11 * k_reference_size * reference_strain);
      EXPECT_NEAR(reference_damage(scaled.damage, k_reference_size / width), expected.damage, 1e-11);
    }
  }
}

TEST(CrackBand, slope_agrees_with_finite_differences_and_the_lanes_with_the_point) {
  const ElasticConstants elastic;
  for (const double threshold : {0.5, 1.0, 1.5})
    for (const double ratio : {0.8, 1.0, 1.7, 4.0}) {
      const DamageParameters parameters{216.0 * threshold, 2.25e-3};
      ASSERT_GT(ratio, smallest_band_ratio(parameters));
      alignas(64) double y0[k_lanes], ad[k_lanes], strain[6 * k_lanes] = {}, none[k_lanes] = {},
                                                              damage[k_lanes], slope[k_lanes],
                                                              derivative[6 * k_lanes];
      for (std::size_t i = 0; i < k_lanes; ++i) {
        y0[i] = parameters.threshold;
        ad[i] = parameters.brittleness;
        strain[i] = 0.9e-4 * std::pow(2.0, static_cast<double>(i));
      }
      evaluate_local_stage({k_lanes, y0, ad, strain, none, damage, slope, derivative, ratio}, elastic);
      for (std::size_t i = 0; i < k_lanes; ++i) {
        const double rate = energy_release_rate(Voigt{strain[i], 0, 0, 0, 0, 0}, elastic);
        const BandDamage point = band_damage(rate, parameters, ratio);
        EXPECT_NEAR(damage[i], point.damage, 1e-11);
        EXPECT_NEAR(slope[i], point.slope, 1e-9 * parameters.brittleness);
        if (rate < 1.01 * parameters.threshold) continue;
        const double step = 1e-5 * rate;
        const double difference = (band_damage(rate + step, parameters, ratio).damage -
                                   band_damage(rate - step, parameters, ratio).damage) /
                                  (2 * step);
        EXPECT_NEAR(point.slope, difference, 1e-6 * difference) << ratio << " " << rate;
      }
    }
}

TEST(CrackBand, tangent_agrees_with_finite_differences) {
  const ElasticConstants elastic;
  const Voigt strain{3e-4, -0.5e-4, 1e-4, 0.7e-4, 0.2e-4, -0.4e-4};
  for (const double ratio : {0.7, 2.0, 4.0}) {
    const MaterialResponse response = respond(strain, 0, elastic, {}, ratio);
    for (std::size_t j = 0; j < 6; ++j) {
      Voigt plus = strain, minus = strain;
      plus[j] += 1e-9;
      minus[j] -= 1e-9;
      const Voigt above = respond(plus, 0, elastic, {}, ratio).stress,
                  below = respond(minus, 0, elastic, {}, ratio).stress;
      for (std::size_t i = 0; i < 6; ++i)
        EXPECT_NEAR(response.tangent[6 * i + j], (above[i] - below[i]) / 2e-9, 1e-6 * elastic.young_modulus);
    }
  }
}

TEST(CrackBand, is_the_law_itself_at_the_reference_size_and_refuses_large_elements) {
  for (std::int64_t cell = 0; cell < coarse_beam()->mesh().cell_count(); ++cell)
    if (coarse_beam()->mesh().elastic[static_cast<std::size_t>(cell)] == 0) {
      EXPECT_NEAR(band_width(coarse_beam()->elements(), cell), 0.01, 1e-12);
    }
  SolverOptions options;
  options.steps = 10;
  options.displacement = 2e-4;
  const FullOrderResult plain = FullOrderModel(coarse_beam(), options).run({});
  options.regularisation = {DamageRegularisation::crack_band, 0.01, 0.01};
  const FullOrderResult same = FullOrderModel(coarse_beam(), options).run({});
  for (std::size_t i = 0; i < plain.steps.size(); ++i)
    EXPECT_NEAR(same.steps[i].reaction_force, plain.steps[i].reaction_force,
                1e-8 * plain.steps[i].reaction_force);
  EXPECT_NEAR(same.crack_length, plain.crack_length, 1e-8);
  options.regularisation.reference_size = 0.001;
  const std::string text = message_of<knothe::ProjectError>(
      [&] { static_cast<void>(FullOrderModel(coarse_beam(), options).run({})); });
  EXPECT_NE(text.find("0.01 m wide"), std::string::npos) << text;
  EXPECT_NE(text.find("take smaller elements"), std::string::npos) << text;
}

TEST(GradientDamage, tangent_agrees_with_finite_differences_of_the_residual) {
  SolverOptions options;
  options.regularisation = {DamageRegularisation::gradient, 0.005, 0.02};
  GradientStepping loading(*coarse_beam(), options, {});
  // A state after the peak, disturbed so that nothing is stationary.
  static_cast<void>(loading.advance(1.0e-4));
  const auto n = static_cast<std::size_t>(loading.unknown_count());
  const auto free = static_cast<std::size_t>(coarse_beam()->free_count());
  std::vector<double> base(n), direction(n);
  for (std::size_t i = 0; i < free; ++i)
    base[i] = 1.1 * loading.displacement()[static_cast<std::size_t>(coarse_beam()->free_dofs()[i])];
  for (std::size_t i = 0; i < n; ++i) {
    if (i >= free) base[i] = 2e-4 + 1e-4 * std::cos(0.1 * static_cast<double>(i));
    direction[i] = (i < free ? 1e-6 : 1e-5) * std::sin(1.7 * static_cast<double>(i));
  }
  loading.linearise(1.1e-4, base);
  std::vector<double> product(n);
  loading.tangent().multiply(direction, product);
  const auto at = [&](double step) {
    std::vector<double> moved(n);
    for (std::size_t i = 0; i < n; ++i) moved[i] = base[i] + step * direction[i];
    loading.linearise(1.1e-4, moved);
    return std::vector<double>(loading.residual().begin(), loading.residual().end());
  };
  const auto above = at(1e-3), below = at(-1e-3);
  double error = 0, scale = 0;
  for (std::size_t i = 0; i < n; ++i) {
    error = std::max(error, std::abs(product[i] - (above[i] - below[i]) / 2e-3));
    scale = std::max(scale, std::abs(product[i]));
  }
  EXPECT_LT(error, 1e-5 * scale);
}

TEST(GradientDamage, converges_and_balances_energy) {
  SolverOptions options;
  options.steps = 12;
  options.regularisation = {DamageRegularisation::gradient, 0.005, 0.01};
  const FullOrderResult run = FullOrderModel(coarse_beam(), options).run({});
  double last = 0, peak = 0;
  for (const StepRecord& step : run.steps) {
    peak = std::max(peak, step.reaction_force);
    EXPECT_TRUE(step.equilibrium);
    EXPECT_LT(step.residual, 1e-8);
    EXPECT_NEAR(step.external_work, step.stored_energy + step.dissipated_energy, 1e-8 * step.external_work);
    EXPECT_GE(step.dissipated_energy, last);
    last = step.dissipated_energy;
  }
  EXPECT_GT(run.crack_length, 0.01);
  EXPECT_LT(run.crack_length, 0.08);
  EXPECT_LT(run.steps.back().reaction_force, 0.5 * peak);
}

/// Elements of 10 and 5 mm: with the law as it is the dissipated energy differs by half, with a crack band it
/// does not. (The study of docs/explanation/mechanics.md, on coarse meshes.)
TEST(CrackBand, makes_the_beam_independent_of_the_mesh) {
  SolverOptions options;
  options.steps = 20;
  FullOrderResult runs[2][2];
  for (const int band : {0, 1})
    for (const int fine : {0, 1}) {
      options.regularisation = {band == 1 ? DamageRegularisation::crack_band : DamageRegularisation::none,
                                0.005, 0.01};
      runs[band][fine] = FullOrderModel(fine == 1 ? beam_of(0.005) : coarse_beam(), options).run({});
      EXPECT_TRUE(runs[band][fine].steps_without_equilibrium().empty());
    }
  const auto dissipated = [&](int band, int fine) { return runs[band][fine].steps.back().dissipated_energy; };
  EXPECT_GT(dissipated(0, 0), 1.3 * dissipated(0, 1));
  EXPECT_NEAR(dissipated(1, 0), dissipated(1, 1), 0.06 * dissipated(1, 1));
  // The uppermost row, which cannot be damaged, is an element high.
  EXPECT_NEAR(runs[1][0].crack_length + 0.01, runs[1][1].crack_length + 0.005, 0.001);
}

TEST(Regularisation, refuses_lengths_that_make_no_sense) {
  const std::string text = message_of<knothe::ProjectError>([] {
    DamageRegularisationOptions{DamageRegularisation::gradient, 0.005, 0}.validate();
  });
  EXPECT_NE(text.find("internal_length is 0 m; it must be positive"), std::string::npos) << text;
}

}  // namespace
