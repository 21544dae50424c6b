#include "knothe/imaging/mesh/mesh_field.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "knothe/imaging/correlation/image_correlation.hpp"
#include "knothe/imaging/crack/strain.hpp"

namespace knothe::imaging {
namespace {

/// A plate of 8 × 4 elements of 30 px with a notch below, as a mesh of its own.
ImageMesh notched_plate() {
  ImageMesh mesh = structured_mesh({30.25, 24.5, 270.25, 144.5}, 30);
  mesh.elements.erase(mesh.elements.begin() + 3 * 8 + 4);
  return mesh;
}

/// Bending, and a jump over the column of elements above the notch.
Eigen::VectorXd cracked(const ImageMesh& mesh) {
  Eigen::VectorXd u(2 * mesh.node_count());
  for (int a = 0; a < mesh.node_count(); ++a) {
    const double x = mesh.x[static_cast<std::size_t>(a)] - 150,
                 y = mesh.y[static_cast<std::size_t>(a)] - 84.5;
    u[2 * a] = 0.3 + (x > 10 ? 0.012 : -0.012) * (y + 30);
    u[2 * a + 1] = 1.1 - 5e-5 * x * x;
  }
  return u;
}

TEST(NodalStrain, OfALinearFieldIsExactAndZeroWhereNothingIsMeasured) {
  for (const ElementShape shape : {ElementShape::quadrilateral, ElementShape::triangle}) {
    const ImageMesh mesh = structured_mesh({10, 20, 130, 100}, 20, shape);
    Eigen::VectorXd u(2 * mesh.node_count());
    for (int a = 0; a < mesh.node_count(); ++a) {
      const double x = mesh.x[static_cast<std::size_t>(a)], y = mesh.y[static_cast<std::size_t>(a)];
      u.segment<2>(2 * a) << 3 + 0.004 * x - 0.002 * y, -1 + 0.006 * x - 0.001 * y;
    }
    std::vector<char> valid(mesh.elements.size(), 1);
    // The first corner's elements are out: it has no strain, the others keep theirs.
    for (std::size_t e = 0; e < mesh.elements.size(); ++e)
      for (const int node : mesh.elements[e])
        if (node == 0) valid[e] = 0;
    const Eigen::MatrixXd strain = nodal_strains(mesh, u, valid);
    ASSERT_EQ(strain.rows(), mesh.node_count());
    EXPECT_EQ(strain.row(0).cwiseAbs().maxCoeff(), 0);
    for (int a = mesh.node_count() / 2; a < mesh.node_count(); ++a) {
      EXPECT_NEAR(strain(a, 0), 0.004, 1e-12);
      EXPECT_NEAR(strain(a, 1), -0.001, 1e-12);
      EXPECT_NEAR(strain(a, 2), 0.5 * (-0.002 + 0.006), 1e-12);
    }
  }
}

TEST(MeshField, IsTheFieldOfItsNodesAndItsGradient) {
  MeshField field(notched_plate());
  const Eigen::VectorXd u = cracked(field.mesh());
  field.set(u);
  for (int a = 0; a < field.mesh().node_count(); ++a) {
    const auto d =
        field.at(field.mesh().x[static_cast<std::size_t>(a)], field.mesh().y[static_cast<std::size_t>(a)]);
    EXPECT_NEAR(d.u, u[2 * a], 1e-9);
    EXPECT_NEAR(d.v, u[2 * a + 1], 1e-9);
  }
  const double h = 1e-4;
  for (const double x : {47.0, 158.0, 222.0})
    for (const double y : {40.0, 66.0}) {
      const auto d = field.at(x, y), right = field.at(x + h, y), left = field.at(x - h, y),
                 lower = field.at(x, y + h), upper = field.at(x, y - h);
      EXPECT_NEAR(d.gradient[0], (right.u - left.u) / (2 * h), 1e-8);
      EXPECT_NEAR(d.gradient[1], (lower.u - upper.u) / (2 * h), 1e-8);
      EXPECT_NEAR(d.gradient[2], (right.v - left.v) / (2 * h), 1e-8);
      EXPECT_NEAR(d.gradient[3], (lower.v - upper.v) / (2 * h), 1e-8);
    }
}

TEST(MeshField, BeyondTheOutlineItGoesOn) {
  MeshField field(notched_plate());
  field.set(cracked(field.mesh()));
  EXPECT_NEAR(field.at(100, 144.5).v, field.at(100, 148).v, 1e-3);
  EXPECT_EQ(field.at(100, 300).v, 0);
  EXPECT_EQ(field.body(100, 100), 1);
  EXPECT_EQ(field.body(165, 130), 0);  // in the notch
  EXPECT_NEAR(field.body(100, 144.5), 0.5, 1e-6);
}

TEST(MeshField, CorrelationOnTheSameMeshFindsTheNodesThatDrewThePicture) {
  MeshField field(notched_plate());
  const Eigen::VectorXd exact = cracked(field.mesh());
  const SpecklePattern pattern({.width = 300, .height = 180});
  const auto body = [&](double x, double y) { return field.body(x, y); };
  const auto reference = pattern.render({}, {.quantise = false}, 1, body);
  field.set(exact);
  const auto moved =
      pattern.render([&](double x, double y) { return field.at(x, y); }, {.quantise = false}, 1, body);
  ImageCorrelation correlation(reference, field.mesh(), {}, without_outline(field, 300, 180, 4));
  const auto result = correlation.correlate(moved);
  ASSERT_TRUE(result.converged) << result.message;
  EXPECT_EQ(result.elements_rejected, 0);
  const Eigen::VectorXd error = result.displacement - exact;
  EXPECT_LT(error.cwiseAbs().maxCoeff(), 0.005);
  EXPECT_LT(std::sqrt(error.squaredNorm() / static_cast<double>(error.size())), 0.001);
  RecordProperty("largest_px", std::to_string(error.cwiseAbs().maxCoeff()));
  RecordProperty("rms_px",
                 std::to_string(std::sqrt(error.squaredNorm() / static_cast<double>(error.size()))));
  RecordProperty("mean_u", std::to_string(Eigen::Map<const Eigen::VectorXd, 0, Eigen::InnerStride<2>>(
                                              error.data(), error.size() / 2)
                                              .mean()));
  RecordProperty("mean_v", std::to_string(Eigen::Map<const Eigen::VectorXd, 0, Eigen::InnerStride<2>>(
                                              error.data() + 1, error.size() / 2)
                                              .mean()));
}

}  // namespace
}  // namespace knothe::imaging
