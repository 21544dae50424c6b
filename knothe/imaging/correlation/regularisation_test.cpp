// Regularisation, references that are replaced, and meshes from files: what it takes where one reference and
// equal elements do not do.
#include "knothe/imaging/correlation/regularisation.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "knothe/base/error.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/testing/test_folder.hpp"
#include "knothe/imaging/correlation/image_correlation.hpp"
#include "knothe/imaging/mesh/mesh_file.hpp"
#include "knothe/imaging/series/picture_series.hpp"
#include "knothe/imaging/series/speckle.hpp"

namespace knothe::imaging {
namespace {

using ::testing::HasSubstr;
constexpr double k_pi = std::numbers::pi;

Eigen::VectorXd nodal(const ImageMesh& mesh, const DisplacementField& field) {
  Eigen::VectorXd u(2 * mesh.node_count());
  for (int a = 0; a < mesh.node_count(); ++a) {
    const auto d = field(mesh.x[static_cast<std::size_t>(a)], mesh.y[static_cast<std::size_t>(a)]);
    u[2 * a] = d.u, u[2 * a + 1] = d.v;
  }
  return u;
}

/// v = A sin(2π x / λ): a shear wave; with `pressure` u instead.
DisplacementField wave(double amplitude, double length, bool pressure = false) {
  return [=](double x, double) {
    const double k = 2 * k_pi / length, value = amplitude * std::sin(k * x),
                 slope = amplitude * k * std::cos(k * x);
    return pressure ? Displacement{value, 0, {slope, 0, 0, 0}} : Displacement{0, value, {0, 0, slope, 0}};
  };
}
/// Pure bending in plane stress, an exact elastic field.
DisplacementField bending(double curvature, double poisson_ratio) {
  return [=](double x, double y) {
    const double dx = x - 160, dy = y - 128;
    return Displacement{curvature * dx * dy,
                        -0.5 * curvature * (dx * dx + poisson_ratio * dy * dy),
                        {curvature * dy, curvature * dx, -curvature * dx, -curvature * poisson_ratio * dy}};
  };
}

TEST(Regularisation, PenaltiesAreThoseOfWavesAndNothingForElasticFields) {
  const ImageMesh mesh = structured_mesh({0, 0, 320, 256}, 8);
  const std::vector<char> all(mesh.elements.size(), 1);
  const double length = 160, k = 2 * k_pi / length, area = 320.0 * 256, mean_square = 0.5 * area;
  const auto energy = [&](const Eigen::SparseMatrix<double>& r, const DisplacementField& field) {
    const Eigen::VectorXd u = nodal(mesh, field);
    return u.dot(r * u);
  };
  EXPECT_NEAR(energy(gradient_penalty(mesh), wave(1, length)) / (k * k * mean_square), 1, 0.02);
  const auto gap = equilibrium_gap_penalty(mesh, all, 0.2);
  // Without the nodes at the edge, which have no equation: 30 of 32 rows of elements, nearly.
  EXPECT_NEAR(energy(gap, wave(1, length)) / (std::pow(k, 4) * mean_square), 31.0 / 32, 0.04);
  EXPECT_NEAR(energy(gap, wave(1, length, true)) / (std::pow(2 / 0.8, 2) * std::pow(k, 4) * mean_square),
              31.0 / 32, 0.04);
  EXPECT_NEAR(energy(gap, bending(1e-4, 0.2)), 0, 1e-18 * area);
  EXPECT_GT(energy(gap, bending(1e-4, -0.4)), 1e-12 * area);  // of another material: not in equilibrium
  // An element taken out carries nothing, and its nodes have no equation.
  std::vector<char> holed = all;
  holed[500] = 0;
  const auto with_hole = equilibrium_gap_penalty(mesh, holed, 0.2);
  for (const int node : mesh.elements[500]) {
    Eigen::VectorXd u = Eigen::VectorXd::Zero(2 * mesh.node_count());
    u[2 * node] = 1;
    EXPECT_LT((with_hole * u).dot(u), (gap * u).dot(u));
  }
}

TEST(Regularisation, DampsAShearWaveByItsTransferFunctionAndLeavesBendingAlone) {
  const SpecklePattern pattern({.width = 320, .height = 256});
  const auto reference = pattern.render();
  const ImageMesh mesh = structured_mesh({20, 20, 300, 236}, 12);
  const double length = 93.3;  // three periods in the region
  const auto amplitude = [&](const Eigen::VectorXd& u) {
    double sum = 0, squares = 0;
    for (int a = 0; a < mesh.node_count(); ++a) {
      const auto i = static_cast<std::size_t>(a);
      if (mesh.x[i] < 60 || mesh.x[i] > 260 || mesh.y[i] < 60 || mesh.y[i] > 196) continue;
      const double s = std::sin(2 * k_pi * mesh.x[i] / length);
      sum += s * u[2 * a + 1], squares += s * s;
    }
    return sum / squares;
  };
  const auto deformed = pattern.render(wave(0.4, length)), bent_picture = pattern.render(bending(4e-5, 0.2));
  for (const double ratio : {0.7, 1.0, 1.4}) {
    ImageCorrelation correlation(reference, mesh,
                                 {.regularisation = ratio * length,
                                  .regularisation_kind = DisplacementRegularisation::mechanical,
                                  .reject_elements = false});
    const auto result = correlation.correlate(deformed);
    ASSERT_TRUE(result.converged) << result.message;
    // The nodes of a projection overshoot, by 3/(2 + cos kh) c; bilinear elements have c k² for k².
    const double kh = 2 * k_pi / length * (mesh.x[1] - mesh.x[0]), c = 2 * (1 - std::cos(kh)) / (kh * kh);
    const double free = 0.4 * 3 / (2 + std::cos(kh)) * c;
    EXPECT_NEAR(amplitude(result.unregularised) / free, 1, 0.02) << ratio;  // the data of a likelihood
    EXPECT_NEAR(amplitude(result.displacement) / free, 1 / (1 + c * c * std::pow(ratio, 4)), 0.04) << ratio;
    const auto bent = correlation.correlate(bent_picture);
    ASSERT_TRUE(bent.converged) << bent.message;
    const double error = (bent.displacement - nodal(mesh, bending(4e-5, 0.2))).norm(),
                 free_error = (bent.unregularised - nodal(mesh, bending(4e-5, 0.2))).norm();
    EXPECT_LT(error, free_error) << ratio;  // and of 0.6 px nothing is lost
    EXPECT_LT(error / std::sqrt(2.0 * mesh.node_count()), 0.005) << ratio;
  }
}

TEST(Regularisation, ItsCovarianceIsThatOfManyPictures) {
  const SpecklePattern pattern({.width = 128, .height = 112});
  const ImageMesh mesh = structured_mesh({12, 12, 116, 100}, 16);
  constexpr int k_pictures = 30;
  constexpr double k_noise = 2;
  const auto picture = [&](unsigned seed) {
    return pattern.render({}, {.noise = k_noise, .quantise = false, .seed = seed});
  };
  for (const auto kind : {DisplacementRegularisation::tikhonov, DisplacementRegularisation::mechanical}) {
    double squares = 0, predicted = 0, normalised = 0;
    for (unsigned k = 0; k < k_pictures; ++k) {
      ImageCorrelation correlation(picture(1000 + k), mesh,
                                   {.brightness = Brightness::none,
                                    .regularisation = 60,
                                    .regularisation_kind = kind,
                                    .reject_elements = false});
      const auto result = correlation.correlate(picture(k), Eigen::VectorXd::Zero(2 * mesh.node_count()));
      ASSERT_TRUE(result.converged) << result.message;
      squares += result.displacement.squaredNorm();
      predicted += correlation.displacement_std(result.element_valid, k_noise).squaredNorm();
      const auto precision = correlation.precision(result.element_valid, k_noise);
      normalised += result.unregularised.dot(precision * result.unregularised);
      if (k == 0) {
        const ImageCorrelation without(picture(1000), mesh, {.brightness = Brightness::none});
        EXPECT_LT(correlation.displacement_std(result.element_valid, k_noise).mean(),
                  0.8 * without.displacement_std(result.element_valid, k_noise).mean());
      }
    }
    EXPECT_NEAR(squares / predicted, 1, 0.1);
    EXPECT_NEAR(normalised / (k_pictures * 2.0 * mesh.node_count()), 1, 0.1);
    RecordProperty(kind == DisplacementRegularisation::tikhonov ? "tikhonov" : "mechanical",
                   std::to_string(squares / predicted) + " " +
                       std::to_string(normalised / (k_pictures * 2.0 * mesh.node_count())));
  }
}

/// A series whose references are in a folder, its pictures in memory.
PictureSeries series_of(const files::TestFolder& folder, const files::Picture& reference, double update) {
  files::write_tiff(folder.file("reference.tif"), reference);
  SeriesOptions options;
  options.references = {folder.file("reference.tif")};
  options.region = Region{110, 90, 210, 170};
  options.element_size = 20;
  options.correlation.threads = 1;
  options.reference_update = update;
  return PictureSeries(std::move(options));
}

/// The first reference follows it as well. The other one is taken wherever it leaves less.
TEST(ReferenceUpdate, FollowsATurnFromReferenceToReference) {
  const SpecklePattern pattern({.width = 320, .height = 260});
  const auto turn = [](double degrees) {
    const double c = std::cos(degrees * k_pi / 180) - 1, s = std::sin(degrees * k_pi / 180);
    return [=](double x, double y) {
      const double dx = x - 160, dy = y - 130;
      return Displacement{c * dx - s * dy, s * dx + c * dy, {c, -s, s, c}};
    };
  };
  const files::TestFolder folder;
  PictureSeries fixed = series_of(folder, pattern.render({}, {.noise = 2, .seed = 99}), 0),
                updated = series_of(folder, pattern.render({}, {.noise = 2, .seed = 99}), 1.001);
  PictureResult last_fixed, last;
  for (int k = 1; k <= 24; ++k) {
    const auto picture = pattern.render(turn(3.0 * k), {.noise = 2, .seed = static_cast<unsigned>(k)});
    last_fixed = fixed.correlate(picture, fmt::format("p{}", k));
    last = updated.correlate(picture, fmt::format("p{}", k));
    ASSERT_FALSE(last.missing) << k << ": " << last.message;
    ASSERT_FALSE(last_fixed.missing) << k << ": " << last_fixed.message;
  }
  EXPECT_EQ(last_fixed.reference, "");
  EXPECT_THAT(last.reference, HasSubstr("p"));
  const ImageMesh& mesh = updated.correlation().mesh();
  const Eigen::VectorXd error = last.correlation.displacement - nodal(mesh, turn(72));
  const Eigen::VectorXd std = updated.precision(last, 2).std;
  const double rms = std::sqrt(error.squaredNorm() / static_cast<double>(error.size()));
  const double normalised =
      std::sqrt(error.cwiseQuotient(std).squaredNorm() / static_cast<double>(error.size()));
  RecordProperty("rms_px", std::to_string(rms));
  RecordProperty("over_std", std::to_string(normalised));
  const Eigen::VectorXd fixed_error = last_fixed.correlation.displacement - nodal(mesh, turn(72));
  EXPECT_LT(std::sqrt(fixed_error.squaredNorm() / static_cast<double>(error.size())), 0.05);
  EXPECT_LT(rms, 0.05);
  EXPECT_LT(normalised, 1.3);   // the stated deviation is not less than the error …
  EXPECT_GT(normalised, 0.25);  // … and more, since the references' noise partly cancels
}

TEST(ReferenceUpdate, FollowsAPatternThatIsReplacedLittleByLittle) {
  const SpecklePattern before({.width = 320, .height = 260, .seed = 1}),
      after({.width = 320, .height = 260, .seed = 2});
  const auto shift = [](double t) {
    return [=](double, double) { return Displacement{1.2 * t, -0.7 * t, {}}; };
  };
  const auto picture = [&](double share, double t, unsigned seed) {
    auto p = before.render(shift(t), {.noise = 2, .seed = seed});
    const auto q = after.render(shift(t), {.seed = seed});
    for (std::size_t i = 0; i < p.pixels.size(); ++i)
      p.pixels[i] += static_cast<float>(share) * (q.pixels[i] - p.pixels[i]);
    return p;
  };
  const files::TestFolder folder;
  PictureSeries fixed = series_of(folder, picture(0, 0, 99), 0),
                updated = series_of(folder, picture(0, 0, 99), 1.3);
  PictureResult last;
  for (int k = 0; k <= 8; ++k) {
    last = updated.correlate(picture(k / 8.0, k, static_cast<unsigned>(k)), fmt::format("p{}", k));
    ASSERT_FALSE(last.missing) << k << ": " << last.message;
  }
  // Even from the right place on, the first reference has nothing in common with the last picture.
  const ImageMesh& mesh = updated.correlation().mesh();
  CorrelationResult right;
  right.displacement = nodal(mesh, shift(8));
  fixed.resume(0, right);
  EXPECT_TRUE(fixed.correlate(picture(1, 8, 8), "p8").missing);
  const Eigen::VectorXd error = last.correlation.displacement - nodal(mesh, shift(8));
  const double rms = std::sqrt(error.squaredNorm() / static_cast<double>(error.size()));
  RecordProperty("rms_px", std::to_string(rms));
  EXPECT_LT(rms, 2);  // of 11 px: an eighth of the pattern lost in each picture is no white noise
}

TEST(ReferenceUpdate, DoesNotGoWithACrackOrAResumedSeries) {
  const files::TestFolder folder;
  const SpecklePattern pattern({.width = 320, .height = 260});
  PictureSeries series = series_of(folder, pattern.render(), 2);
  EXPECT_THAT(files::message_of<UsageError>([&] { series.resume(0, {}); }), "");
  SeriesOptions options = series.options();
  options.crack = CrackSearchOptions{};
  EXPECT_THAT(files::message_of<UsageError>([&] { const PictureSeries refused(options); }),
              HasSubstr("cannot be combined with another reference"));
}

/// The region in general quadrilaterals, as Gmsh 2.2 writes them; coordinates times `scale`, y times `up`.
std::string distorted_gmsh(double scale, double up, double z = 0) {
  const ImageMesh grid = structured_mesh({40, 40, 280, 216}, 24);
  std::string text = fmt::format("$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{}\n", grid.node_count());
  for (int a = 0; a < grid.node_count(); ++a) {
    const auto i = static_cast<std::size_t>(a);
    const bool edge = grid.x[i] < 41 || grid.x[i] > 279 || grid.y[i] < 41 || grid.y[i] > 215;
    const double x = grid.x[i] + (edge ? 0 : 4 * std::sin(1.7 * a)),
                 y = grid.y[i] + (edge ? 0 : 4 * std::cos(2.3 * a));
    text += fmt::format("{} {} {} {}\n", a + 1, scale * x, scale * up * y, a == 0 ? z : 0);
  }
  text += fmt::format("$EndNodes\n$Elements\n{}\n", grid.element_count());
  for (int e = 0; e < grid.element_count(); ++e) {
    const auto& n = grid.elements[static_cast<std::size_t>(e)];
    text += fmt::format("{} 3 2 1 1 {} {} {} {}\n", e + 1, n[0] + 1, n[1] + 1, n[2] + 1, n[3] + 1);
  }
  return text + "$EndElements\n";
}

TEST(MeshFile, AFileOfGeneralQuadrilateralsMeasuresAsExactlyAsRectangles) {
  const files::TestFolder folder;
  files::write_text_atomically(folder.file("px.msh"), distorted_gmsh(1, 1));
  files::write_text_atomically(folder.file("m.msh"), distorted_gmsh(0.25, -1));
  files::write_text_atomically(folder.file("thick.msh"), distorted_gmsh(1, 1, 5));
  const ImageMesh mesh = read_image_mesh(folder.file("px.msh"), std::nullopt);
  const ImageMesh scaled = read_image_mesh(folder.file("m.msh"), picture_frame(0.25, {0, 0}));
  ASSERT_EQ(scaled.node_count(), mesh.node_count());
  for (std::size_t a = 0; a < mesh.x.size(); ++a)
    EXPECT_NEAR(std::hypot(scaled.x[a] - mesh.x[a], scaled.y[a] - mesh.y[a]), 0, 1e-5);
  EXPECT_THAT(
      files::message_of<DataError>([&] { (void)read_image_mesh(folder.file("thick.msh"), std::nullopt); }),
      HasSubstr("z of the mesh goes from 0 to 5: a mesh in pixels is plane"));
  auto elsewhere = picture_frame(0.25, {0, 0});
  elsewhere.plane = 7;
  EXPECT_THAT(
      files::message_of<DataError>([&] { (void)read_image_mesh(folder.file("thick.msh"), elsewhere); }),
      HasSubstr("none of the mesh's elements lies in the plane z = 7 m"));
  const SpecklePattern pattern({.width = 320, .height = 256});
  const auto field = bending(6e-5, 0.2);
  for (const ImageMesh& on : {mesh, triangulated(mesh), structured_mesh({40, 40, 280, 216}, 24)}) {
    ImageCorrelation correlation(pattern.render(), on);
    const auto result = correlation.correlate(pattern.render(field));
    ASSERT_TRUE(result.converged) << result.message;
    EXPECT_EQ(result.elements_rejected, 0);
    const Eigen::VectorXd error = result.displacement - nodal(on, field);
    EXPECT_LT(std::sqrt(error.squaredNorm() / static_cast<double>(error.size())), 0.01);
  }
}

}  // namespace
}  // namespace knothe::imaging
