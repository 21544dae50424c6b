#include "knothe/imaging/stereo/stereo_series.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/files/hdf5.hpp"
#include "knothe/files/testing/test_folder.hpp"
#include "knothe/imaging/stereo/drawn_view.hpp"

namespace knothe::imaging {
namespace {

constexpr double k_metre_per_px = 1e-4;

/// Pictures of a flat surface at z = 0 that two cameras at 1 m take, in a folder.
struct DrawnTest {
  files::TestFolder folder;
  SpecklePattern pattern{{.width = 200, .height = 170, .margin = 120}};
  StereoOptions options;

  DrawnTest() {
    for (const double angle : {12.5, -12.5}) {
      Camera camera;
      camera.fx = camera.fy = 10000, camera.cx = 100, camera.cy = 85, camera.radial[0] = angle;
      camera.rotation = rotation_of_angles(0, angle, 0), camera.translation << 0, 0, 1;
      options.cameras.push_back(camera);
      SeriesOptions series;
      series.region = Region{25, 25, 172, 142};
      options.series.push_back(series);
    }
    for (Index c = 0; c < 2; ++c) options.series[c].references = {draw(c, "reference", {0, 0, 0})};
  }
  std::string draw(Index c, const std::string& name, const Eigen::Vector3d& shift) {
    files::Picture picture = drawn_view(options.cameras[c], 200, 170, pattern, [&](double s, double t) {
      return Eigen::Vector3d(shift + k_metre_per_px * Eigen::Vector3d(s - 100, t - 85, 0));
    });
    const std::string path = folder.file(name + "_" + std::to_string(c) + ".tif");
    files::write_tiff(path, picture);
    return path;
  }
};

TEST(StereoSeries, MeasuresSetsMarksBadOnesAndWritesThemInMetres) {
  DrawnTest test;
  const Eigen::Vector3d first(2e-5, -3e-5, 4e-4), last(-1e-5, 1e-5, -2e-4);
  for (Index c = 0; c < 2; ++c)
    test.options.series[c].pictures = {
        test.draw(c, "a", first),
        test.draw(c, "late", c == 0 ? last : Eigen::Vector3d(last + Eigen::Vector3d(0, 2e-4, 0))),
        c == 0 ? test.draw(c, "b", first) : test.folder.file("gone.tif"), test.draw(c, "c", last)};
  StereoSeries series(test.options);
  EXPECT_LT(series.surface().points.row(2).cwiseAbs().maxCoeff(), 5e-5);
  std::vector<StereoResult> results;
  while (!series.done()) results.push_back(series.next());
  ASSERT_EQ(results.size(), 4U);
  EXPECT_FALSE(results[0].missing) << results[0].message;
  EXPECT_NE(results[1].message.find("were the pictures taken at the same time"), std::string::npos)
      << results[1].message;
  EXPECT_NE(results[2].message.find("gone.tif"), std::string::npos);
  EXPECT_FALSE(results[3].missing) << results[3].message;

  write_stereo_displacements(test.folder.file("u.h5"), series, results, "");
  const files::Hdf5Reader file(test.folder.file("u.h5"));
  const Index n = series.surface().points.cols();
  const auto values = file.read("/values", true);
  ASSERT_EQ(values.size(), 4 * 3 * n);
  for (Index i = 0; i < 3 * n; ++i) {
    EXPECT_NEAR(values[i], first[i % 3], i % 3 == 2 ? 2e-5 : 5e-6);
    EXPECT_TRUE(std::isnan(values[3 * n + i]));
    EXPECT_NEAR(values[9 * n + i], last[i % 3], i % 3 == 2 ? 2e-5 : 5e-6);
  }
  EXPECT_EQ(file.read("/noise/precision/indptr").size(), 3 * n + 1);
  EXPECT_FALSE(file.has("/noise/precision_steps"));

  // A series of the same pictures goes on behind the last, with the same results.
  StereoSeries again(test.options);
  const std::vector<StereoResult> resumed = resume_from(test.folder.file("u.h5"), again);
  EXPECT_TRUE(again.done());
  ASSERT_EQ(resumed.size(), 4U);
  for (Index t = 0; t < 4; ++t) {
    EXPECT_EQ(resumed[t].message, results[t].message);
    EXPECT_EQ(resumed[t].motion.displacement, results[t].motion.displacement);
    EXPECT_EQ(resumed[t].motion.std, results[t].motion.std);
  }
  write_stereo_vtu(test.folder.file("u.vtu"), series, results[0]);

  // An element that one camera lost is another precision than the same element lost by the other.
  results[0].pictures[0].correlation.element_valid[0] = 0;
  results[3].pictures[1].correlation.element_valid[0] = 0;
  write_stereo_displacements(test.folder.file("v.h5"), series, results, "");
  EXPECT_TRUE(files::Hdf5Reader(test.folder.file("v.h5")).has("/noise/precision_steps/3"));
}

TEST(StereoSeries, AnErrorOfTheCalibrationIsSharedByAllSets) {
  DrawnTest test;
  for (Index c = 0; c < 2; ++c)
    test.options.series[c].pictures = {test.draw(c, "a", {1e-5, 0, 3e-3}), test.folder.file("gone.tif"),
                                       test.draw(c, "b", {-2e-5, 2e-5, -4e-3})};
  const auto measured = [&] {
    StereoSeries series(test.options);
    std::vector<StereoResult> results;
    while (!series.done()) results.push_back(series.next());
    write_stereo_displacements(test.folder.file("u.h5"), series, results, "");
    return results;
  };
  test.options.calibration = {{"camera0.fx", "camera1.wy"},
                              Eigen::MatrixXd::Zero(2 * k_camera_parameters, 2)};
  test.options.calibration.factor(0, 0) = 4,
                                     test.options.calibration.factor(k_camera_parameters + 14, 1) = 1e-5;
  const std::vector<StereoResult> found = measured();
  const files::Hdf5Reader file(test.folder.file("u.h5"));
  const Index n = found[0].calibration.rows();
  EXPECT_EQ(file.texts_attribute("/noise/shared_errors", "names"), test.options.calibration.names);
  const auto effects = file.read("/noise/shared_errors", {3, std::size_t(n), 2});
  const auto std = file.read("/displacement_std", true);
  for (const Index t : {0, 2})
    for (Index i = 0; i < n; ++i) {
      for (Index k = 0; k < 2; ++k) EXPECT_EQ(effects[(t * n + i) * 2 + k], found[t].calibration(i, k));
      EXPECT_NEAR(std[t * n + i],
                  std::hypot(found[t].motion.std[i], found[t].calibration(i, 0), found[t].calibration(i, 1)),
                  1e-15);
    }
  for (Index i = 0; i < 2 * n; ++i) EXPECT_EQ(effects[2 * n + i], 0);

  // What cameras measure that are off by one standard deviation, to either side.
  const auto cameras = test.options.cameras;
  for (Index k = 0; k < 2; ++k) {
    std::vector<StereoResult> moved[2];
    for (const int side : {0, 1}) {
      test.options.cameras = cameras;
      test.options.cameras[k] = cameras[k].changed(
          (1 - 2 * side) * test.options.calibration.factor.col(k).segment<k_camera_parameters>(19 * k));
      moved[side] = measured();
    }
    for (const Index t : {0, 2}) {
      const Eigen::VectorXd difference =
          0.5 * (moved[0][t].motion.displacement - moved[1][t].motion.displacement);
      EXPECT_GT(difference.norm(), 1e-7);
      EXPECT_LT((difference - found[t].calibration.col(k)).norm(), 0.05 * difference.norm()) << k << " " << t;
    }
  }
}

TEST(StereoSeries, MeasuresElementsThatLieWhollyInTheMask) {
  DrawnTest test;
  files::Picture mask{200, 170, 8, 255, std::vector<float>(200 * 170, 0), {}};
  for (int y = 0; y < 170; ++y)
    for (int x = 40; x < 200; ++x) mask.pixels[200 * y + x] = 255;
  const std::string name = test.folder.file("mask.tif");
  files::write_tiff(name, mask);
  test.options.series[0].mask = name;
  const StereoSeries series(test.options);
  const ImageMesh& mesh = series.surface().meshes.front();
  // The first column of elements, 25 to 49.5 px, is more than half in the mask, and left out.
  EXPECT_NEAR(*std::min_element(mesh.x.begin(), mesh.x.end()), 49.5, 1e-9);
}

TEST(StereoSeries, WhatIsForOneCameraIsRefused) {
  DrawnTest test;
  test.options.series[1].pictures = {"a.tif"};
  const auto message = [&] {
    return files::message_of<UsageError>([&] { const StereoSeries series(test.options); });
  };
  EXPECT_NE(message().find("0 pictures of one camera and 1 of another"), std::string::npos);
  test.options.series[1].pictures.clear();
  test.options.series[0].drift = Drift::shift;
  EXPECT_NE(message().find("are for one camera"), std::string::npos);
  test.options.series.pop_back();
  EXPECT_NE(message().find("2 cameras, and there are pictures of 1"), std::string::npos);
}

}  // namespace
}  // namespace knothe::imaging
