// Shape and motion of drawn surfaces that are known exactly, and of a real pair.
#include "knothe/imaging/stereo/stereo_surface.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <filesystem>
#include <random>

#include "knothe/base/error.hpp"
#include "knothe/base/testing/long_form.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/testing/recorded_data.hpp"
#include "knothe/files/testing/test_folder.hpp"
#include "knothe/imaging/correlation/correlation_noise.hpp"
#include "knothe/imaging/stereo/calibration_error.hpp"
#include "knothe/imaging/stereo/drawn_view.hpp"
#include "knothe/imaging/stereo/stereo_pose.hpp"

namespace knothe::imaging {
namespace {

constexpr double k_mm_per_px = 0.1;

/// Two cameras 25° apart, 1 m from a surface of 0.1 mm per px, with distortion of up to 2 px.
std::vector<Camera> two_cameras(int width, int height) {
  std::vector<Camera> cameras(2);
  for (Index c = 0; c < 2; ++c) {
    Camera& camera = cameras[c];
    camera.fx = 10000, camera.fy = 10010, camera.skew = 0.4;
    camera.cx = width / 2.0 + 3.0 * c, camera.cy = height / 2.0 - 2.0 * c;
    camera.radial = {c == 0 ? -40.0 : 30.0, 2000, 0, 0, 0, 0}, camera.tangential = {0.002, -0.003};
    camera.rotation = rotation_of_angles(1.0 - c, c == 0 ? 12.5 : -12.5, 0.5 * c);
    camera.translation << 0.2, -0.1, 1000;
  }
  return cameras;
}

/// A surface with `motion`, drawn by both cameras.
struct Scene {
  int width = 200, height = 170;
  double curvature = 0;  ///< 1/mm
  std::vector<Camera> cameras = two_cameras(width, height);
  SpecklePattern pattern{{.width = width, .height = height, .margin = 120}};

  [[nodiscard]] Eigen::Vector3d place(double s, double t) const {
    const double x = k_mm_per_px * (s - width / 2.0), y = k_mm_per_px * (t - height / 2.0);
    return {x, y, 0.5 * curvature * x * x + 0.05 * y};
  }
  using Motion = std::function<Eigen::Vector3d(const Eigen::Vector3d&)>;
  [[nodiscard]] std::vector<files::Picture> draw(const Motion& motion) const {
    std::vector<files::Picture> pictures;
    for (const Camera& camera : cameras)
      pictures.push_back(drawn_view(camera, width, height, pattern, [&](double s, double t) {
        const Eigen::Vector3d x = place(s, t);
        return Eigen::Vector3d(x + motion(x));
      }));
    return pictures;
  }
  [[nodiscard]] std::vector<files::Picture> reference() const {
    return draw([](const auto&) { return Eigen::Vector3d::Zero(); });
  }
};

files::Picture noisy(files::Picture picture, double std, unsigned seed) {
  std::mt19937_64 generator(seed);
  std::normal_distribution<float> noise(0, static_cast<float>(std));
  for (float& pixel : picture.pixels) pixel += noise(generator);
  return picture;
}

/// What the cameras measure between two sets of pictures, for noise γ (0: of the residual).
std::vector<CameraMotion> motions_of(const StereoSurface& surface, const std::vector<files::Picture>& before,
                                     const std::vector<files::Picture>& after, double gamma) {
  std::vector<CameraMotion> motions;
  for (Index c = 0; c < std::ssize(before); ++c) {
    ImageCorrelation correlation(before[c], surface.meshes[c], {.brightness = Brightness::none});
    const auto r = correlation.correlate(after[c], Eigen::VectorXd::Zero(2 * surface.points.cols()));
    EXPECT_TRUE(r.converged) << r.message;
    const double noise = gamma > 0 ? gamma : noise_from_residual(correlation, r);
    motions.push_back({r.displacement, displacement_precision(correlation, r.element_valid, noise).matrix,
                       measured_nodes(surface.meshes[c], r.element_valid)});
  }
  return motions;
}

const ImageMesh& mesh_of_scene() {
  static const ImageMesh mesh = structured_mesh({25, 25, 172, 142}, 25);
  return mesh;
}

TEST(StereoSurface, ShapeAndMotionAreThoseDrawn) {
  for (const double curvature : {0.0, 0.01}) {
    Scene scene;
    scene.curvature = curvature;
    const auto before = scene.reference();
    const StereoSurface surface = find_surface(scene.cameras, before, mesh_of_scene());
    ASSERT_GE(surface.points.cols(), 30);
    EXPECT_LT(surface.epipolar_rms, 0.02);
    for (Index a = 0; a < surface.points.cols(); ++a) {
      const Eigen::Vector3d x = surface.points.col(a);
      EXPECT_NEAR(x.z(), 0.5 * curvature * x.x() * x.x() + 0.05 * x.y(), 0.02) << x.transpose();  // mm
    }
    const Eigen::Matrix3d turn = Eigen::AngleAxisd(0.01, Eigen::Vector3d(1, -2, 1).normalized()).matrix();
    const auto motion = [&](const Eigen::Vector3d& x) -> Eigen::Vector3d {
      return turn * x - x + Eigen::Vector3d(0.037, -0.021, 0.18);
    };
    const SurfaceMotion found =
        surface_motion(scene.cameras, surface, motions_of(surface, before, scene.draw(motion), 1));
    Eigen::Vector3d bias = Eigen::Vector3d::Zero();
    for (Index a = 0; a < surface.points.cols(); ++a) {
      const Eigen::Vector3d e = found.displacement.segment<3>(3 * a) - motion(surface.points.col(a));
      bias += e / surface.points.cols();
      EXPECT_LT(e.norm(), 0.01 * k_mm_per_px * 5) << e.transpose();
    }
    EXPECT_LT(bias.cwiseAbs().maxCoeff(), 0.005 * k_mm_per_px) << bias.transpose();
    EXPECT_LT(found.epipolar_rms, 0.01);
    RecordProperty("bias_um", std::to_string(1000 * bias.cwiseAbs().maxCoeff()));
  }
}

TEST(StereoSurface, AMillimetreTowardsTheCamerasIsNoStrain) {
  const Scene scene;
  const auto before = scene.reference();
  const StereoSurface surface = find_surface(scene.cameras, before, mesh_of_scene());
  const auto after = scene.draw([](const auto&) { return Eigen::Vector3d(0, 0, -1); });
  const auto motions = motions_of(surface, before, after, 1);
  const SurfaceMotion found = surface_motion(scene.cameras, surface, motions);
  // Mean strain along x: the slope of u over x, by least squares; of one camera, of its px.
  const auto slope = [&](const auto& x, const auto& u) {
    double mean = 0, xx = 0, xu = 0;
    for (Index a = 0; a < surface.points.cols(); ++a) mean += x(a) / surface.points.cols();
    for (Index a = 0; a < surface.points.cols(); ++a)
      xx += (x(a) - mean) * (x(a) - mean), xu += (x(a) - mean) * u(a);
    return xu / xx;
  };
  const double seen = slope([&](Index a) { return surface.points(0, a); },
                            [&](Index a) { return found.displacement[3 * a]; }),
               one_camera = slope([&](Index a) { return surface.meshes[0].y[a]; },
                                  [&](Index a) { return motions[0].displacement[2 * a + 1]; });
  EXPECT_LT(std::abs(seen), 50e-6);
  EXPECT_NEAR(one_camera, 1e-3, 1e-4);
  RecordProperty("false_strain_microstrain", std::to_string(1e6 * seen));
}

/// The displacements of the nodes that fit best, at all pixels, the motion of elements that are bilinear on
/// the surface: what correlation without errors finds.
Eigen::VectorXd fitted_motion(const Camera& camera, const StereoSurface& surface, const ImageMesh& seen,
                              const Eigen::Matrix3Xd& u) {
  constexpr int k_size = 60;  // places a direction of each element
  const Index n = surface.points.cols();
  Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(n, n), right = Eigen::MatrixXd::Zero(n, 2);
  const PointLocator locator(seen);
  for (const auto& nodes : seen.elements)
    for (int i = 0; i < k_size; ++i)
      for (int j = 0; j < k_size; ++j) {
        const double s = (i + 0.5) / k_size, t = (j + 0.5) / k_size;
        const Eigen::Vector4d shape((1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t);
        Eigen::Vector3d x = Eigen::Vector3d::Zero(), moved = x;
        for (int a = 0; a < 4; ++a) {
          x += shape[a] * surface.points.col(nodes[a]);
          moved += shape[a] * (surface.points.col(nodes[a]) + u.col(nodes[a]));
        }
        const Eigen::Vector2d pixel = camera.project(x).pixel, d = camera.project(moved).pixel - pixel;
        const PointLocator::Place place = locator.find(pixel.x(), pixel.y());
        if (place.element < 0) continue;  // distortion bends the border
        for (int a = 0; a < 4; ++a) {
          const int node = seen.elements[place.element][a];
          right.row(node) += place.shape[a] * d.transpose();
          for (int b = 0; b < 4; ++b)
            normal(node, seen.elements[place.element][b]) += place.shape[a] * place.shape[b];
        }
      }
  const Eigen::MatrixXd best = normal.llt().solve(right);
  return best.transpose().reshaped();
}

TEST(StereoSurface, LargeElementsAreBilinearOnTheSurfaceAndNotInThePictures) {
  std::vector<Camera> cameras = two_cameras(600, 400);
  StereoSurface surface;
  surface.points.resize(3, 15);  // mm, 2 × 4 elements of 30 mm × 50 mm at 1 m
  std::vector<std::array<int, 4>> elements;
  for (int i = 0; i < 5; ++i)
    for (int j = 0; j < 3; ++j) {
      surface.points.col(3 * i + j) << 30.0 * i - 60, 50.0 * j - 50, 0.1 * i * j;
      if (i < 4 && j < 2) elements.push_back({3 * i + j, 3 * i + 3 + j, 3 * i + 4 + j, 3 * i + 1 + j});
    }
  std::mt19937_64 generator(5);
  std::normal_distribution<double> normal;
  Eigen::Matrix3Xd u(3, 15);  // mm: strains of 1 %
  for (double& value : u.reshaped()) value = 0.3 * normal(generator);
  std::vector<CameraMotion> motions;
  double least = 0, bias = 0;
  for (Camera& camera : cameras) {
    camera.fx = camera.fy = 2500, camera.radial = {-0.2, 0.1};
    const ImageMesh seen = seen_mesh(camera, surface.points, elements);
    surface.meshes.push_back(seen);
    const Eigen::VectorXd d = fitted_motion(camera, surface, seen, u);
    for (Index a = 0; a < 15; ++a) {
      const Eigen::Vector2d moved = camera.project(surface.points.col(a) + u.col(a)).pixel;
      bias = std::max(bias, (d.segment<2>(2 * a) + Eigen::Vector2d(seen.x[a], seen.y[a]) - moved).norm());
    }
    Eigen::SparseMatrix<double> precision(30, 30);
    precision.setIdentity();
    motions.push_back({d, precision, std::vector<char>(15, 1)});
  }
  const SurfaceMotion found = surface_motion(cameras, surface, motions);
  for (Index a = 0; a < 15; ++a)
    least = std::max(least, (found.displacement.segment<3>(3 * a) - u.col(a)).norm());
  EXPECT_GT(bias, 0.01);                                  // px, without the correction
  EXPECT_LT(least, 0.02 * bias / 2.5 / std::sin(0.218));  // mm, 2.5 px/mm
  EXPECT_LT(found.epipolar_rms, 0.02 * bias);
  RecordProperty("bias_px", std::to_string(bias));
  RecordProperty("left_mm", std::to_string(least));
}

TEST(StereoSurface, TheErrorsAreThoseOfThePrecision) {
  const Scene scene;
  const auto before = scene.reference();
  const Eigen::Vector3d motion(0.023, -0.041, 0.3);  // mm: parts of a px, so that noise is interpolated
  const auto after = scene.draw([&](const auto&) { return motion; });
  const StereoSurface surface = find_surface(scene.cameras, before, mesh_of_scene());
  const double noise = 2, count = test::long_form() ? 100 : 24;
  double errors = 0, misfit = 0, values = 0, redundancy = 0;
  for (unsigned k = 0; k < count; ++k) {
    std::vector<files::Picture> first, second;
    for (unsigned c = 0; c < 2; ++c) {
      first.push_back(noisy(before[c], noise, 1000 + 2 * k + c));
      second.push_back(noisy(after[c], noise, 5000 + 2 * k + c));
    }
    const SurfaceMotion found =
        surface_motion(scene.cameras, surface, motions_of(surface, first, second, noise));
    Eigen::VectorXd error = found.displacement;
    for (Index a = 0; a < surface.points.cols(); ++a) error.segment<3>(3 * a) -= motion;
    errors += error.dot(found.precision * error);
    values += found.displacement.size();
    misfit += found.chi_square, redundancy += found.redundancy;
  }
  const double tolerance =
      test::long_form() ? 0.05 : 0.1;  // 24 draws of 126 values: standard deviation 0.026
  EXPECT_NEAR(errors / values, 1, tolerance);
  EXPECT_NEAR(misfit / redundancy, 1, 2 * tolerance);
  RecordProperty("mean_over_values", std::to_string(errors / values));
  RecordProperty("chi_square_over_redundancy", std::to_string(misfit / redundancy));
}

/// What is measured of the scene by cameras that differ from those that took the pictures.
SurfaceMotion measured_by(const std::vector<Camera>& cameras, const std::vector<files::Picture>& before,
                          const std::vector<files::Picture>& after, double noise,
                          Eigen::MatrixXd* sensitivity = nullptr) {
  const StereoSurface surface = find_surface(cameras, before, mesh_of_scene());
  const auto motions = motions_of(surface, before, after, noise);
  SurfaceMotion found = surface_motion(cameras, surface, motions);
  if (sensitivity != nullptr) *sensitivity = calibration_sensitivity(cameras, surface, motions, found);
  return found;
}

std::vector<Camera> changed(std::vector<Camera> cameras, const Eigen::VectorXd& change) {
  for (Index c = 0; c < std::ssize(cameras); ++c)
    cameras[c] = cameras[c].changed(change.segment<k_camera_parameters>(k_camera_parameters * c));
  return cameras;
}

/// Standard deviations of a good calibration of the scene's cameras: px, 1, rad, mm.
Eigen::VectorXd calibration_std() {
  CameraChange one;
  one << 4, 4, 0.05, 0.05, 0.1, 0.5, 20, 0, 0, 0, 0, 1e-4, 1e-4, 5e-6, 5e-6, 5e-6, 0.005, 0.005, 0.2;
  return one.replicate<2, 1>();
}

TEST(CalibrationError, IsReadAsDeviationsOrAsACovariance) {
  const files::TestFolder folder;
  const std::string path = folder.file("std.csv");
  const auto read = [&](const std::string& text) {
    files::write_text_atomically(path, text);
    return read_calibration_error(path, 2, 1e-3);
  };
  const CalibrationError error = read("parameter,std\ncamera0.fx,4\ncamera1.tz,0.2\ncamera1.k1,0.5\n");
  EXPECT_EQ(error.names, (std::vector<std::string>{"camera0.fx", "camera1.tz", "camera1.k1"}));
  Eigen::MatrixXd wanted = Eigen::MatrixXd::Zero(2 * k_camera_parameters, 3);
  wanted(0, 0) = 4, wanted(2 * k_camera_parameters - 1, 1) = 0.2e-3, wanted(k_camera_parameters + 5, 2) = 0.5;
  EXPECT_EQ(error.factor, wanted);

  const CalibrationError both =
      read("parameter,camera0.fx,camera0.tz\ncamera0.fx,16,0.6\ncamera0.tz,0.6,0.04\n");
  EXPECT_EQ(both.names, (std::vector<std::string>{"calibration.1", "calibration.2"}));
  const Eigen::MatrixXd covariance = both.factor * both.factor.transpose();
  EXPECT_NEAR(covariance(0, 0), 16, 1e-12);
  EXPECT_NEAR(covariance(0, 18), 0.6e-3, 1e-15);
  EXPECT_NEAR(covariance(18, 18), 0.04e-6, 1e-18);
  EXPECT_NEAR(covariance.sum(), 16 + 1.2e-3 + 0.04e-6, 1e-12);

  for (const auto& [text, complaint] : std::vector<std::pair<std::string, std::string>>{
           {"parameter,std\ncamera0.fx,4\ncamera2.fx,4\n",
            "std.csv:3:1: error: column parameter: \"camera2.fx\" is no parameter of these 2 cameras (did "
            "you mean"},
           {"parameter,std\ncamera0.fx,4\ncamera0.fx,4\n", "camera0.fx is there twice"},
           {"parameter,std\ncamera0.fx,0\n", "a standard deviation is positive: leave out what is exact"},
           {"parameter,std\n", "it names no parameter"},
           {"parameter,camera0.fx\ncamera0.fx,16\ncamera0.fy,16\n", "column camera0.fy is missing"},
           {"parameter,camera0.fx,camera0.fy\ncamera0.fx,1,2\ncamera0.fy,2,1\n", "this is no covariance"},
           {"parameter,camera0.fx,camera0.fy\ncamera0.fx,1,0.5\ncamera0.fy,0,1\n",
            "this is no covariance"}}) {
    const std::string message = files::message_of<DataError>([&, &text = text] { (void)read(text); });
    EXPECT_NE(message.find(complaint), std::string::npos) << message;
  }
}

TEST(CalibrationError, TheSensitivityIsThatOfMeasuringWithOtherCameras) {
  Scene scene;
  scene.curvature = 0.01;
  const auto before = scene.reference(), after = scene.draw([](const Eigen::Vector3d&x) {
    return Eigen::Vector3d(0.1 + 1e-3 * x.y(), -0.05, -4 + 2e-3 * x.x());
  });
  Eigen::MatrixXd sensitivity;
  const SurfaceMotion found = measured_by(scene.cameras, before, after, 1, &sensitivity);
  const Eigen::VectorXd size = calibration_std();
  for (const int k : {0, 3, 4, 5, 12, 13, 15, 18, 19, 22, 33, 35}) {
    const Eigen::VectorXd step = 0.5 * size[k] * Eigen::VectorXd::Unit(2 * k_camera_parameters, k);
    const Eigen::VectorXd difference =
        measured_by(changed(scene.cameras, step), before, after, 1).displacement -
        measured_by(changed(scene.cameras, -step), before, after, 1).displacement;
    const Eigen::VectorXd predicted = sensitivity.col(k) * size[k];
    // 3e-4 mm in all are 0.0003 px a value: where the mesh moves on the pictures, correlation ends elsewhere.
    EXPECT_LT((difference - predicted).norm(), 0.05 * predicted.norm() + 3e-4)
        << k << ": " << predicted.norm() << ", " << difference.norm();
  }
}

TEST(CalibrationError, AnErrorDrawnFromItsCovarianceIsCovered) {
  const Scene scene;
  const Eigen::Vector3d motion(0.2, -0.1, -4);
  const auto before = scene.reference(), after = scene.draw([&](const auto&) { return motion; });
  const Eigen::VectorXd size = calibration_std();
  std::mt19937_64 generator(5);
  std::normal_distribution<double> normal;
  const double noise = 1, count = test::long_form() ? 100 : 12;
  double plain = 0, covered = 0, values = 0;
  for (unsigned k = 0; k < count; ++k) {
    Eigen::VectorXd change(size.size());
    for (Index i = 0; i < size.size(); ++i) change[i] = size[i] * normal(generator);
    std::vector<files::Picture> first, second;
    for (unsigned c = 0; c < 2; ++c) {
      first.push_back(noisy(before[c], noise, 1000 + 2 * k + c));
      second.push_back(noisy(after[c], noise, 5000 + 2 * k + c));
    }
    Eigen::MatrixXd sensitivity;
    const SurfaceMotion found =
        measured_by(changed(scene.cameras, change), first, second, noise, &sensitivity);
    Eigen::VectorXd error = found.displacement;
    for (Index a = 0; a < error.size() / 3; ++a) error.segment<3>(3 * a) -= motion;
    // eᵀ (P⁻¹ + S C Sᵀ)⁻¹ e = eᵀPe − bᵀ (1 + AᵀPA)⁻¹ b with A = S C^½, b = AᵀPe.
    const Eigen::MatrixXd a = sensitivity * size.asDiagonal();
    const Eigen::VectorXd b = a.transpose() * (found.precision * error);
    const Eigen::MatrixXd inner =
        Eigen::MatrixXd::Identity(size.size(), size.size()) + a.transpose() * (found.precision * a);
    const double whole = error.dot(found.precision * error);
    plain += whole, covered += whole - b.dot(inner.llt().solve(b)), values += error.size();
  }
  EXPECT_NEAR(covered / values, 1, test::long_form() ? 0.05 : 0.1);
  EXPECT_GT(plain / values, 1.3);
  RecordProperty("normalised", std::to_string(covered / values));
  RecordProperty("without_the_calibration", std::to_string(plain / values));
}

TEST(StereoSurface, NodesThatOneCameraLostAreNotMeasured) {
  const Scene scene;
  const auto before = scene.reference();
  const StereoSurface surface = find_surface(scene.cameras, before, mesh_of_scene());
  auto motions = motions_of(surface, before, before, 1);
  Eigen::SparseMatrix<double>& p = motions[1].precision;
  for (int i = 0; i < 2; ++i)
    for (Index j = 0; j < p.rows(); ++j)
      if (p.coeff(i, j) != 0) p.coeffRef(i, j) = 0, p.coeffRef(j, i) = 0;
  motions[1].measured[0] = 0;
  const SurfaceMotion found = surface_motion(scene.cameras, surface, motions);
  EXPECT_EQ(found.measured[0], 0);
  EXPECT_EQ(found.redundancy, surface.points.cols() - 1);
  EXPECT_EQ(found.std[0], 0);
  EXPECT_GT(found.std[3], 0);
  EXPECT_TRUE(found.displacement.allFinite());
}

TEST(StereoSurface, StrainsAreThoseOfTheMotionAndNoneOfATurn) {
  // A plane along (0.6, 0, 0.8) and y is stretched along the first by λ, then turned: E = ½(λ² − 1) a aᵀ.
  SurfaceMotion motion;
  SurfacePoints points(3, 6);
  const Eigen::Vector3d a(0.6, 0, 0.8);
  const Eigen::Matrix3d turn = Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, -1).normalized()).matrix();
  const double stretch = 1.02;
  motion.displacement.resize(18), motion.measured.assign(6, 1);
  for (int k = 0; k < 6; ++k) {
    const double s = k % 3 + 0.2 * (k / 3), t = 1.5 * (k / 3);
    points.col(k) = s * a + Eigen::Vector3d(0, t, 0);
    motion.displacement.segment<3>(3 * k) =
        turn * (stretch * s * a + Eigen::Vector3d(0, t, 0)) - points.col(k);
  }
  motion.measured[5] = 0;
  const Eigen::MatrixXd strain = surface_strains(points, motion, {{0, 1, 4, 3}, {1, 2, 5, -1}});
  const double e = 0.5 * (stretch * stretch - 1);
  for (const int k : {0, 1, 3, 4}) {
    EXPECT_NEAR(strain(0, k), 0.36 * e, 1e-14);
    EXPECT_NEAR(strain(2, k), 0.64 * e, 1e-14);
    EXPECT_NEAR(strain(5, k), 0.48 * e, 1e-14);
    EXPECT_NEAR(strain(1, k), 0, 1e-14);
  }
  EXPECT_EQ(strain.col(2).norm(), 0);  // its only element has a node that is not measured
}

TEST(StereoPose, IsThatOfTheFaceAndItsErrorTurnsTheBody) {
  StereoOptions options;
  options.cameras = two_cameras(200, 170);
  const auto cameras = options.cameras;
  // The face is the plane z = 2 mm of the model, whose z is towards the cameras.
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.linear() = Eigen::AngleAxisd(0.1, Eigen::Vector3d(1, 2, -1).normalized()) *
                  Eigen::Vector3d(1, -1, -1).asDiagonal();
  pose.translation() << 0.3, -0.2, 3;
  const Eigen::Vector3d outward(0, 0, 1);
  SurfacePoints surface(3, 20), points(3, 4);
  for (int a = 0; a < 20; ++a) surface.col(a) = pose * Eigen::Vector3d(a % 5 - 2.0, a / 5 - 1.5, 2);
  points << -9, 9, 9, -9, -7, -7, 7, 7, 2, 2, 2, 2;  // beside the measured part
  Eigen::Matrix2Xd pixels(2, 4);
  for (int k = 0; k < 4; ++k) pixels.col(k) = cameras[0].project(pose * points.col(k)).pixel;
  const StereoPose found = fit_stereo_pose(cameras[0], surface, pixels, points, outward, 0.5);
  EXPECT_LT((found.pose.matrix() - pose.matrix()).norm(), 1e-8);
  EXPECT_LT(found.misfit + found.flatness, 1e-8);
  // 0.5 px of 0.1 mm, over the root of the sum of squares of the points' distances from their middle.
  EXPECT_NEAR(found.turn_std, 0.05 / std::sqrt(4 * (81 + 49.0)), 0.02 * found.turn_std);

  // An error of the calibration stays what it was.
  options.calibration = {{"camera1"}, Eigen::MatrixXd::Zero(2 * k_camera_parameters, 1)};
  auto error = options.calibration.factor.col(0).tail<k_camera_parameters>();
  error << 4, 4, 0.05, 0.05, 0.1, 0.5, 20, 0, 0, 0, 0, 1e-4, 1e-4, 1e-4, -2e-4, 1e-4, 0.005, 0.005, 0.2;
  const Camera off = cameras[1].changed(error);
  use_pose(found, options);
  const Eigen::Vector3d x(3, 4, 2);
  const Camera still_off =
      options.cameras[1].changed(options.calibration.factor.col(0).tail<k_camera_parameters>());
  EXPECT_LT((still_off.project(x).pixel - off.project(pose * x).pixel).norm(), 1e-4);
  EXPECT_GT((still_off.project(x).pixel - options.cameras[1].project(x).pixel).norm(), 0.1);

  const Eigen::Matrix3d turn = Eigen::AngleAxisd(found.turn_std, outward).matrix();
  const Eigen::Vector3d turned = turn * (x - found.middle) + found.middle;
  ASSERT_EQ(options.calibration.names, (std::vector<std::string>{"camera1", "registration.turn"}));
  for (Index c = 0; c < 2; ++c) {
    EXPECT_LT((options.cameras[c].project(x).pixel - cameras[c].project(pose * x).pixel).norm(), 1e-6);
    const Camera changed = options.cameras[c].changed(
        options.calibration.factor.col(1).segment<k_camera_parameters>(k_camera_parameters * c));
    EXPECT_LT((changed.project(x).pixel - options.cameras[c].project(turned).pixel).norm(), 1e-4);
  }
  EXPECT_GT((options.cameras[0].project(x).pixel - options.cameras[0].project(turned).pixel).norm(), 0.05);

  points.col(0).x() -= 1;
  EXPECT_NE(files::message_of<DataError>([&] {
              (void)fit_stereo_pose(cameras[0], surface, pixels, points, outward, 0.5);
            }).find("mm from where the cameras see it"),
            std::string::npos);
  points.colwise() = points.col(1).eval();
  EXPECT_NE(files::message_of<UsageError>([&] {
              (void)fit_stereo_pose(cameras[0], surface, pixels, points, outward, 0.5);
            }).find("the points lie in one place"),
            std::string::npos);
}

TEST(StereoSurface, AWrongCalibrationIsRefused) {
  const Scene scene;
  auto cameras = scene.cameras;
  cameras[1].cy += 3;
  const std::string message =
      files::message_of<DataError>([&] { (void)find_surface(cameras, scene.reference(), mesh_of_scene()); });
  EXPECT_NE(message.find("the calibration does not belong to these pictures"), std::string::npos) << message;
}

/// Cameras of stereo_gt4 as its README has them.
std::vector<Camera> cameras_of_gt4() {
  std::vector<Camera> cameras(2);
  Camera &a = cameras[0], &b = cameras[1];
  a.cx = 955.0537385, a.cy = 645.2301624, a.fx = 6636.033383, a.fy = 6636.440175, a.skew = -5.693077075e-4;
  a.radial = {-1.957515272e-4, 0.8739544595, -26.91426143, 0, 0, 0};
  a.rotation = rotation_of_angles(179.9332210, 9.415993919, -0.05775865407);
  a.translation << -58.20738494, 0.1641145944, 20.16820788;
  b.cx = 971.3275619, b.cy = 615.7965508, b.fx = 6609.847619, b.fy = 6609.166930, b.skew = 0.7051020868;
  b.radial = {-5.225966870e-3, 1.077694686, -30.05404073, 0, 0, 0};
  b.rotation = rotation_of_angles(-179.9418875, -9.416050875, 0.04747312256);
  b.translation << 59.84373321, 0.2184759676, 21.04719884;
  return cameras;
}

TEST(StereoSurface, TheRealPairAgreesWithAPeer) {
  const std::string folder = files::recorded_data("stereo_gt4");
  if (!std::filesystem::exists(folder))
    GTEST_SKIP() << folder << " is not there: set KNOTHE_DATA to the folder of recorded data";
  std::vector<files::Picture> before, after;
  for (const char* c : {"0", "1"}) {
    before.push_back(files::read_picture(folder + "GT4-0000_" + c + ".tif"));
    after.push_back(files::read_picture(folder + "GT4-0003_" + c + ".tif"));
  }
  const auto cameras = cameras_of_gt4();
  const StereoSurface surface = find_surface(cameras, before, structured_mesh({600, 300, 1200, 900}, 40));
  EXPECT_LT(surface.epipolar_rms, 0.3);
  const SurfaceMotion found = surface_motion(cameras, surface, motions_of(surface, before, after, 0));
  EXPECT_LT(found.epipolar_rms, 0.03);
  RecordProperty("epipolar_px", std::to_string(surface.epipolar_rms));
  RecordProperty("epipolar_of_motion_px", std::to_string(found.epipolar_rms));
  const ImageMesh& mesh = surface.meshes[0];
  Eigen::VectorXd moved(2 * mesh.node_count()), disparity(2 * mesh.node_count());
  for (int a = 0; a < mesh.node_count(); ++a) {
    const Eigen::Vector3d x = surface.points.col(a), u = found.displacement.segment<3>(3 * a);
    moved.segment<2>(2 * a) = cameras[0].project(x + u).pixel - cameras[0].project(x).pixel;
    disparity.segment<2>(2 * a) << surface.meshes[1].x[a] - mesh.x[a], surface.meshes[1].y[a] - mesh.y[a];
    EXPECT_LT(u.norm(), 0.02 + 5 * found.std.segment<3>(3 * a).norm()) << "mm, node " << a;
  }
  // DICe's regression result (stereo_d_spec, DICe_solution_3.txt): x, y, its place in the right picture less
  // that in the left, and the displacement in the left picture; px.
  const Eigen::Matrix<double, 8, 6> peer{
      {624, 524, -26.147, -44.242, 0.063826, -0.042241},  {724, 624, -23.696, -42.676, 0.059201, -0.045554},
      {824, 624, -21.825, -42.388, 0.053123, -0.044964},  {824, 724, -22.311, -42.205, 0.051721, -0.046203},
      {924, 624, -21.008, -42.064, 0.049363, -0.044379},  {1024, 724, -21.603, -42.574, 0.053004, -0.047536},
      {1124, 624, -22.346, -41.442, 0.045699, -0.048325}, {1124, 824, -23.258, -44.077, 0.045087, -0.051081}};
  std::vector<char> inside;
  const Eigen::MatrixXd shift = interpolate(mesh, moved, peer.leftCols<2>(), inside),
                        across = interpolate(mesh, disparity, peer.leftCols<2>(), inside);
  const double of_shift = std::sqrt((shift - peer.rightCols<2>()).squaredNorm() / 16),
               of_place = std::sqrt((across - peer.middleCols<2>(2)).squaredNorm() / 16);
  EXPECT_LT(of_shift, 0.008);
  EXPECT_LT(of_place, 0.15);  // lines of sight miss each other by as much
  RecordProperty("rms_to_peer_px", std::to_string(of_shift));
}

}  // namespace
}  // namespace knothe::imaging
