#include "knothe/model/observe/observed_model.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "knothe/base/error.hpp"
#include "knothe/files/testing/test_folder.hpp"
#include "knothe/model/observe/scalar_observations.hpp"
#include "knothe/model/observe/shape_functions.hpp"
#include "knothe/model/reduced/time_interpolation.hpp"
#include "knothe/model/testing/test_models.hpp"

namespace knothe::model {
namespace {

using files::message_of;
using ::testing::HasSubstr;

TEST(ShapeFunctions, PartitionOfUnityAndDerivatives) {
  for (const char* name : {"VTK_TRIANGLE", "quad", "VTK_TETRA", "VTK_HEXAHEDRON", "VTK_QUADRATIC_TRIANGLE",
                           "VTK_QUADRATIC_QUAD", "quadratic_tetra", "VTK_QUADRATIC_HEXAHEDRON"}) {
    const auto element = ReferenceElement::named(name);
    ASSERT_TRUE(element.has_value()) << name;
    const Eigen::Vector3d xi(0.2, 0.31, element->dimension() == 3 ? 0.17 : 0.0);
    EXPECT_NEAR(element->shape(xi).sum(), 1.0, 1e-15);
    const Eigen::MatrixXd derivatives = element->shape_derivatives(xi);
    for (Eigen::Index j = 0; j < element->dimension(); ++j) {
      const Eigen::Vector3d h = 1e-6 * Eigen::Vector3d::Unit(j);
      const Eigen::VectorXd difference = (element->shape(xi + h) - element->shape(xi - h)) / 2e-6;
      EXPECT_LT((difference - derivatives.col(j)).norm(), 1e-9);
    }
  }
  EXPECT_FALSE(ReferenceElement::named("VTK_PYRAMID").has_value());
}

/// The nodes of VTK's documentation, and a polynomial of the second degree that their values determine.
TEST(ShapeFunctions, QuadraticElementsHoldAQuadraticFunctionExactly) {
  const auto function = [](const Eigen::Vector3d& x) {
    return 1 + 2 * x[0] - x[1] + 0.5 * x[2] + x[0] * x[0] - 3 * x[0] * x[1] + 2 * x[1] * x[2] + x[2] * x[2];
  };
  const auto value_at = [&](const char* type, const std::vector<Eigen::Vector3d>& nodes,
                            const Eigen::Vector3d& point) {
    const auto element = *ReferenceElement::named(type);
    ElementNodes x(3, element.nodes());
    Eigen::VectorXd values(element.nodes());
    EXPECT_EQ(std::ssize(nodes), element.nodes());
    for (Index k = 0; k < element.nodes(); ++k) {
      x.col(k) = nodes[k];
      values[k] = function(nodes[k]);
    }
    return element.weights_at(x, point, 1e-9).value().dot(values);
  };
  const Eigen::Vector3d in_face(0.3, 0.4, 0), inside(0.3, 0.4, 0.2);
  EXPECT_NEAR(value_at("VTK_QUADRATIC_TRIANGLE",
                       {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0.5, 0, 0}, {0.5, 0.5, 0}, {0, 0.5, 0}}, in_face),
              function(in_face), 1e-13);
  EXPECT_NEAR(
      value_at(
          "VTK_QUADRATIC_QUAD",
          {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {0.5, 0, 0}, {1, 0.5, 0}, {0.5, 1, 0}, {0, 0.5, 0}},
          in_face),
      function(in_face), 1e-13);
  EXPECT_NEAR(value_at("VTK_QUADRATIC_TETRA",
                       {{0, 0, 0},
                        {1, 0, 0},
                        {0, 1, 0},
                        {0, 0, 1},
                        {0.5, 0, 0},
                        {0.5, 0.5, 0},
                        {0, 0.5, 0},
                        {0, 0, 0.5},
                        {0.5, 0, 0.5},
                        {0, 0.5, 0.5}},
                       inside),
              function(inside), 1e-13);
  EXPECT_NEAR(
      value_at("VTK_QUADRATIC_HEXAHEDRON",
               {{0, 0, 0},   {1, 0, 0},   {1, 1, 0},   {0, 1, 0},   {0, 0, 1},   {1, 0, 1},   {1, 1, 1},
                {0, 1, 1},   {0.5, 0, 0}, {1, 0.5, 0}, {0.5, 1, 0}, {0, 0.5, 0}, {0.5, 0, 1}, {1, 0.5, 1},
                {0.5, 1, 1}, {0, 0.5, 1}, {0, 0, 0.5}, {1, 0, 0.5}, {1, 1, 0.5}, {0, 1, 0.5}},
               inside),
      function(inside), 1e-13);
}

TEST(ShapeFunctions, InverseMapFindsThePointOfADistortedElement) {
  const auto element = *ReferenceElement::named("VTK_HEXAHEDRON");
  const Mesh mesh = small_mesh();
  ElementNodes x(3, 8);
  for (Eigen::Index i = 0; i < 8; ++i) {
    x.col(i) =
        Eigen::Map<const Eigen::Vector3d>(mesh.points.data() + 3 * mesh.cells[static_cast<std::size_t>(i)]);
  }
  for (const Eigen::Vector3d& xi : {Eigen::Vector3d(0.3, -0.7, 0.9), Eigen::Vector3d(-1, 1, 0.2)}) {
    const auto weights = element.weights_at(x, x * element.shape(xi), 1e-6);
    ASSERT_TRUE(weights.has_value());
    EXPECT_LT((*weights - element.shape(xi)).norm(), 1e-11);
  }
  EXPECT_FALSE(element.weights_at(x, x * element.shape({1.01, 0, 0}), 1e-6).has_value());
}

/// x-, y-, z-displacements that the isoparametric elements hold exactly: linear functions of the position.
double linear(int component, const double* x) {
  return 0.1 * component + (1 + component) * x[0] - 2.0 * x[1] + 0.5 * x[2];
}

/// A model whose lift is `linear` and whose modes are random.
SeparatedModel model_with_linear_lift(Form form, bool with_mesh) {
  ModelContents contents = random_contents(form);
  for (std::size_t dof = 0; dof < contents.dof_count(); ++dof) {
    for (std::size_t t = 0; t < contents.time.size(); ++t) {
      contents.lift[t * contents.dof_count() + dof] =
          linear(static_cast<int>(contents.dofs.components[dof]), contents.dofs.points.data() + 3 * dof);
    }
  }
  if (!with_mesh) contents.mesh.reset();
  return SeparatedModel(std::move(contents), "M.h5");
}

TEST(Observe, DofsAreTheModelsOwnValues) {
  for (const Form form : {Form::canonical, Form::tree}) {
    const SeparatedModel model = model_with_linear_lift(form, true);
    const auto& dofs = model.contents().dofs;
    const std::vector<double> points{dofs.points[3 * 22] + 5e-7,
                                     dofs.points[3 * 22 + 1],
                                     dofs.points[3 * 22 + 2],
                                     dofs.points[0],
                                     dofs.points[1],
                                     dofs.points[2]};
    const std::vector<std::int64_t> components{1, 2};
    const ObservedModel observed = observe(model, {points, components});
    const std::vector<std::size_t> same{22, 2};
    EXPECT_EQ(observed.space, observe_dofs(model, same).space);
    const std::vector<double> p{0.66, 1.21};
    for (std::size_t t = 0; t < 4; ++t) {
      const Eigen::VectorXd y = observed.predict(Eigen::Vector2d(p[0], p[1]), t);
      const FieldDerivatives expected = model.evaluate(p, t, same);
      EXPECT_NEAR(y[0], expected.value[0], 1e-12);
      EXPECT_NEAR(y[1], expected.value[1], 1e-12);
    }
    EXPECT_EQ(observed.parameters, (std::vector<std::string>{"Y0", "Ad"}));
    const std::vector<std::size_t> steps{2};
    EXPECT_EQ(at_steps(observed, steps).time, (std::vector<double>{2.5}));
    EXPECT_EQ(at_steps(observed, steps).core[0], observed.core[2]);
  }
}

TEST(Observe, BetweenDofsLinearFieldsAreExact) {
  const SeparatedModel model = model_with_linear_lift(Form::tree, true);
  const std::vector<double> points{0.04, 0.05, 0.06, 0.17, 0.033, 0.09, 0.155, 0.05, 0.05};
  const std::vector<std::int64_t> components{0, 1, 2};
  const ObservedModel observed = observe(model, {points, components});
  for (int i = 0; i < 3; ++i) EXPECT_NEAR(observed.lift(i, 1), linear(i, points.data() + 3 * i), 1e-12);
}

TEST(Observe, ImpossiblePlacesAreNamedWithTheNearestDof) {
  const SeparatedModel model = model_with_linear_lift(Form::tree, true);
  const std::vector<double> outside{0.04, 0.05, 0.06, 0.5, 0.0, 0.0};
  const std::vector<std::int64_t> components{0, 1};
  const std::string message = message_of<DataError>([&] { (void)observe(model, {outside, components}); });
  EXPECT_THAT(message, HasSubstr("M.h5: observation 1 (y component at (0.5, 0, 0)) is outside the mesh"));
  EXPECT_THAT(message, HasSubstr("the nearest dof of that component is 7 at (0.2, 0, 0.01"));
  const SeparatedModel meshless = model_with_linear_lift(Form::tree, false);
  EXPECT_THAT(
      message_of<DataError>([&] {
        (void)observe(meshless, {outside, components});
      }),
      HasSubstr("observation 0 (x component at (0.04, 0.05, 0.06)) is at no dof, and the model has no mesh"));
  const std::vector<std::int64_t> wrong{0, 5};
  EXPECT_THAT(message_of<DataError>([&] {
                (void)observe(model, {outside, wrong});
              }),
              HasSubstr("observation 1 has component 5"));
  const std::vector<double> few{0.0};
  EXPECT_THAT(message_of<DataError>([&] {
                (void)observe(model, {few, components});
              }),
              HasSubstr("1 coordinates"));
}

TEST(Observe, SnapshotsAreInterpolatedBySplinesWithoutCompression) {
  // A cubic in each parameter, random in space and time: splines are exact, no low rank is needed.
  const std::size_t dofs = 36;
  const std::vector<double> a = normal_values(dofs, 1), b = normal_values(dofs, 2);
  const auto field = [&](std::size_t dof, double t, std::span<const double> p) {
    return a[dof] * std::sin(t + b[dof]) + b[dof] * p[0] * p[0] * p[0] * (1 + t * p[1] * p[1]);
  };
  Snapshots snapshots = snapshots_of(field, two_axes(), {0.0, 1.0, 2.0}, dofs);
  snapshots.mesh = small_mesh();
  snapshots.dofs = dofs_on(*snapshots.mesh);
  const std::vector<double> points(snapshots.dofs.points.begin() + 3 * 10,
                                   snapshots.dofs.points.begin() + 3 * 12);
  const std::vector<std::int64_t> components{1, 2};  // dofs 10 and 11
  const ObservedModel observed = observe_snapshots(snapshots, {points, components});
  EXPECT_EQ(observed.functions->count(), 30);
  const std::vector<double> p{0.83, 1.44};
  for (std::size_t t = 0; t < 3; ++t) {
    const Eigen::VectorXd y = observed.predict(Eigen::Vector2d(p[0], p[1]), t);
    EXPECT_NEAR(y[0], field(10, snapshots.time[t], p), 1e-11);
    EXPECT_NEAR(y[1], field(11, snapshots.time[t], p), 1e-11);
  }
}

TEST(TimeInterpolation, IsExactForCubicsAndAtNodesToTheBit) {
  const std::vector<double> time = {0.1, 0.2, 0.45, 0.5, 0.9, 1.0};
  const auto cubic = [](double t) { return 2 - t + 3 * t * t - 4 * t * t * t; };
  for (const double at : {0.1, 0.13, 0.3, 0.45, 0.7, 0.99, 1.0}) {
    const TimeWeights w = interpolate_in_time(time, at);
    double value = 0, slope = 0;
    for (std::size_t k = 0; k < w.index.size(); ++k) {
      value += w.value[k] * cubic(time[w.index[k]]);
      slope += w.slope[k] * cubic(time[w.index[k]]);
    }
    EXPECT_NEAR(value, cubic(at), 1e-13);
    EXPECT_NEAR(slope, -1 + 6 * at - 12 * at * at, 1e-12);
  }
  for (std::size_t i = 0; i < time.size(); ++i) {
    const TimeWeights w = interpolate_in_time(time, time[i]);
    for (std::size_t k = 0; k < w.index.size(); ++k) EXPECT_EQ(w.value[k], w.index[k] == i ? 1.0 : 0.0);
  }
  const std::vector<double> two = {1, 3};
  EXPECT_THAT(interpolate_in_time(two, 2).value, ::testing::ElementsAre(0.5, 0.5));
}

TEST(ScalarObservations, AreTheModelsOutputsAndDifferencesInBothForms) {
  for (const Form form : {Form::canonical, Form::tree}) {
    ModelContents contents = random_contents(form);
    const std::size_t grid = contents.axes[0].nodes.size() * contents.axes[1].nodes.size();
    contents.outputs = {{"force", {"N", ""}, {}}};
    for (const double value : normal_values(grid * contents.time.size(), 5))
      contents.outputs[0].values.push_back(1e6 * value);
    const SeparatedModel model(contents);
    const std::vector<double> points(contents.dofs.points.begin(), contents.dofs.points.begin() + 3);
    const std::vector<std::int64_t> components = {0};
    const std::array<double, 3> from = {0, 0, 0}, to = {0.1, 0, 0.005};  // corners of the small mesh
    const std::vector<ScalarObservation> sensors = {{"force", "force", {}, {}, {}},
                                                    ScalarObservation::elongation("gauge", from, to, true)};
    const ObservedModel both = with_scalars(observe(model, {points, components}), model, sensors);
    const std::vector<double> p = {0.83, 1.17};
    const std::vector<std::size_t> dofs = {0, 2, 3, 5};
    const auto force = model.evaluate_output("force", p).value;
    for (std::size_t t = 0; t < contents.time.size(); ++t) {
      const Eigen::VectorXd y = both.predict(Eigen::Vector2d(p[0], p[1]), t);
      const auto u = model.evaluate(p, t, dofs).value;
      EXPECT_NEAR(y[0], u[0], 1e-12 * std::abs(u[0]) + 1e-15);
      EXPECT_NEAR(y[1], force[t], 1e-5 * 1e6);
      const double square = 0.1 * 0.1 + 0.005 * 0.005;
      EXPECT_NEAR(y[2], ((u[2] - u[0]) * 0.1 + (u[3] - u[1]) * 0.005) / square,
                  1e-10 * std::abs(y[2]) + 1e-12);
    }
  }
  const SeparatedModel model(random_contents(Form::tree));
  const std::vector<ScalarObservation> unknown = {{"forze", "forze", {}, {}, {}}};
  const std::vector<std::size_t> none = {0};
  EXPECT_THAT(message_of<UsageError>([&] { (void)with_scalars(observe_dofs(model, none), model, unknown); }),
              HasSubstr("has no output \"forze\""));
}

/// Of a displacement with all terms up to the third degree: the plane's slope is the derivative at the centre
/// and, of the cubic terms, what the mean squares over the window give (h²/5 of x³ / h², h²/3 of x y² / h²).
TEST(ScalarObservations, AStrainInAWindowIsTheSlopeOfThePlaneThatFitsBest) {
  const std::array<double, 3> at = {0.4, -0.2, 0.1};
  constexpr double k_window = 0.02, k_half = k_window / 2;
  const auto displacement = [&](std::int64_t component, const double* point) {
    const double x = point[0] - at[0], y = point[1] - at[1], z = point[2] - at[2];
    if (component == 0)
      return 7 + 3 * x - 5 * y + 40 * x * y - 30 * y * y + 2e4 * x * x * x + 1e4 * x * y * y + z;
    if (component == 1) return 2 - 4 * y + 6 * x + 25 * x * x - 35 * x * y;
    return 1 + 8 * z + 11 * x - 2 * y;
  };
  const auto strain = [&](std::array<int, 2> axes) {
    const auto sensor = ScalarObservation::strain_in_window("s", at, k_window, axes);
    double sum = 0;
    for (std::size_t k = 0; k < sensor.coefficients.size(); ++k) {
      EXPECT_LE(std::abs(sensor.points[3 * k] - at[0]), k_half);
      sum += sensor.coefficients[k] * displacement(sensor.components[k], &sensor.points[3 * k]);
    }
    return sum;
  };
  const double square = k_half * k_half;
  EXPECT_NEAR(strain({0, 0}), 3 + 2e4 * 3 * square / 5 + 1e4 * square / 3, 0.03 * 2e4 * square);
  EXPECT_NEAR(strain({1, 1}), -4, 1e-10);
  EXPECT_NEAR(strain({2, 2}), 8, 1e-10);
  EXPECT_NEAR(strain({0, 1}), 0.5 * (-5 + 6), 1e-10);
  EXPECT_NEAR(strain({0, 2}), 0.5 * (1 + 11), 1e-10);
  EXPECT_NEAR(strain({1, 2}), 0.5 * (0 - 2), 1e-10);
  EXPECT_THAT(message_of<UsageError>([&] {
                (void)ScalarObservation::strain_in_window("s", at, 0, {0, 0});
              }),
              HasSubstr("its window has no width"));
}

}  // namespace
}  // namespace knothe::model
