#include "knothe/imaging/camera/camera.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/files/testing/test_folder.hpp"
#include "knothe/imaging/camera/calibration_file.hpp"
#include "knothe/imaging/mesh/registration.hpp"

namespace knothe::imaging {
namespace {

Camera bent_camera() {
  Camera camera;
  camera.fx = 1200, camera.fy = 1180, camera.cx = 640, camera.cy = 500, camera.skew = 0.7;
  camera.radial = {-0.25, 0.1, -0.02, 0.03, -0.01, 0.004}, camera.tangential = {1e-3, -7e-4};
  camera.rotation = rotation_of_angles(10, -15, 3), camera.translation << 5, -7, 900;
  return camera;
}

TEST(Camera, ProjectsAsTheFormulaByHandSays) {
  // (x, y) = (0.2, −0.1), r² = 0.05: g = (1 + 0.005)/(1 + 0.01) with k1 = 0.1, k4 = 0.2.
  Camera camera;
  camera.fx = 1000, camera.fy = 900, camera.cx = 320, camera.cy = 240, camera.skew = 2;
  camera.radial = {0.1, 0, 0, 0.2, 0, 0}, camera.tangential = {0.01, 0.02};
  const double g = 1.005 / 1.01;
  const double x = 0.2 * g + 2 * 0.01 * (0.2 * -0.1) + 0.02 * (0.05 + 2 * 0.04),
               y = -0.1 * g + 0.01 * (0.05 + 2 * 0.01) + 2 * 0.02 * (0.2 * -0.1);
  const Projection p = camera.project({2, -1, 10});
  EXPECT_NEAR(p.pixel.x(), 1000 * x + 2 * y + 320, 1e-10);
  EXPECT_NEAR(p.pixel.y(), 900 * y + 240, 1e-10);
}

TEST(Camera, ItsJacobianIsThatOfDifferences) {
  const Camera camera = bent_camera();
  const Eigen::Vector3d at(120, -90, 40);
  for (int k = 0; k < 3; ++k) {
    const double h = 1e-3;
    const Eigen::Vector3d step = h * Eigen::Vector3d::Unit(k);
    const Eigen::Vector2d slope =
        (camera.project(at + step).pixel - camera.project(at - step).pixel) / (2 * h);
    EXPECT_LT((slope - camera.project(at).jacobian.col(k)).norm(), 1e-7) << k;
  }
}

TEST(Camera, ItsChangesByParametersAreThoseOfDifferences) {
  const Camera camera = bent_camera();
  const Eigen::Vector3d at(120, -90, 40);
  const auto jacobian = camera.parameter_jacobian(at);
  for (int k = 0; k < k_camera_parameters; ++k) {
    const double h = 1e-5;
    const CameraChange step = h * CameraChange::Unit(k);
    const Eigen::Vector2d slope =
        (camera.changed(step).project(at).pixel - camera.changed(-step).project(at).pixel) / (2 * h);
    EXPECT_LT((slope - jacobian.col(k)).norm(), 1e-6 * (1 + jacobian.col(k).norm())) << k;
  }
}

TEST(Camera, LinesOfSightMeetThePointTheyShow) {
  const Camera camera = bent_camera();
  for (const double x : {-200.0, 0.0, 150.0})
    for (const double y : {-150.0, 20.0, 180.0}) {
      const Eigen::Vector3d point(x, y, 30 + 0.1 * x);
      const Ray ray = camera.ray(camera.project(point).pixel);
      EXPECT_LT((point - ray.origin).cross(ray.direction).norm() / ray.direction.norm(), 1e-8);
    }
  EXPECT_THROW((void)camera.project({0, 0, -5000}), NumericalError);
}

/// A system of DICe's tests, which its repository has with angles and with R (tests/component/cal).
constexpr const char* k_dice = R"(<ParameterList>
<Parameter name="xml_file_format" type="string" value="DICe_xml_camera_system_file" />
<ParameterList name="CAMERA 0">
<Parameter name="CX" type="double" value="638.9130236" /><Parameter name="CY" type="double" value="407.2947410" />
<Parameter name="FX" type="double" value="2468.528613" /><Parameter name="FY" type="double" value="2468.253027" />
<Parameter name="K1" type="double" value="0.06384132162" />
<Parameter name="LENS_DISTORTION_MODEL" type="string" value="OPENCV_LENS_DISTORTION" />
<Parameter name="ALPHA" type="double" value="179.9648062" /><Parameter name="BETA" type="double" value="9.015158049" />
<Parameter name="GAMMA" type="double" value="0.03368301490" /><Parameter name="TX" type="double" value="-63.22727157" />
<Parameter name="TY" type="double" value="-0.3371514296" /><Parameter name="TZ" type="double" value="18.70517821" />
</ParameterList>
<ParameterList name="CAMERA 1">
<Parameter name="CX" type="double" value="628.6069607" /><Parameter name="CY" type="double" value="394.5705260" />
<Parameter name="FX" type="double" value="2377.107751" /><Parameter name="FY" type="double" value="2376.915841" />
<Parameter name="K1" type="double" value="0.06198448417" />
<Parameter name="LENS_DISTORTION_MODEL" type="string" value="OPENCV_LENS_DISTORTION" />
<Parameter name="ALPHA" type="double" value="-179.9590220" /><Parameter name="BETA" type="double" value="-9.015133814" />
<Parameter name="GAMMA" type="double" value="-0.03968800176" /><Parameter name="TX" type="double" value="64.84254707" />
<Parameter name="TY" type="double" value="-0.8762002049" /><Parameter name="TZ" type="double" value="15.34897551" />
</ParameterList>
</ParameterList>)";
constexpr const char* k_opencv_yaml = R"(%YAML:1.0
---
M1: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 2468.528613, 0., 638.9130236, 0., 2468.253027,
       407.2947410, 0., 0., 1. ]
D1: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ 6.384132162e-02, 0., 0., 0., 0. ]
M2: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 2377.107751, 0., 628.6069607, 0., 2376.915841, 394.5705260, 0., 0., 1. ]
D2: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ 6.198448417e-02, 0., 0., 0., 0. ]
R: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 0.950892, 0.00104338, -0.30952, -0.00145487, 0.999998, -0.00109863, 0.309519, 0.00149499, 0.950892 ]
T: !!opencv-matrix
   rows: 3
   cols: 1
   dt: d
   data: [ 130.75, -0.61049, 17.133 ]
)";

/// The same as MatchID writes it; the angles are those of R above, by their formulas.
constexpr const char* k_matchid = R"(Cam0_Fx [pixels];2468.528613
Cam0_Fy [pixels];2468.253027
Cam0_Fs [pixels];0
Cam0_Kappa 1;0.06384132162
Cam0_Kappa 2;0
Cam0_Kappa 3;0
Cam0_P1;0
Cam0_P2;0
Cam0_Cx [pixels];638.9130236
Cam0_Cy [pixels];407.2947410
Cam1_Fx [pixels];2377.107751
Cam1_Fy [pixels];2376.915841
Cam1_Fs [pixels];0.5
Cam1_Kappa 1;0.06198448417
Cam1_Kappa 2;0
Cam1_Kappa 3;0
Cam1_P1;0.002
Cam1_P2;0
Cam1_Cx [pixels];628.6069607
Cam1_Cy [pixels];394.5705260
Tx [mm];130.75
Ty [mm];-0.61049
Tz [mm];17.133
Theta [deg];0.0900802056
Phi [deg];-18.0302455967
Psi [deg];-0.0876627900
)";

std::vector<Camera> cameras_of(const char* text) {
  const files::TestFolder folder;
  std::ofstream(folder.file("calibration")) << text;
  return read_cameras(folder.file("calibration"));
}

/// A frame whose lens moves the picture's corners by some 4 px.
PictureFrame frame_with_lens() {
  PictureFrame frame = picture_frame(2e-4, {300, 250});
  frame.slope *= std::polar(1.0, 0.1), frame.plane = 0.05;
  Camera lens;
  lens.fx = 1500, lens.fy = 1480, lens.cx = 310, lens.cy = 240, lens.skew = 0.5;
  lens.radial = {-0.2, 0.1}, lens.tangential = {1e-3, -2e-3};
  frame.lens = lens;
  return frame;
}

TEST(PictureFrame, ALensIsTakenOutOfPlacesAndDisplacements) {
  const PictureFrame frame = frame_with_lens();
  ImageMesh mesh;
  mesh.x = {12, 600, 590, 330}, mesh.y = {20, 15, 470, 230}, mesh.elements = {{0, 1, 2, 3}};
  Eigen::VectorXd d(8);
  d << 1.5, -0.7, 0.3, 2.1, -1.2, 0.4, 0.8, 0.8;
  const Eigen::VectorXd u = frame.to_model(mesh, d);
  const auto place = [&](double x, double y) {
    const auto p = frame.model_point(x, y);
    return Eigen::Vector2d(p[0], p[1]);
  };
  for (Index a = 0; a < 4; ++a) {
    const double x = mesh.x[a], y = mesh.y[a];
    const auto back = frame.picture_point(frame.model_point(x, y));
    EXPECT_NEAR(back[0], x, 1e-9);
    EXPECT_NEAR(back[1], y, 1e-9);
    const Eigen::Vector2d moved = place(x + d[2 * a], y + d[2 * a + 1]) - place(x, y);
    EXPECT_LT((u.segment<2>(2 * a) - moved).norm(), 1e-15);
  }
  // The lens alone: (x, y) = (X, Y)/Z by the formula, straight pixels of 1/fx.
  const Eigen::Vector2d seen = frame.lens->project({0.17, -0.12, 1}).pixel;
  const auto straight = frame.without_lens(seen.x(), seen.y());
  EXPECT_NEAR(straight[0], 1500 * 0.17 + 310, 1e-9);
  EXPECT_NEAR(straight[1], -1500 * 0.12 + 240, 1e-9);
}

TEST(PictureFrame, ThePrecisionBehindALensIsThatOfSmallDisplacements) {
  const PictureFrame frame = frame_with_lens();
  ImageMesh mesh;
  mesh.x = {12, 600}, mesh.y = {20, 470};
  const Eigen::MatrixXd root =
      (Eigen::MatrixXd(4, 4) << 3, 1, 0, 1, 1, 4, 1, 0, 0, 1, 5, 2, 1, 0, 2, 6).finished();
  const Eigen::MatrixXd in_pixels = root * root.transpose();
  const Eigen::MatrixXd precision = frame.to_model(mesh, Eigen::SparseMatrix<double>(in_pixels.sparseView()));
  Eigen::VectorXd d(4);
  d << 1e-4, -2e-4, 3e-4, 1e-4;
  const Eigen::VectorXd u = frame.to_model(mesh, d);
  EXPECT_NEAR(u.dot(precision * u) / d.dot(in_pixels * d), 1, 1e-5);
  EXPECT_LT((frame.to_picture(mesh, u) - d).norm(), 1e-5 * d.norm());
}

TEST(CalibrationFile, OneSystemInThreeFormatsIsOneSystem) {
  for (const char* text : {k_dice, k_opencv_yaml, k_matchid}) {
    const auto cameras = cameras_of(text);
    ASSERT_EQ(cameras.size(), 2U) << text;
    EXPECT_NEAR(cameras[1].fx, 2377.107751, 1e-9);
    EXPECT_NEAR(cameras[0].cy, 407.2947410, 1e-9);
    EXPECT_NEAR(cameras[1].radial[0], 0.06198448417, 1e-12);
    // From the first camera to the second, as the text has it: R to six digits, t to 5e-3 (130.75).
    const Eigen::Matrix3d turn = cameras[1].rotation * cameras[0].rotation.transpose();
    const Eigen::Vector3d shift = cameras[1].translation - turn * cameras[0].translation;
    EXPECT_NEAR(turn(0, 2), -0.30952, 2e-6);
    EXPECT_NEAR(turn(1, 0), -0.00145487, 2e-6);
    EXPECT_NEAR(turn(2, 1), 0.00149499, 2e-6);
    EXPECT_LT((shift - Eigen::Vector3d(130.75, -0.61049, 17.133)).norm(), 5.1e-3) << shift.transpose();
  }
}

TEST(CalibrationFile, MatchIdHasSkewAndNamesWhatItLacks) {
  const auto cameras = cameras_of(k_matchid);
  EXPECT_EQ(cameras[1].skew, 0.5);
  EXPECT_EQ(cameras[1].tangential[0], 0.002);
  const auto message = [](std::string text, const std::string& from, const std::string& to) {
    text.replace(text.find(from), from.size(), to);
    return files::message_of<DataError>([&] { (void)cameras_of(text.c_str()); });
  };
  EXPECT_NE(message(k_matchid, "Phi [deg]", "Chi [deg]").find("Phi is missing"), std::string::npos);
  EXPECT_NE(message(k_matchid, "Cam1_Kappa 3;0", "Cam1_Kappa 4;0.1").find("Cam1_Kappa4 is not known here"),
            std::string::npos);
  EXPECT_NE(message(k_matchid, "2377.107751", "2377,107751").find("Cam1_Fx: one number is needed"),
            std::string::npos);
}

TEST(CalibrationFile, AttributesOfDiceMayStandInAnyOrder) {
  std::string text = k_dice;
  const std::string tag = R"(name="FX" type="double" value="2468.528613")";
  text.replace(text.find(tag), tag.size(), R"(value="2468.528613" type="double" name="FX")");
  EXPECT_EQ(cameras_of(text.c_str())[0].fx, 2468.528613);
}

TEST(CalibrationFile, OpenCvXmlHasTheOrderOfItsCoefficients) {
  std::string text = "<?xml version=\"1.0\"?>\n<opencv_storage>\n";
  const auto matrix = [](const std::string& name, const std::string& data) {
    return "<" + name + " type_id=\"opencv-matrix\"><rows>1</rows><cols>9</cols><dt>d</dt><data>" + data +
           "</data></" + name + ">\n";
  };
  for (const std::string n : {"1", "2"})
    text +=
        matrix("M" + n, "1000. 0. 500. 0. 1001. 400. 0. 0. 1.") + matrix("D" + n, "1. 2. 3. 4. 5. 6. 7. 8.");
  text += matrix("R", "1. 0. 0. 0. 1. 0. 0. 0. 1.") + matrix("T", "-100. 0. 0.") + "</opencv_storage>\n";
  const Camera camera = cameras_of(text.c_str())[1];
  EXPECT_EQ(camera.radial, (std::array<double, 6>{1, 2, 5, 6, 7, 8}));
  EXPECT_EQ(camera.tangential, (std::array<double, 2>{3, 4}));
  EXPECT_EQ(camera.translation.x(), -100);
}

TEST(CalibrationFile, AttributesOfDiceMayStandInAnyOrderAndCommentsAreNone) {
  std::string text = k_dice;
  const std::string tag = R"(name="FX" type="double" value="2468.528613")";
  text.replace(text.find(tag), tag.size(), R"(value="2468.528613" type="double" name="FX")");
  text.insert(text.find("<Parameter name=\"CX\""), R"(<!-- <Parameter name="CX" value="7" /> -->)");
  const Camera camera = cameras_of(text.c_str())[0];
  EXPECT_EQ(camera.fx, 2468.528613);
  EXPECT_EQ(camera.cx, 638.9130236);
}

TEST(CalibrationFile, ErrorsNameKeyAndRemedy) {
  const auto message = [](std::string text) {
    return files::message_of<DataError>([&] { (void)cameras_of(text.c_str()); });
  };
  std::string without = k_opencv_yaml;
  without.replace(without.find("\nT:"), 3, "\nX:");
  EXPECT_NE(message(without).find("no matrix T: an OpenCV file of two cameras holds"), std::string::npos);
  std::string wrong = k_dice;
  wrong.replace(wrong.find("2468.253027"), 11, "wide");
  EXPECT_NE(message(wrong).find("CAMERA 0 FY: 'wide' is not a number"), std::string::npos) << message(wrong);
  std::string other = k_dice;
  other.replace(other.find("OPENCV_LENS"), 11, "K1R1_K2R2_K");
  EXPECT_NE(message(other).find("OPENCV_LENS_DISTORTION is"), std::string::npos) << message(other);
  EXPECT_NE(message("<html>").find("no calibration that is known"), std::string::npos);
  EXPECT_NE(message("<camera id=\"0\"><orientation>").find("not published"), std::string::npos);
  std::string part = k_dice;
  part.replace(part.find("\"CX\""), 4, "\"C\"");
  EXPECT_NE(message(part).find("CAMERA 0: CX is missing"), std::string::npos) << message(part);
  part = part.substr(0, part.size() / 2);
  EXPECT_NE(message(part).find("is no XML from byte"), std::string::npos) << message(part);
  std::string skew = k_dice;
  skew.replace(skew.find("\"K1\""), 4, "\"FS\"");
  EXPECT_NE(message(skew).find("CAMERA 0 FS: DICe leaves the skew out"), std::string::npos);
}

}  // namespace
}  // namespace knothe::imaging
