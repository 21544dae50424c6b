#include "knothe/offline/distributed/distributed_model.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <iterator>

#include "knothe/base/error.hpp"
#include "knothe/offline/distributed/mesh_part.hpp"
#include "knothe/offline/distributed/ranks.hpp"
#include "knothe/offline/full_order/structure.hpp"
#include "knothe/offline/mesh/beam_mesh.hpp"

namespace knothe::offline {
namespace {

constexpr DistributedModel::LinearOptions k_accurate{.tolerance = 1e-12, .max_iterations = 500};

/// Elements near to cubes, which multigrid likes.
HexahedronMesh small_beam(double element = 0.02) {
  return beam_mesh({.element = element,
                    .layers = static_cast<int>(std::lround(0.05 / element)),
                    .largest_element = element});
}

double largest_difference(std::span<const double> a, std::span<const double> b) {
  double result = a.size() == b.size() ? 0.0 : INFINITY;
  for (std::size_t i = 0; i < a.size() && i < b.size(); ++i) result = std::max(result, std::abs(a[i] - b[i]));
  return result;
}

std::string message_of(const std::function<void()>& call) {
  try {
    call();
  } catch (const Error& error) {
    return error.what();
  }
  return "no error";
}

TEST(Ranks, AProcessThatNoLauncherStartedHasNoDaemonBesideIt) {
  EXPECT_EQ(Ranks::start().size, 1);
  const std::string own = std::to_string(::getpid());
  std::ifstream children("/proc/" + own + "/task/" + own + "/children");
  ASSERT_TRUE(children.is_open());
  EXPECT_EQ(std::string(std::istreambuf_iterator<char>(children), {}), "");
}

TEST(DistributedModel, ElasticSolutionIsThatOfTheDirectSolver) {
  const HexahedronMesh mesh = small_beam();
  const Structure structure(mesh, {}, "test");
  const DistributedModel model(mesh, {}, {}, 0, k_accurate);
  EXPECT_EQ(model.elastic().dofs, structure.dof_count());
  EXPECT_LT(largest_difference(model.elastic().unit_lift, structure.unit_lift()), 1e-9);
  EXPECT_NEAR(model.elastic().unit_reaction / (2 * structure.unit_reaction()), 1.0, 1e-10);
}

TEST(DistributedModel, RefinedMeshHasItsSetsSupportsAndMouth) {
  // A single rank's part is the whole refined mesh: the direct solver can take it.
  const HexahedronMesh mesh = small_beam();
  const MeshPart part = distribute_mesh(mesh, 1);
  EXPECT_EQ(part.total_cells, 8 * mesh.cell_count());
  EXPECT_EQ(part.owned_nodes, part.node_count());
  ASSERT_EQ(static_cast<std::int64_t>(part.coarse_nodes.size()), mesh.node_count());
  for (const auto& [number, node] : part.coarse_nodes)
    for (int c = 0; c < 3; ++c)
      ASSERT_EQ(part.mesh.points[static_cast<std::size_t>(3 * node + c)],
                mesh.points[static_cast<std::size_t>(3 * number + c)]);
  for (const auto node : part.mesh.symmetry)
    ASSERT_EQ(part.mesh.points[static_cast<std::size_t>(3 * node + 2)], 0.0);
  // Lines of n nodes become lines of 2 n - 1.
  EXPECT_EQ(part.mesh.support_left.size(), 2 * mesh.support_left.size() - 1);
  EXPECT_GE(part.mesh.mouth_left, 0);

  const Structure structure(part.mesh, {}, "refined");
  const DistributedModel model(mesh, {}, {}, 1, k_accurate);
  EXPECT_NEAR(model.elastic().unit_reaction / (2 * structure.unit_reaction()), 1.0, 1e-10);
  for (const auto& [number, node] : part.coarse_nodes)
    for (int c = 0; c < 3; ++c)
      ASSERT_NEAR(model.elastic().unit_lift[static_cast<std::size_t>(3 * number + c)],
                  structure.unit_lift()[static_cast<std::size_t>(3 * node + c)], 1e-9);
}

TEST(DistributedModel, IterationsDoNotGrowWithTheSize) {
  const DistributedModel::LinearOptions linear{.tolerance = 1e-8, .max_iterations = 100};
  std::vector<int> iterations;
  for (const int refinements : {0, 1, 2})
    iterations.push_back(
        DistributedModel(small_beam(0.025), {}, {}, refinements, linear).elastic().iterations);
  EXPECT_LE(iterations[2], iterations[0] + 3) << fmt::format("{}", fmt::join(iterations, ", "));
  EXPECT_LE(iterations[2], 15);
  // Elements of 25 × 10 × 4 mm away from the notch, as the beam's graded mesh has them.
  const HexahedronMesh graded = beam_mesh({.element = 0.01, .layers = 12});
  EXPECT_LE(DistributedModel(graded, {}, {}, 0, linear).elastic().iterations, 25);
}

TEST(DistributedModel, FollowsTheCrackAsTheDirectSolverDoes) {
  const HexahedronMesh mesh = beam_mesh({.element = 0.01});
  SolverOptions options;
  options.steps = 20;
  options.displacement = 2e-4;
  FullOrderModel direct(std::make_shared<Structure>(mesh, ElasticConstants{}, "test"), options);
  const FullOrderResult expected = direct.run({});
  DistributedModel model(mesh, {}, options, 0, k_accurate);
  int steps = 0;
  const FullOrderResult result = model.run({}, [&](int step, const StepRecord&) { steps = step + 1; });
  EXPECT_EQ(steps, 20);
  EXPECT_TRUE(result.steps_without_equilibrium().empty());
  EXPECT_LT(largest_difference(result.displacement, expected.displacement), 1e-10);  // of 2e-4 m
  EXPECT_LT(largest_difference(result.cell_damage, expected.cell_damage), 1e-6);
  EXPECT_NEAR(result.crack_length, expected.crack_length, 1e-7);
  EXPECT_GT(result.crack_length, 0.03);
  for (std::size_t i = 0; i < expected.steps.size(); ++i) {
    EXPECT_NEAR(result.steps[i].reaction_force, expected.steps[i].reaction_force, 1e-3) << i;
    EXPECT_NEAR(result.steps[i].dissipated_energy, expected.steps[i].dissipated_energy, 1e-6) << i;
    EXPECT_NEAR(result.steps[i].crack_mouth_opening, expected.steps[i].crack_mouth_opening, 1e-10) << i;
    EXPECT_EQ(result.steps[i].damaged_points, expected.steps[i].damaged_points) << i;
    EXPECT_NEAR(result.steps[i].external_work,
                result.steps[i].stored_energy + result.steps[i].dissipated_energy,
                1e-7 * result.steps[i].external_work)
        << i;
  }
}

TEST(DistributedModel, RefusesWhatIsNotInIt) {
  const HexahedronMesh mesh = small_beam();
  HexahedronMesh springs = mesh;
  springs.support_stiffness = 1e8;
  EXPECT_EQ(message_of([&] { DistributedModel(springs, {}, {}, 0, k_accurate); }),
            "distributed model: supports with springs are not in it: leave out support_stiffness");
  EXPECT_EQ(message_of([&] { DistributedModel(mesh, {}, {}, 9, k_accurate); }),
            "distributed mesh: 9 refinements; each makes 8 cells of one: take 0 to 6");
  EXPECT_NE(message_of([&] {
              DistributedModel(mesh, {}, {}, 0, {.tolerance = 1e-9, .max_iterations = 2});
            }).find("after 2 iterations of conjugate gradients"),
            std::string::npos);
  SolverOptions gradient;
  gradient.regularisation.kind = DamageRegularisation::gradient;
  EXPECT_NE(message_of([&] {
              (void)DistributedModel(mesh, {}, gradient, 0, k_accurate).run({});
            }).find("gradient damage is not in it"),
            std::string::npos);
}

}  // namespace
}  // namespace knothe::offline
