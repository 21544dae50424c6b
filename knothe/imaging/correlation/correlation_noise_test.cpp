#include "knothe/imaging/correlation/correlation_noise.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <random>
#include <string>

#include "knothe/imaging/correlation/spline_image.hpp"
#include "knothe/imaging/series/speckle.hpp"

namespace knothe::imaging {
namespace {

const SpecklePattern& pattern() {
  static const SpecklePattern made({.width = 320, .height = 256});
  return made;
}
const Region k_region{30, 30, 280, 205};

TEST(CorrelationNoise, InterpolationDampsWhiteNoise) {
  EXPECT_NEAR(interpolated_noise_variance(0), 1, 1e-12);
  EXPECT_NEAR(interpolated_noise_variance(3), 1, 1e-12);
  EXPECT_NEAR(interpolated_noise_variance(0.3), interpolated_noise_variance(0.7), 1e-12);
  // Independent: noise of a picture, interpolated by SplineImage.
  const SpecklePattern flat({.width = 300, .height = 300, .coverage = 1e-9});
  const SplineImage image(flat.render({}, {.noise = 5, .quantise = false}));
  for (const double t : {0.25, 0.5}) {
    double sum = 0, squares = 0, n = 0;
    for (int y = 10; y < 290; ++y)
      for (int x = 10; x < 290; ++x) {
        const double v = static_cast<double>(image.at(x + t, y + t).value);
        sum += v, squares += v * v, n += 1;
      }
    const double variance = squares / n - sum * sum / (n * n);
    EXPECT_NEAR(variance / 25, std::pow(interpolated_noise_variance(t), 2), 0.02);
  }
}

TEST(CorrelationNoise, IsFoundFromTheResidualAndFromARepeat) {
  const double noise = 2;
  const auto reference = pattern().render({}, {.noise = noise, .seed = 1});
  EXPECT_NEAR(noise_from_repeat(reference, pattern().render({}, {.noise = noise, .seed = 2}), k_region),
              noise, 0.06);
  for (const double sigma : {0.0, 1.0})
    for (const double shift : {0.0, 0.5, 1.3}) {
      ImageCorrelation correlation(reference, structured_mesh(k_region, 25), {.prefilter_sigma = sigma});
      const auto result = correlation.correlate(pattern().render(
          [&](double, double) {
            return Displacement{shift, shift, {}};
          },
          {.noise = noise, .seed = 3}));
      ASSERT_TRUE(result.converged) << result.message;
      // Quantisation adds 1/12; a prefilter is damped by the interpolation less than white noise is.
      EXPECT_NEAR(noise_from_residual(correlation, result), noise, sigma > 0 ? 0.5 : 0.12)
          << sigma << ' ' << shift;
    }
}

TEST(CorrelationNoise, PicturesThatMovedAreToldFromPicturesAtRest) {
  const auto moved_by = [](double pixels, std::uint64_t seed) {
    return pattern().render(
        [pixels](double, double) {
          return Displacement{pixels, 0.5 * pixels, {}};
        },
        {.noise = 2, .gain = 1 + 0.1 * pixels, .seed = seed});
  };
  const files::Picture reference = moved_by(0, 1);
  EXPECT_LT(share_of_motion(reference, moved_by(0, 2), k_region), 0.006);
  EXPECT_GT(share_of_motion(reference, moved_by(0.1, 3), k_region), 0.1);
  EXPECT_GT(share_of_motion(reference, moved_by(0.6, 4), k_region), 0.5);
}

TEST(CorrelationNoise, StandardDeviationsAreThoseOfTheDenseInverse) {
  ImageCorrelation correlation(pattern().render(), structured_mesh(k_region, 40));
  const Eigen::SparseMatrix<double> precision =
      correlation.precision(std::vector<char>(correlation.mesh().elements.size(), 1), 1.7);
  const auto std = displacement_std(precision);
  const Eigen::MatrixXd inverse = Eigen::MatrixXd(precision).inverse();
  for (Eigen::Index k = 0; k < std.size(); ++k) EXPECT_NEAR(std[k], std::sqrt(inverse(k, k)), 1e-9);
}

TEST(CorrelationNoise, StandardDeviationsForAnyNoiseAreThoseOfThePrecision) {
  // A weak, coarse speckle, where the noise of the gradient counts most.
  const SpecklePattern weak({.width = 320, .height = 256, .dot_radius = 3.5});
  ImageCorrelation correlation(weak.render({}, {.noise = 2}), structured_mesh(k_region, 25),
                               {.prefilter_sigma = 1});
  std::vector<char> valid(correlation.mesh().elements.size(), 1);
  valid[0] = 0;
  for (const double noise : {0.3, 1.1, 1.7, 2.3, 1.1}) {
    const auto std = correlation.displacement_std(valid, noise, 2, 1.2);
    const auto exact = displacement_std(correlation.precision(valid, noise, 2, 1.2));
    ASSERT_EQ(std.size(), exact.size());
    for (Eigen::Index k = 0; k < std.size(); ++k) EXPECT_NEAR(std[k], exact[k], 1e-4 * exact[k]) << noise;
  }
}

/// A hole in the body: four elements that show nothing but the camera's noise.
TEST(CorrelationNoise, ElementsThatShowNoiseAloneSayNothing) {
  const double noise = 2;
  files::Picture picture = pattern().render({}, {.noise = noise, .quantise = false});
  std::mt19937 random(3);
  std::normal_distribution<float> grey(60, noise);
  for (int y = 77; y <= 133; ++y)
    for (int x = 127; x <= 183; ++x) picture.at(x, y) = grey(random);
  const ImageMesh mesh = structured_mesh(k_region, 25);
  std::vector<char> body(mesh.elements.size(), 1);
  const std::vector<char> all = body;
  for (std::size_t e = 0; e < body.size(); ++e) {
    const auto corner = mesh.elements[e][0], opposite = mesh.elements[e][2];
    const double x = (mesh.x[corner] + mesh.x[opposite]) / 2, y = (mesh.y[corner] + mesh.y[opposite]) / 2;
    if (x > 130 && x < 180 && y > 80 && y < 130) body[e] = 0;
  }
  ASSERT_EQ(std::count(body.begin(), body.end(), 0), 4);
  ImageCorrelation correlation(picture, mesh);
  EXPECT_EQ(correlation.usable_elements(), all);  // as long as the noise is not known
  const Eigen::MatrixXd precision(correlation.precision(all, noise));
  EXPECT_EQ(precision, Eigen::MatrixXd(correlation.precision(body, noise)));
  EXPECT_EQ((precision.diagonal().array() == 0).count(), 2);
  EXPECT_GE(precision.diagonal().minCoeff(), 0);
  EXPECT_EQ((correlation.displacement_std(all, noise).array() == 0).count(), 2);
  const ImageCorrelation knowing(picture, mesh, {.least_texture = texture_of_noise(noise, 1, 0)});
  EXPECT_EQ(knowing.usable_elements(), body);
}

TEST(CorrelationNoise, GradientOfNoiseHasTheVarianceTold) {
  const SpecklePattern flat({.width = 300, .height = 300, .coverage = 1e-9});
  for (const double sigma : {0.0, 1.0}) {
    const auto dx = pixel_gradients(flat.render({}, {.noise = 5, .quantise = false}), sigma, {0, 300}, 1).dx;
    double squares = 0;
    for (const float g : dx) squares += static_cast<double>(g * g);
    EXPECT_NEAR(squares / (300 * 300) / 25, gradient_noise_variance(sigma),
                0.03 * gradient_noise_variance(sigma));
  }
}

/// Mean of eᵀ P e over realisations with new noise in both pictures, per degree of freedom: 1 if the
/// covariance is right, correlations included.
/// `plain`: the same with the paper's M/(2γ²).
struct NormalisedError {
  double corrected = 0, plain = 0;
};
NormalisedError normalised_error(double sigma, double radius, int count) {
  const SpecklePattern speckle({.width = 320, .height = 256, .dot_radius = radius});
  const double noise = 2;
  NormalisedError mean;
  for (int k = 0; k < count; ++k) {
    ImageCorrelation fresh(
        speckle.render({}, {.noise = noise, .quantise = false, .seed = 1000U + static_cast<unsigned>(k)}),
        structured_mesh(k_region, 25), {.brightness = Brightness::none, .prefilter_sigma = sigma});
    const auto result = fresh.correlate(
        speckle.render({}, {.noise = noise, .quantise = false, .seed = 5000U + static_cast<unsigned>(k)}),
        Eigen::VectorXd::Zero(fresh.matrix().rows()));
    const double dofs = static_cast<double>(fresh.matrix().rows()) * count;
    const Eigen::VectorXd& e = result.displacement;
    mean.corrected += e.dot(fresh.precision(result.element_valid, noise) * e) / dofs;
    mean.plain += e.dot(fresh.matrix(result.element_valid) * e) / (2 * noise * noise * dofs);
  }
  return mean;
}

TEST(CorrelationNoise, TheCovarianceIsRightNotJustPlausible) {
  EXPECT_NEAR(normalised_error(0, 2.0, 12).corrected, 1, 0.06);
  EXPECT_NEAR(normalised_error(1, 2.0, 12).corrected, 1, 0.06);
  // The weak, coarse speckle is the harder one: there the noise of the gradient counts.
  const NormalisedError weak = normalised_error(0, 3.5, 12);
  EXPECT_NEAR(weak.corrected, 1, 0.06);
  EXPECT_GT(weak.plain, 1.08);
  RecordProperty("plain", std::to_string(weak.plain));
}

}  // namespace
}  // namespace knothe::imaging
