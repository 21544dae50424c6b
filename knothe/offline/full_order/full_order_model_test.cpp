#include "knothe/offline/full_order/full_order_model.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "knothe/base/cancellation.hpp"
#include "knothe/base/error.hpp"
#include "knothe/files/testing/test_folder.hpp"
#include "knothe/offline/mesh/beam_mesh.hpp"

namespace {

using namespace knothe::offline;
using knothe::files::message_of;

/// A coarse beam (elements of 10 mm), the same for all tests.
std::shared_ptr<const Structure> coarse_beam() {
  static const auto structure = [] {
    BeamOptions options;
    options.element = 0.01;
    options.largest_element = 0.05;
    return std::make_shared<const Structure>(beam_mesh(options), ElasticConstants{}, "beam");
  }();
  return structure;
}

SolverOptions some_steps(int steps) {
  SolverOptions options;
  options.steps = steps;
  return options;
}

DamageParameters scaled(double threshold, double brittleness) {
  return {216.0 * threshold, 2.25e-3 * brittleness};
}

const FullOrderResult& reference_run() {
  static const FullOrderResult result = FullOrderModel(coarse_beam(), some_steps(40)).run({});
  return result;
}

double max_difference(std::span<const double> a, std::span<const double> b) {
  double largest = 0;
  for (std::size_t i = 0; i < a.size(); ++i) largest = std::max(largest, std::abs(a[i] - b[i]));
  return largest;
}

TEST(FullOrderModel, condensation_is_exact) {
  SolverOptions options = some_steps(20);
  options.tolerance = 1e-12;
  const FullOrderResult condensed = FullOrderModel(coarse_beam(), options).run({});
  options.condensation = Condensation::none;
  const FullOrderResult whole = FullOrderModel(coarse_beam(), options).run({});
  const auto n = static_cast<std::size_t>(coarse_beam()->dof_count());
  int damaged_steps = 0;
  for (std::size_t step = 0; step < 20; ++step) {
    const auto a = std::span(condensed.displacement).subspan(step * n, n);
    const auto b = std::span(whole.displacement).subspan(step * n, n);
    const double imposed = condensed.steps[step].imposed_displacement;
    const bool damaged = condensed.steps[step].damaged_points > 0;
    damaged_steps += damaged ? 1 : 0;
    EXPECT_LT(max_difference(a, b), (damaged ? 1e-6 : 1e-9) * imposed) << "step " << step;
    EXPECT_NEAR(condensed.steps[step].reaction_force, whole.steps[step].reaction_force,
                (damaged ? 1e-6 : 1e-9) * whole.steps[step].reaction_force);
    EXPECT_EQ(condensed.steps[step].damaged_points, whole.steps[step].damaged_points);
    EXPECT_LT(condensed.steps[step].active_cells, whole.steps[step].active_cells);
  }
  EXPECT_GE(damaged_steps, 10);
  EXPECT_LE(damaged_steps, 19);
}

TEST(FullOrderModel, every_step_is_an_equilibrium_of_the_law_applied_to_the_whole_history) {
  // From the record of displacements alone: the damage by `respond` at every Gauss point of the damageable
  // cells, the nodal forces of all cells, and their sum at the free dofs.
  const FullOrderResult& run = reference_run();
  const Structure& structure = *coarse_beam();
  const auto n = static_cast<std::size_t>(structure.dof_count());
  std::vector<double> damage(static_cast<std::size_t>(structure.mesh().cell_count()) * k_points_per_cell,
                             0.0);
  const DamageParameters unbreakable{1e30, 1e-3};
  for (std::size_t step = 0; step < run.steps.size(); ++step) {
    const auto u = std::span(run.displacement).subspan(step * n, n);
    std::vector<double> force(n, 0.0);
    for (std::int64_t cell = 0; cell < structure.mesh().cell_count(); ++cell) {
      const CellVector displacement = structure.gather(u, cell);
      CellVector cell_force{};
      for (int point = 0; point < k_points_per_cell; ++point) {
        const double* gradient = structure.elements().gradient(cell, point);
        double& d = damage[k_points_per_cell * cell + point];
        const auto response = respond(strain_at(gradient, displacement), d, structure.elastic(),
                                      structure.mesh().elastic[cell] != 0 ? unbreakable : DamageParameters{});
        d = response.damage;
        add_internal_force(gradient, response.stress, structure.elements().weight(cell, point), cell_force);
      }
      const auto dofs = structure.cell_dofs(cell);
      for (int i = 0; i < k_cell_dofs; ++i) force[dofs[i]] += cell_force[i];
    }
    double square = 0, reaction = 0;
    for (std::size_t dof = 0; dof < n; ++dof) {
      if (structure.free_index(static_cast<int>(dof)) >= 0) square += force[dof] * force[dof];
      reaction -= 2 * (structure.unit_prescribed()[dof] < 0 ? force[dof] : 0.0);
    }
    EXPECT_NEAR(reaction, run.steps[step].reaction_force, 1e-8 * reaction) << "step " << step;
    EXPECT_LT(2 * std::sqrt(square), 1e-8 * reaction) << "step " << step;
    EXPECT_TRUE(run.steps[step].equilibrium);
  }
  EXPECT_TRUE(run.steps_without_equilibrium().empty());
}

TEST(FullOrderModel, loses_its_strength_after_a_peak_and_damages_only_where_it_may) {
  const FullOrderResult& run = reference_run();
  const auto peak = std::max_element(run.steps.begin(), run.steps.end(), [](const auto& a, const auto& b) {
    return a.reaction_force < b.reaction_force;
  });
  EXPECT_GT(peak->imposed_displacement, 5e-5);
  EXPECT_LT(peak->imposed_displacement, 1.5e-4);
  EXPECT_LT(run.steps.back().reaction_force, 0.4 * peak->reaction_force);
  EXPECT_GT(run.steps.back().crack_mouth_opening, 1e-4);
  const auto& mesh = coarse_beam()->mesh();
  double largest = 0;
  for (std::int64_t cell = 0; cell < mesh.cell_count(); ++cell) {
    if (mesh.elastic[cell] != 0) {
      EXPECT_EQ(run.cell_damage[cell], 0.0);
    }
    largest = std::max(largest, run.cell_damage[cell]);
  }
  EXPECT_GT(largest, 0.9);
  EXPECT_LT(largest, 1.0);
}

TEST(FullOrderModel, work_is_stored_or_dissipated_and_dissipation_never_negative) {
  for (const auto& parameters : {DamageParameters{}, scaled(1.5, 1.5), scaled(0.5, 0.7)}) {
    const FullOrderResult run = FullOrderModel(coarse_beam(), some_steps(40)).run(parameters);
    double dissipated = 0;
    for (const auto& step : run.steps) {
      EXPECT_NEAR(step.external_work, step.stored_energy + step.dissipated_energy, 1e-7 * step.external_work);
      EXPECT_GE(step.dissipated_energy, dissipated);
      EXPECT_GE(step.stored_energy, 0.0);
      dissipated = step.dissipated_energy;
    }
    EXPECT_GT(dissipated, 0.5 * run.steps.back().external_work);
  }
}

TEST(FullOrderModel, elastic_steps_follow_the_elastic_solution_and_its_energy) {
  const FullOrderResult& run = reference_run();
  const Structure& structure = *coarse_beam();
  const StepRecord& first = run.steps.front();
  ASSERT_EQ(first.damaged_points, 0);
  EXPECT_NEAR(first.reaction_force, 2 * structure.unit_reaction() * first.imposed_displacement,
              1e-10 * first.reaction_force);
  EXPECT_NEAR(first.stored_energy, first.reaction_force * first.imposed_displacement / 2,
              1e-10 * first.stored_energy);
  for (int dof = 0; dof < structure.dof_count(); ++dof)
    EXPECT_NEAR(run.displacement[dof], first.imposed_displacement * structure.unit_lift()[dof], 1e-15);
}

TEST(FullOrderModel, newton_converges_quadratically) {
  // log of the residual doubles from one iteration to the next, once it is small and until rounding: e.g.
  // 1e-3, 1e-6.
  int quadratic = 0, seen = 0;
  for (const auto& step : reference_run().steps) {
    const auto& r = step.newton_residuals;
    for (std::size_t k = 1; k < r.size(); ++k) {
      if (r[k - 1] > 3e-3 || r[k - 1] < 1e-5) continue;
      ++seen;
      if (r[k] < 30 * r[k - 1] * r[k - 1]) ++quadratic;
    }
  }
  EXPECT_GE(seen, 10);
  EXPECT_GE(quadratic, seen * 4 / 5);
}

TEST(FullOrderModel, the_step_size_does_not_matter) {
  // Damage is the maximum over history of a function of the total strain, and the loading is monotonic.
  const FullOrderResult fine = FullOrderModel(coarse_beam(), some_steps(80)).run({});
  const FullOrderResult& coarse = reference_run();
  for (std::size_t step = 0; step < coarse.steps.size(); ++step)
    EXPECT_NEAR(coarse.steps[step].reaction_force, fine.steps[2 * step + 1].reaction_force,
                2e-3 * coarse.steps[step].reaction_force)
        << "step " << step;
}

TEST(FullOrderModel, a_run_does_not_depend_on_the_runs_before_it) {
  FullOrderModel model(coarse_beam(), some_steps(12));
  const FullOrderResult first = model.run(scaled(0.8, 1.1));
  (void)model.run(scaled(0.5, 0.5));
  const FullOrderResult again = model.run(scaled(0.8, 1.1));
  EXPECT_EQ(first.displacement, again.displacement);
}

TEST(FullOrderModel, brittle_parameters_reach_equilibrium_by_cutting_and_the_secant_fallback) {
  const FullOrderResult run = FullOrderModel(coarse_beam(), some_steps(40)).run(scaled(1.5, 1.5));
  EXPECT_TRUE(run.steps_without_equilibrium().empty());
  int cut = 0;
  for (const auto& step : run.steps) cut += step.increments > 1 ? 1 : 0;
  EXPECT_GT(cut, 0);
  EXPECT_GT(run.secant_iterations(), 0);
  for (const double d : run.cell_damage) EXPECT_LT(d, 1.0);
}

TEST(FullOrderModel, a_step_without_equilibrium_is_reported_and_the_run_goes_on) {
  SolverOptions options = some_steps(20);
  options.newton_iterations = 2;
  options.cuts = 0;
  options.secant_iterations = 1;
  const FullOrderResult run = FullOrderModel(coarse_beam(), options).run(scaled(1.5, 1.5));
  EXPECT_EQ(run.steps.size(), 20u);
  ASSERT_FALSE(run.steps_without_equilibrium().empty());
  for (const int step : run.steps_without_equilibrium()) EXPECT_GT(run.steps[step].residual, 1e-8);
  for (const double value : run.displacement) ASSERT_TRUE(std::isfinite(value));
}

TEST(FullOrderModel, stops_between_steps_when_asked_to) {
  FullOrderModel model(coarse_beam(), some_steps(20));
  int last = -1;
  const std::string message = message_of<knothe::Interrupted>([&] {
    (void)model.run({}, [&](int step) {
      last = step;
      if (step == 3) knothe::request_cancellation();
    });
  });
  knothe::request_cancellation(false);
  EXPECT_EQ(last, 3);
  EXPECT_NE(message.find("step 4 of 20"), std::string::npos) << message;
}

TEST(FullOrderModel, senseless_options_are_refused_with_the_reason) {
  const auto refused = [](auto change) {
    SolverOptions options;
    change(options);
    return message_of<knothe::ProjectError>([&] { FullOrderModel(coarse_beam(), options); });
  };
  EXPECT_NE(refused([](auto& o) { o.steps = 0; }).find("steps is 0"), std::string::npos);
  EXPECT_NE(refused([](auto& o) { o.displacement = -1e-4; }).find("displacement is -0.0001"),
            std::string::npos);
  EXPECT_NE(refused([](auto& o) { o.tolerance = 1e-3; }).find("not above acceptance"), std::string::npos);
  EXPECT_NE(refused([](auto& o) { o.activation = 2; }).find("activation is 2"), std::string::npos);
  EXPECT_EQ(refused([](auto&) {}), "");
}

}  // namespace
