#include "knothe/imaging/series/pattern_report.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <sstream>

#include "knothe/base/error.hpp"
#include "knothe/files/testing/test_folder.hpp"
#include "knothe/imaging/series/displacement_files.hpp"
#include "knothe/imaging/series/speckle.hpp"

namespace knothe::imaging {
namespace {

using ::testing::HasSubstr;

const Region k_region{20, 20, 179, 139};

/// A series of pictures in a folder, 200 × 160 px; `radius`, `gain`: of the speckle.
struct Scene {
  files::TestFolder folder;
  SeriesOptions options;
  explicit Scene(double radius = 2, double gain = 1, int references = 2) {
    const SpecklePattern pattern({.width = 200, .height = 160, .dot_radius = radius});
    for (int k = 0; k < references; ++k) {
      const std::string path = folder.file("reference" + std::to_string(k) + ".png");
      files::write_png(path,
                       pattern.render({}, {.noise = 2, .gain = gain, .seed = 1U + static_cast<unsigned>(k)}));
      options.references.push_back(path);
    }
    for (int k = 0; k < 3; ++k) {
      const std::string path = folder.file("picture" + std::to_string(k) + ".png");
      const double u = 0.3 + 0.4 * k;
      files::write_png(path, pattern.render(
                                 [=](double, double) {
                                   return Displacement{u, -u, {}};
                                 },
                                 {.noise = 2, .seed = 10U + static_cast<unsigned>(k)}));
      options.pictures.push_back(path);
    }
    options.region = k_region, options.element_size = 20;
  }
};

TEST(PatternReport, SaysHowExactlyItWillMeasure) {
  const Scene scene;
  PictureSeries series(scene.options);
  const PatternReport r = pattern_report(series);
  EXPECT_FALSE(r.noise_is_assumed);
  EXPECT_NEAR(r.noise, 2, 0.15);
  EXPECT_EQ(r.elements, 48);
  EXPECT_EQ(r.elements_without_texture, 0);
  EXPECT_LT(r.saturated, 0.05);
  // Against what correlation of a picture then says: the same noise, averaged over the same nodes.
  const auto result = series.next();
  ASSERT_FALSE(result.missing);
  EXPECT_NEAR(r.mean_std,
              mean_std(displacement_std(series.correlation(), result.correlation.element_valid, result.noise,
                                        series.reference_count())),
              1e-9 * r.mean_std);
  // And against the errors that are made: the shift is known.
  double squares = 0;
  const auto& u = result.correlation.displacement;
  for (Eigen::Index i = 0; i < u.size(); ++i) squares += std::pow(u[i] - (i % 2 == 0 ? 0.3 : -0.3), 2);
  const double rms = std::sqrt(squares / static_cast<double>(u.size())),
               predicted = std::sqrt(r.std.squaredNorm() / static_cast<double>(r.std.size()));
  EXPECT_NEAR(rms / predicted, 1, 0.2);
}

TEST(PatternReport, SpeckleSizeIsThatOfTheDots) {
  // Gaussian dots of standard deviation s: their autocorrelation has 2 s, full width at half height 2
  // · 1.1774 · √2 s.
  for (const double radius : {2.0, 4.0}) {
    const SpecklePattern pattern({.width = 400, .height = 400, .dot_radius = radius});
    const auto size = speckle_size(pattern.render(), {10, 10, 389, 389});
    for (const double along : size) EXPECT_NEAR(along, 3.33 * radius, 0.2 * 3.33 * radius) << radius;
  }
}

TEST(PatternReport, AdvisesWhatToChange) {
  const auto advice = [](const Scene& scene) {
    std::string all;
    for (const auto& a : pattern_report(PictureSeries(scene.options)).advice) all += a + "\n";
    return all;
  };
  EXPECT_THAT(advice(Scene(2, 0.4)), HasSubstr("the pattern is weak"));
  EXPECT_THAT(advice(Scene(2, 1.5)), HasSubstr("% of the pixels are saturated"));
  EXPECT_THAT(advice(Scene(6)), HasSubstr("elements of 20 px hold fewer than 3 speckles"));
  EXPECT_THAT(advice(Scene(2, 1, 1)), HasSubstr("the noise is assumed"));
}

TEST(PatternReport, TheTableIsWrittenInThreeForms) {
  const Scene scene;
  const PictureSeries series(scene.options);
  const PatternReport r = pattern_report(series);
  const auto rows = reporting_table(series, picture_frame(1e-4, {0, 0}), r.noise, r.std);
  const auto text_of = [&](const char* name) {
    const std::string path = scene.folder.file(name);
    write_reporting_table(path, rows);
    std::ifstream in(path);
    std::stringstream all;
    all << in.rdbuf();
    return all.str();
  };
  for (const char* name : {"t.txt", "t.json", "t.html"}) {
    const std::string text = text_of(name);
    for (const char* word :
         {"Field of view", "20 × 16", "quintic B-spline", "bilinear quadrilaterals", "noise floor"})
      EXPECT_THAT(text, HasSubstr(word)) << name;
  }
  EXPECT_THROW(write_reporting_table("t.pdf", rows), UsageError);
}

TEST(ReadResults, ASeriesGoesOnWhereItStopped) {
  const Scene scene;
  const std::string path = scene.folder.file("u.h5");
  std::vector<PictureResult> whole;
  {
    PictureSeries series(scene.options);
    while (!series.done()) whole.push_back(series.next());
    write_displacements(path, series, {whole[0], whole[1]}, std::nullopt, "");
  }
  PictureSeries series(scene.options);
  auto results = read_results(path, series);
  ASSERT_EQ(results.size(), 2U);
  EXPECT_EQ(results[1].correlation.displacement, whole[1].correlation.displacement);
  EXPECT_EQ(results[1].correlation.element_valid, whole[1].correlation.element_valid);
  series.resume(2, results[1].correlation);
  const auto third = series.next();
  EXPECT_EQ(third.correlation.displacement, whole[2].correlation.displacement);
  EXPECT_TRUE(series.done());

  SeriesOptions other = scene.options;
  other.element_size = 25;
  const auto message_of = [&](const SeriesOptions& options) -> std::string {
    try {
      (void)read_results(path, PictureSeries(options));
    } catch (const DataError& error) {
      return error.what();
    }
    return "no DataError";
  };
  EXPECT_THAT(message_of(other), HasSubstr("it holds the mesh of another series"));
  other = scene.options;
  std::swap(other.pictures[0], other.pictures[1]);
  EXPECT_THAT(message_of(other), HasSubstr("it holds the pictures of another series"));
  EXPECT_THROW(series.resume(9, {}), UsageError);
}

}  // namespace
}  // namespace knothe::imaging
