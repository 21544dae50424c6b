// Eq. 32 and 33 of Rubio et al. 2019 against closed forms, dense evaluation without any reduction, and Monte
// Carlo.
#include "knothe/assimilation/forecast/crack_bridge.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <Eigen/QR>
#include <cmath>
#include <random>
#include <string>

#include "knothe/assimilation/forecast/forecaster.hpp"
#include "knothe/base/error.hpp"
#include "knothe/model/testing/test_models.hpp"
#include "knothe/numerics/functions/cubic_spline.hpp"
#include "knothe/numerics/statistics/normal_distribution.hpp"
#include "knothe/numerics/statistics/random.hpp"

namespace knothe::assimilation {
namespace {

std::vector<double> millimetres(int count = 80) {
  std::vector<double> lengths;
  for (int i = 0; i < count; ++i) lengths.push_back(1e-3 * i);
  return lengths;
}

/// Smooth made-up displacements of n dofs, order one per unit of imposed displacement.
Eigen::MatrixXd smooth_solutions(const std::vector<double>& lengths, int n, double wiggle = 0.2) {
  Eigen::MatrixXd u(static_cast<Eigen::Index>(lengths.size()), n);
  for (Eigen::Index i = 0; i < u.rows(); ++i)
    for (int j = 0; j < n; ++j) {
      const double l = lengths[static_cast<std::size_t>(i)] / 0.079, s = (j + 0.5) / n;
      u(i, j) = 0.5 * s + 0.3 * l * l * std::cos(3 * s) + wiggle * std::tanh(4 * (l - s));
    }
  return u;
}

Eigen::MatrixXd random_matrix(Eigen::Index rows, Eigen::Index cols, unsigned seed) {
  std::mt19937_64 engine(seed);
  std::normal_distribution<double> normal;
  Eigen::MatrixXd m(rows, cols);
  for (Eigen::Index j = 0; j < cols; ++j)
    for (Eigen::Index i = 0; i < rows; ++i) m(i, j) = normal(engine);
  return m;
}

struct Moments {
  double mean, std, probability;
  std::vector<double> x, density;
};

/// Eq. 33 dof by dof: spline of each dof, dense covariance, trapezoid rule on a fine mesh.
Moments brute_force(const std::vector<double>& lengths, const Eigen::MatrixXd& solutions,
                    const LinearPrediction& prediction, double imposed, const CrackBridgeOptions& options,
                    double discrepancy, const FunctionMoments& moments, int points) {
  const Eigen::Index n = solutions.cols();
  const Eigen::VectorXd expected = prediction.lift + prediction.modes * moments.mean;
  Eigen::MatrixXd covariance = prediction.modes * moments.covariance * prediction.modes.transpose();
  covariance.diagonal().array() += discrepancy * discrepancy;
  const Eigen::MatrixXd precision = covariance.inverse();
  std::vector<numerics::CubicSpline> splines;
  for (Eigen::Index j = 0; j < n; ++j) {
    const Eigen::VectorXd column = solutions.col(j);
    splines.emplace_back(lengths, std::span<const double>(column.data(), lengths.size()));
  }
  Moments result{0, 0, 0, {}, {}};
  Eigen::VectorXd logs(points), misfit(n);
  for (int k = 0; k < points; ++k) {
    const double l = lengths.front() + (lengths.back() - lengths.front()) * k / (points - 1.0);
    for (Eigen::Index j = 0; j < n; ++j)
      misfit[j] = imposed * splines[static_cast<std::size_t>(j)].value(l) - expected[j];
    logs[k] = -0.5 * misfit.dot(precision * misfit) -
              0.5 * std::pow((l - options.prior_mean) / options.prior_std, 2);
    result.x.push_back(l);
  }
  const Eigen::ArrayXd density = (logs.array() - logs.maxCoeff()).exp();
  const Eigen::Map<const Eigen::ArrayXd> x(result.x.data(), points);
  const double step = x[1] - x[0], total = (density.sum() - 0.5 * (density[0] + density[points - 1])) * step;
  result.mean = (density * x).sum() * step / total;
  result.std = std::sqrt((density * (x - result.mean).square()).sum() * step / total);
  result.probability = (x > options.threshold).select(density, 0.0).sum() * step / total;
  for (int k = 0; k < points; ++k) result.density.push_back(density[k] / total);
  return result;
}

/// At any snapshot and dof.
double largest_error(const CrackMetaModel& meta, std::span<const double> lengths,
                     const Eigen::MatrixXd& solutions) {
  return (meta.coordinates(lengths).transpose() * meta.space().transpose() - solutions).cwiseAbs().maxCoeff();
}

TEST(CrackMetaModel, ReproducesSnapshotsAndCubicsBetweenThem) {
  // Cubic in l with random coefficients per dof: four modes, and a not-a-knot spline is exact between nodes.
  const auto lengths = millimetres();
  const Eigen::MatrixXd a = random_matrix(4, 30, 1);
  const auto powers = [](double l) {
    const double s = l / 0.079;
    return Eigen::RowVector4d(1, s, s * s, s * s * s);
  };
  Eigen::MatrixXd solutions(80, 30);
  for (Eigen::Index i = 0; i < 80; ++i) solutions.row(i) = powers(lengths[static_cast<std::size_t>(i)]) * a;
  const CrackMetaModel meta(lengths, solutions, 1e-10);
  EXPECT_EQ(meta.modes(), 4);
  EXPECT_EQ(meta.singular_values().size(), 30);
  EXPECT_LT(largest_error(meta, lengths, solutions), 1e-12);
  for (double l : {0.0, 0.00031, 0.0404, 0.07875, 0.079}) {
    const Eigen::VectorXd u = meta.space() * meta.coordinates({&l, 1});
    EXPECT_LT((u - (powers(l) * a).transpose()).cwiseAbs().maxCoeff(), 1e-11);
  }
}

TEST(NearestCrack, IsTheBestOfATenThousandLengths) {
  const auto lengths = millimetres();
  const CrackMetaModel meta(lengths, smooth_solutions(lengths, 60));
  const Eigen::MatrixXd factor = meta.space();
  const NearestCrack nearest(meta, factor);
  std::vector<double> fine;
  for (int i = 0; i <= 10000; ++i) fine.push_back(0.079 * i / 10000);
  const Eigen::MatrixXd cracks = factor * meta.coordinates(fine);
  // Fields of cracks, and between and beside them: with one minimum, several, or the best at an end.
  std::mt19937_64 engine(3);
  std::uniform_real_distribution<double> uniform;
  Eigen::MatrixXd targets(60, 300);
  for (Eigen::Index i = 0; i < targets.cols(); ++i) {
    const auto pick = [&] { return cracks.col(static_cast<Eigen::Index>(10000 * uniform(engine))); };
    const double share = 1.6 * uniform(engine) - 0.3;
    targets.col(i) = share * pick() + (1 - share) * pick();
  }
  const Eigen::VectorXd found = nearest.lengths(targets);
  for (Eigen::Index i = 0; i < targets.cols(); ++i) {
    const double least = (cracks.colwise() - targets.col(i)).colwise().squaredNorm().minCoeff();
    const double here = (factor * meta.coordinates({&found[i], 1}) - targets.col(i)).squaredNorm();
    EXPECT_LE(here, least + 1e-12 * targets.col(i).squaredNorm()) << i << ": " << found[i];
  }
}

TEST(CrackMetaModel, ToleranceDecidesTheModes) {
  const auto lengths = millimetres();
  const Eigen::MatrixXd solutions = smooth_solutions(lengths, 60);
  const CrackMetaModel fine(lengths, solutions, 1e-6), coarse(lengths, solutions, 1e-2);
  EXPECT_LT(coarse.modes(), fine.modes());
  const auto left_out = [](const CrackMetaModel& m) {
    return m.singular_values().tail(m.singular_values().size() - m.modes()).norm() /
           m.singular_values().norm();
  };
  EXPECT_LE(left_out(fine), 1e-6);
  EXPECT_LE(left_out(coarse), 1e-2);
  EXPECT_LT(largest_error(fine, lengths, solutions), 1e-4);
}

TEST(CrackMetaModel, SaysWhatIsWrongWithItsInput) {
  auto lengths = millimetres(5);
  Eigen::MatrixXd solutions = smooth_solutions(lengths, 3);
  const auto message = [&] {
    try {
      (void)CrackMetaModel(lengths, solutions);
    } catch (const DataError& e) {
      return std::string(e.what());
    }
    return std::string();
  };
  EXPECT_EQ(message(), "");
  solutions(2, 1) = std::nan("");
  EXPECT_NE(message().find("crack solutions[2,1] is not finite"), std::string::npos);
  solutions(2, 1) = 0;
  lengths[3] = lengths[2];
  EXPECT_NE(message().find("crack/length[3]"), std::string::npos);
  lengths.resize(3);
  EXPECT_NE(message().find("at least 4"), std::string::npos);
}

/// A crack whose field is linear in l makes Eq. 33 a product of normals.
TEST(CrackBridge, LinearGaussianClosedForm) {
  const auto lengths = millimetres();
  constexpr int n = 20;
  const Eigen::VectorXd direction = random_matrix(n, 1, 3);
  Eigen::MatrixXd solutions(80, n);
  for (Eigen::Index i = 0; i < 80; ++i)
    solutions.row(i) = lengths[static_cast<std::size_t>(i)] * direction.transpose();
  constexpr double imposed = 1e-4;
  const CrackBridgeOptions options{0.04, 0.004, 0.0405};
  const LinearPrediction prediction{imposed * 0.042 * direction + 2e-8 * random_matrix(n, 1, 4),
                                    1e-7 * random_matrix(n, 3, 5)};
  FunctionMoments moments{random_matrix(3, 1, 6), Eigen::MatrixXd::Identity(3, 3)};
  const auto result =
      CrackBridge(CrackMetaModel(lengths, solutions), prediction, imposed, options).published(moments, 1e-7);

  Eigen::MatrixXd covariance = prediction.modes * prediction.modes.transpose();
  covariance.diagonal().array() += 1e-14;
  const Eigen::VectorXd h = imposed * direction, y = prediction.lift + prediction.modes * moments.mean;
  const Eigen::VectorXd weighted = covariance.inverse() * h;
  const double precision = h.dot(weighted) + 1 / (0.004 * 0.004);
  const double mean = (weighted.dot(y) + 0.04 / (0.004 * 0.004)) / precision, std = 1 / std::sqrt(precision);
  EXPECT_NEAR(result.mean, mean, 1e-5 * std);
  EXPECT_NEAR(result.std, std, 1e-5 * std);
  EXPECT_NEAR(result.maximum_a_posteriori, mean, 1e-3 * std);
  EXPECT_NEAR(result.values[4] - result.values[0], 2 * 1.959963985 * std, 1e-3 * std);
}

TEST(CrackBridge, NoDataLeaveTheTruncatedPrior) {
  const auto lengths = millimetres();
  const Eigen::MatrixXd solutions = Eigen::MatrixXd::Ones(80, 4);  // a field that does not see the crack
  const LinearPrediction prediction{Eigen::VectorXd::Constant(4, 1e-4), Eigen::MatrixXd::Zero(4, 2)};
  const auto result = CrackBridge(CrackMetaModel(lengths, solutions), prediction, 1e-4)
                          .published({Eigen::VectorXd::Zero(2), Eigen::MatrixXd::Zero(2, 2)}, 1e-6);
  // N(0.04, 0.013²) cut at 0 and 79 mm: ±3 standard deviations, nearly symmetric.
  EXPECT_NEAR(result.maximum_a_posteriori, 0.04, 1e-6);
  EXPECT_NEAR(result.mean, 0.03998, 3e-5);
  EXPECT_NEAR(result.std, 0.013 * std::sqrt(1 - 2 * 3 * 0.004431848 / 0.9973), 3e-5);
}

void expect_as_brute_force(int n, Eigen::Index r, const Eigen::MatrixXd& root, double discrepancy,
                           int points) {
  SCOPED_TRACE(testing::Message() << n << " dofs, " << r << " functions");
  const auto lengths = millimetres();
  const Eigen::MatrixXd solutions = smooth_solutions(lengths, n);
  constexpr double imposed = 1.2e-4;
  const CrackBridgeOptions options{0.04, 0.013, 0.036};
  const LinearPrediction prediction{imposed * solutions.row(35).transpose() + 3e-7 * random_matrix(n, 1, 7),
                                    2e-6 * random_matrix(n, r, 8)};
  const FunctionMoments moments{0.1 * random_matrix(r, 1, 9), root * root.transpose()};
  const CrackBridge bridge(CrackMetaModel(lengths, solutions, 1e-9), prediction, imposed, options);
  const auto fast = bridge.published(moments, discrepancy);
  const auto slow =
      brute_force(lengths, solutions, prediction, imposed, options, discrepancy, moments, points);
  EXPECT_NEAR(fast.mean, slow.mean, 2e-4 * slow.std);
  EXPECT_NEAR(fast.std, slow.std, 2e-4 * slow.std);
  // A trapezoid rule cuts at the threshold only to a step.
  EXPECT_NEAR(fast.probability_above_threshold, slow.probability, 2e-3);
  double top = 0;
  for (double d : slow.density) top = std::max(top, d);
  for (std::size_t k = 0; k < fast.points.size(); ++k) {
    const double at = fast.points[k] / 0.079 * (points - 1);
    const auto i = std::min(static_cast<std::size_t>(at), slow.x.size() - 2);
    const double part = at - static_cast<double>(i);
    EXPECT_NEAR(fast.density[k], (1 - part) * slow.density[i] + part * slow.density[i + 1], 5e-3 * top);
  }
}

TEST(CrackBridge, AgreesWithDenseEvaluation) {
  expect_as_brute_force(12, 3, 0.5 * random_matrix(3, 3, 10), 1e-6, 20001);
  expect_as_brute_force(60, 8, 0.3 * random_matrix(8, 8, 11), 1e-6, 20001);
  expect_as_brute_force(5, 9, 0.3 * random_matrix(9, 9, 12), 2e-6, 5001);  // fewer dofs than functions
}

TEST(CrackBridge, DegenerateCovariances) {
  expect_as_brute_force(20, 4, Eigen::MatrixXd::Zero(4, 1), 1e-6, 20001);  // parameters known exactly
  expect_as_brute_force(20, 4, random_matrix(4, 1, 13), 1e-6, 20001);      // one direction only
  const auto lengths = millimetres();
  const Eigen::MatrixXd solutions = smooth_solutions(lengths, 30);
  // Uncertainty of metres against a discrepancy of a nanometre: nothing overflows, the prior is all there is.
  const LinearPrediction prediction{1e-4 * solutions.row(20).transpose(), random_matrix(30, 30, 14)};
  const auto wide =
      CrackBridge(CrackMetaModel(lengths, solutions), prediction, 1e-4, {0.04, 0.013, 0.04})
          .published({Eigen::VectorXd::Zero(30), 1e6 * Eigen::MatrixXd::Identity(30, 30)}, 1e-9);
  EXPECT_NEAR(wide.mean, 0.04, 1e-4);
  // A crack field known to a nanometre: the density is narrower than a micrometre, and every number finite.
  const LinearPrediction sharp{1e-4 * solutions.row(20).transpose(), Eigen::MatrixXd::Zero(30, 2)};
  const auto narrow = CrackBridge(CrackMetaModel(lengths, solutions, 1e-12), sharp, 1e-4, {0.04, 0.013, 0.04})
                          .published({Eigen::VectorXd::Zero(2), Eigen::MatrixXd::Zero(2, 2)}, 1e-9);
  EXPECT_NEAR(narrow.mean, 0.020, 1e-7);
  EXPECT_LT(narrow.std, 1e-6);
  EXPECT_GT(narrow.std, 0.0);
  for (double d : narrow.density) EXPECT_TRUE(std::isfinite(d));
}

TEST(CrackBridge, MonteCarloOverTheFields) {
  // π(l) ∝ π₀(l) E[N(u(l); y, δ² I)] over fields y ~ N(E[u], Cov[u]): sampled instead of integrated.
  const auto lengths = millimetres();
  constexpr int n = 6, samples = 40000;
  const Eigen::MatrixXd solutions = smooth_solutions(lengths, n);
  const LinearPrediction prediction{1e-4 * solutions.row(45).transpose(), 1e-6 * random_matrix(n, 2, 20)};
  const CrackBridgeOptions options{0.04, 0.013, 0.045};
  const FunctionMoments moments{Eigen::VectorXd::Zero(2), Eigen::MatrixXd::Identity(2, 2)};
  const CrackMetaModel meta(lengths, solutions, 1e-9);
  const auto fast = CrackBridge(meta, prediction, 1e-4, options).published(moments, 2e-6);
  std::mt19937_64 engine(21);
  std::normal_distribution<double> normal;
  std::vector<double> grid;
  for (int i = 0; i <= 400; ++i) grid.push_back(0.079 * i / 400);
  const Eigen::MatrixXd fields = 1e-4 * meta.space() * meta.coordinates(grid);
  Eigen::ArrayXd sum = Eigen::ArrayXd::Zero(401);
  for (int s = 0; s < samples; ++s) {
    const Eigen::VectorXd y =
        prediction.lift + prediction.modes * Eigen::Vector2d(normal(engine), normal(engine));
    sum += (-0.5 * (fields.colwise() - y).colwise().squaredNorm().array() / (2e-6 * 2e-6)).exp().transpose();
  }
  const Eigen::Map<const Eigen::ArrayXd> x(grid.data(), 401);
  sum *= (-0.5 * ((x - 0.04) / 0.013).square()).exp();
  const double mean = (sum * x).sum() / sum.sum();
  const double std = std::sqrt((sum * (x - mean).square()).sum() / sum.sum());
  EXPECT_NEAR(fast.mean, mean, 0.05 * std);
  EXPECT_NEAR(fast.std, std, 0.05 * std);
}

/// w(p) = v(l): every sample's field is that of a crack, so Eq. 14 must find its length.
TEST(CrackBridge, TheForecastFindsTheLengths) {
  const auto lengths = millimetres();
  const Eigen::MatrixXd solutions = smooth_solutions(lengths, 40);
  const CrackMetaModel meta(lengths, solutions, 1e-8);
  constexpr double imposed = 1.1e-4;
  const CrackBridge bridge(meta, {Eigen::VectorXd::Zero(40), imposed * meta.space()}, imposed, {});
  constexpr int n = 200;
  model::RowMatrix functions(n, meta.modes());
  Eigen::VectorXd truth(n);
  for (int i = 0; i < n; ++i) {
    truth[i] = 0.01 + 0.06 * (i + 0.5) / n;
    functions.row(i) = meta.coordinates({&truth[i], 1}).transpose();
  }
  EXPECT_LT((bridge.nearest(functions).length - truth).cwiseAbs().maxCoeff(), 1e-8);
  const CrackForecast forecast = bridge.update(functions, Eigen::VectorXd::Ones(n));
  const ScalarForecast& f = forecast.length;
  EXPECT_LT(forecast.discrepancy_std, 1e-12);
  EXPECT_NEAR(f.mean, 0.04, 1e-8);
  EXPECT_NEAR(f.std, 0.06 / std::sqrt(12.0), 1e-6);
  EXPECT_NEAR(f.probability_above_threshold, 0.5, 1e-12);
  // Beyond the longest crack the nearest one is the longest.
  functions.row(0) *= 0.0;
  functions.row(0) +=
      3.0 *
      (meta.coordinates(std::vector<double>{0.079}) - meta.coordinates(std::vector<double>{0.0})).transpose();
  EXPECT_GE(bridge.nearest(functions).length[0], 0.0);
  EXPECT_LE(bridge.nearest(functions).length[0], 0.079);
}

/// Fields y_k = h l_k + r_k with h linear in l: the nearest length is a projection, and what is left of y_k
/// its rest, both in closed form.
TEST(CrackBridge, TheForecastIsThePosteriorCarriedThroughTheNearestLength) {
  const auto lengths = millimetres();
  constexpr int n = 20, samples = 300;
  constexpr double imposed = 1e-4;
  const Eigen::VectorXd direction = random_matrix(n, 1, 3);
  Eigen::MatrixXd solutions(80, n);
  for (Eigen::Index i = 0; i < 80; ++i)
    solutions.row(i) = lengths[static_cast<std::size_t>(i)] * direction.transpose();
  const Eigen::VectorXd h = imposed * direction;
  const LinearPrediction prediction{0.042 * h, 2e-7 * random_matrix(n, 3, 5)};
  const model::RowMatrix functions = random_matrix(samples, 3, 6);
  Eigen::VectorXd weights = random_matrix(samples, 1, 7).cwiseAbs();
  weights.tail(50).setZero();
  const CrackMetaModel meta(lengths, solutions);
  const CrackForecast exact = CrackBridge(meta, prediction, imposed).update(functions, weights);
  const Eigen::MatrixXd fields =
      (prediction.modes * functions.transpose()).colwise() + prediction.lift;  // n × samples
  const Eigen::VectorXd l = fields.transpose() * h / h.squaredNorm();
  ASSERT_GT(l.minCoeff(), 0);
  ASSERT_LT(l.maxCoeff(), 0.079);
  const double total = weights.sum(), mean = weights.dot(l) / total;
  const double variance = (weights.array() * (l.array() - mean).square()).sum() / total;
  EXPECT_NEAR(exact.length.mean, mean, 1e-9);
  EXPECT_NEAR(exact.length.std, std::sqrt(variance), 1e-9);
  const Eigen::VectorXd rest = (fields - h * l.transpose()).colwise().squaredNorm().transpose();
  EXPECT_NEAR(exact.discrepancy_std, std::sqrt(weights.dot(rest) / total / (n - 1)), 1e-12);
  // What the crack that is meant may differ by is added.
  const CrackForecast meant =
      CrackBridge(meta, prediction, imposed, {0.04, 0.013, 0.04, 0.002}).update(functions, weights);
  EXPECT_NEAR(meant.length.mean, mean, 1e-9);
  EXPECT_NEAR(meant.length.std, std::hypot(std::sqrt(variance), 0.002), 1e-9);
}

/// Lengths that bend with two parameters, on 90,000 nodes of a narrow ridge: the draws have the moments of
/// all.
TEST(CrackBridge, OfManyPointsTheDrawsHaveTheDistributionOfTheLengths) {
  const auto lengths = millimetres();
  const CrackMetaModel meta(lengths, smooth_solutions(lengths, 40), 1e-8);
  constexpr double imposed = 1.1e-4;
  const CrackBridge bridge(meta, {Eigen::VectorXd::Zero(40), imposed * meta.space()}, imposed, {});
  constexpr int n = 300;
  model::RowMatrix functions(n * n, meta.modes());
  Eigen::VectorXd weights(n * n), truth(n * n);
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j) {
      const double a = -6 + 12.0 * i / (n - 1), b = -6 + 12.0 * j / (n - 1);
      const int k = i * n + j;
      weights[k] = std::exp(-0.5 * (a * a + b * b - 1.9 * a * b) / (1 - 0.95 * 0.95));
      truth[k] = 0.04 + 0.002 * a + 0.001 * b + 0.0003 * a * a;
      functions.row(k) = meta.coordinates({&truth[k], 1}).transpose();
    }
  }
  const double mean = weights.dot(truth) / weights.sum();
  const double std = std::sqrt((weights.array() * (truth.array() - mean).square()).sum() / weights.sum());
  const ScalarForecast f = bridge.update(functions, weights).length;
  EXPECT_NEAR(f.mean, mean, 2e-3 * std);
  EXPECT_NEAR(f.std, std, 5e-3 * std);
}

/// A field that is linear in a skewed number, beside a spread that no crack has: with the points at hand π_u
/// is a mixture of normal densities, which a trapezoid rule integrates. The map must find that, and the
/// normal form must not.
TEST(CrackBridge, TheInverseMapOfASkewedFieldIsTheMixtureOfItsPoints) {
  const auto lengths = millimetres();
  constexpr int n = 20, samples = 4000;
  constexpr double imposed = 1e-4, delta = 2e-7;
  const Eigen::MatrixXd directions =
      Eigen::HouseholderQR<Eigen::MatrixXd>(random_matrix(n, 2, 3)).householderQ() *
      Eigen::MatrixXd::Identity(n, 2);
  Eigen::MatrixXd solutions(80, n);
  for (Eigen::Index i = 0; i < 80; ++i)
    solutions.row(i) = lengths[static_cast<std::size_t>(i)] * directions.col(0).transpose();
  const Eigen::VectorXd h = imposed * directions.col(0);
  LinearPrediction prediction{0.03 * h, Eigen::MatrixXd(n, 2)};
  prediction.modes << 0.008 * h, 5e-7 * directions.col(1);
  model::RowMatrix functions = random_matrix(samples, 2, 6);
  functions.col(0) = (0.6 * functions.col(0)).array().exp();
  const Eigen::VectorXd weights = Eigen::VectorXd::Ones(samples);
  const CrackBridgeOptions options{0.04, 0.03, 0.045};
  const CrackBridge bridge(CrackMetaModel(lengths, solutions), prediction, imposed, options);
  const ScalarForecast mapped = bridge.published_by_map(functions, weights, delta);
  const ScalarForecast normal = bridge.published(moments_of_functions(functions, weights), delta);

  double total = 0, mean = 0, square = 0, above = 0;
  for (int i = 0; i <= 2000; ++i) {
    const double l = 0.079 * i / 2000;
    double density = 0;
    for (Eigen::Index k = 0; k < samples; ++k) {
      const double along = imposed * (l - 0.03 - 0.008 * functions(k, 0)), across = 5e-7 * functions(k, 1);
      density += std::exp(-0.5 * (along * along + across * across) / (delta * delta));
    }
    density *= std::exp(-0.5 * std::pow((l - 0.04) / 0.03, 2)) * (i == 0 || i == 2000 ? 0.5 : 1.0);
    total += density, mean += density * l, square += density * l * l;
    above += l > 0.045 ? density : 0.0;
  }
  mean /= total;
  const double std = std::sqrt(square / total - mean * mean), probability = above / total;
  EXPECT_NEAR(mapped.mean, mean, 0.05 * std);
  EXPECT_NEAR(mapped.std, std, 0.05 * std);
  EXPECT_NEAR(mapped.probability_above_threshold, probability, 0.02);
  EXPECT_GT(std::abs(normal.probability_above_threshold - probability), 0.05);
}

/// Where the field is normal both forms of Eq. 33 are the same; without any spread to the last digit.
TEST(CrackBridge, TheInverseMapOfANormalFieldIsTheNormalForm) {
  const auto lengths = millimetres();
  const Eigen::MatrixXd solutions = smooth_solutions(lengths, 25);
  const LinearPrediction prediction{1e-4 * solutions.row(45).transpose(), 1e-7 * random_matrix(25, 2, 5)};
  const CrackBridge bridge(CrackMetaModel(lengths, solutions), prediction, 1e-4);
  const model::RowMatrix functions = random_matrix(4000, 2, 8);
  const Eigen::VectorXd weights = Eigen::VectorXd::Ones(4000);
  const ScalarForecast normal = bridge.published(moments_of_functions(functions, weights), 1e-7);
  const ScalarForecast mapped = bridge.published_by_map(functions, weights, 1e-7);
  EXPECT_NEAR(mapped.mean, normal.mean, 0.1 * normal.std);
  EXPECT_NEAR(mapped.std, normal.std, 0.1 * normal.std);
  const model::RowMatrix same = model::RowMatrix::Zero(10, 2);
  const Eigen::VectorXd few = Eigen::VectorXd::Ones(10);
  EXPECT_EQ(bridge.published_by_map(same, few, 1e-7).mean,
            bridge.published(moments_of_functions(same, few), 1e-7).mean);
  EXPECT_THROW((void)bridge.published_by_map(same, few, 0.0), NumericalError);
}

/// δ of greatest evidence, the length integrated out under a flat prior, for fields that are cracks with
/// independent errors: a dense search over δ.
TEST(CrackBridge, TheDiscrepancyIsThatOfGreatestEvidence) {
  const auto lengths = millimetres();
  constexpr int n = 12;
  constexpr double imposed = 1e-4;
  const Eigen::VectorXd direction = random_matrix(n, 1, 13);
  Eigen::MatrixXd solutions(80, n);
  for (Eigen::Index i = 0; i < 80; ++i)
    solutions.row(i) = lengths[static_cast<std::size_t>(i)] * direction.transpose();
  const Eigen::VectorXd y = imposed * 0.05 * direction + 4e-7 * random_matrix(n, 1, 14);
  const CrackBridge bridge(CrackMetaModel(lengths, solutions), {y, Eigen::MatrixXd::Zero(n, 1)}, imposed);
  const double found = bridge.update(model::RowMatrix::Zero(1, 1), Eigen::VectorXd::Ones(1)).discrepancy_std;
  double best = -INFINITY, at = 0;
  for (double delta = 1e-7; delta < 2e-6; delta *= 1.002) {
    double sum = 0;
    for (int k = 0; k <= 20000; ++k) {
      const double l = 0.03 + 0.04 * k / 20000;
      sum += std::exp(-0.5 * (y - imposed * l * direction).squaredNorm() / (delta * delta));
    }
    const double evidence = std::log(sum) - n * std::log(delta);
    if (evidence > best) best = evidence, at = delta;
  }
  EXPECT_NEAR(found, at, 0.003 * at);
}

TEST(Forecaster, AHorizonBeforeTheLastDatumIsPast) {
  std::vector<NamedForecast> forecasts(2);
  forecasts[0].horizon = 0.3, forecasts[1].horizon = 1;
  mark_past(forecasts, 0.3);
  EXPECT_FALSE(forecasts[0].is_past);
  mark_past(forecasts, 0.31);
  EXPECT_TRUE(forecasts[0].is_past);
  EXPECT_FALSE(forecasts[1].is_past);
}

model::SeparatedModel random_model_with_cracks() {
  model::ModelContents contents = model::random_contents(model::Form::tree);
  contents.outputs.push_back({"imposed_displacement", {"m", ""}, std::vector<double>(5 * 6 * 4, 1.0)});
  contents.outputs.push_back({"force", {"N", ""}, model::normal_values(5 * 6 * 4, 11)});
  contents.crack = {{0.0, 0.001, 0.002, 0.003, 0.004},
                    model::normal_values(2 * contents.dofs.components.size(), 9),
                    model::normal_values(2 * 5, 10)};
  return model::SeparatedModel(std::move(contents));
}

/// Few points are evaluated one by one; the same points twice are many, and interpolated.
TEST(Forecaster, ManyPointsGiveWhatTheirValuesGive) {
  const model::SeparatedModel model = random_model_with_cracks();
  ForecastSpecification crack, force;
  crack.name = "crack", force.name = "force", force.output = "force";
  force.quantity = ForecastSpecification::Quantity::output;
  crack.horizon = force.horizon = 2.0;
  crack.threshold = 0.002;
  const Eigen::VectorXd lower = model.functions()->lower(), width = model.functions()->upper() - lower;
  for (const double std : {0.02, 0.2}) {
    Forecaster forecaster(model, model.contents().dofs, {crack, force});
    const Eigen::ArrayXXd z = 0.5 + std * numerics::monte_carlo_normal_points(250, 2, 4).array();
    const Eigen::MatrixXd points =
        (z.max(0.0).min(1.0).matrix() * width.asDiagonal()).rowwise() + lower.transpose();
    const auto few = forecaster.update(points, Eigen::VectorXd::Ones(250));
    const auto many = forecaster.update(points.replicate(2, 1), Eigen::VectorXd::Ones(500));
    for (std::size_t k = 0; k < 2; ++k) {
      const ScalarForecast &exact = few[k].forecast, &found = many[k].forecast;
      EXPECT_NEAR(found.mean, exact.mean, 1e-3 * exact.std) << few[k].name << ", " << std;
      EXPECT_NEAR(found.std, exact.std, 2e-3 * exact.std);
      for (std::size_t q = 0; q < exact.values.size(); ++q)
        EXPECT_NEAR(found.values[q], exact.values[q], 0.02 * exact.std);
    }
    EXPECT_NEAR(*many[0].bridge_residual_rms, *few[0].bridge_residual_rms,
                1e-3 * *few[0].bridge_residual_rms);
  }
}

TEST(Forecaster, ALengthOffsetMovesTheCrackAndNothingElse) {
  const model::SeparatedModel model = random_model_with_cracks();
  const auto& dofs = model.contents().dofs;
  ForecastSpecification elastic, meant;
  elastic.name = "elastic", meant.name = "meant";
  elastic.horizon = meant.horizon = 2.0;
  elastic.prior_mean = meant.prior_mean = 0.001;
  elastic.discrepancy_std = meant.discrepancy_std = 3;
  meant.length_offset = 0.005;
  elastic.threshold = 0.0012, meant.threshold = 0.0062;
  Forecaster forecaster(model, dofs, {elastic, meant});
  Eigen::MatrixXd points(2, 2);
  points.row(0) = model.functions()->lower().transpose();
  points.row(1) = 0.5 * (model.functions()->lower() + model.functions()->upper()).transpose();
  const Eigen::Vector2d weights(0.4, 0.6);
  for (const auto& both : {forecaster.update(points, weights), forecaster.published(points, weights)}) {
    const ScalarForecast &a = both[0].forecast, &b = both[1].forecast;
    EXPECT_NEAR(b.mean - a.mean, 0.005, 1e-15);
    EXPECT_NEAR(b.maximum_a_posteriori - a.maximum_a_posteriori, 0.005, 1e-15);
    EXPECT_NEAR(b.values[4] - a.values[4], 0.005, 1e-15);
    EXPECT_NEAR(b.points.back() - a.points.back(), 0.005, 1e-15);
    EXPECT_EQ(b.std, a.std);
    EXPECT_EQ(b.density, a.density);
    EXPECT_NEAR(b.probability_above_threshold, a.probability_above_threshold, 1e-9);
  }
}

TEST(LengthCurve, IsLinearBetweenPointsAndMovesWhatIsBeyond) {
  const LengthCurve curve({{0.01, 0.012}, {0.02, 0.03}, {0.04, 0.035}});
  for (const auto& [elastic, meant] : {std::pair{0.004, 0.006},
                                       {0.01, 0.012},
                                       {0.015, 0.021},
                                       {0.02, 0.03},
                                       {0.03, 0.0325},
                                       {0.05, 0.045}}) {
    EXPECT_NEAR(curve(elastic), meant, 1e-15);
    EXPECT_NEAR(curve.inverse(meant), elastic, 1e-15);
  }
  EXPECT_EQ(LengthCurve()(0.03), 0.03);
  for (const LengthCurve::Points& points :
       {LengthCurve::Points{{0.01, 0.02}, {0.01, 0.03}}, {{0.01, 0.02}, {0.02, 0.02}}})
    try {
      const LengthCurve wrong(points);
      FAIL();
    } catch (const ProjectError& error) {
      EXPECT_NE(std::string(error.what()).find("length_curve[1] = [0.0"), std::string::npos) << error.what();
      EXPECT_NE(std::string(error.what()).find("increase from point to point"), std::string::npos);
    }
}

TEST(LengthCurve, CarriesAForecastAsItCarriesItsSamples) {
  // A normal elastic length of 30 ± 3 mm, kinked at 31 mm: density and samples give the same forecast.
  const LengthCurve curve({{0.0, 0.004}, {0.031, 0.036}, {0.08, 0.06}});
  std::vector<double> base, log_base;
  const auto log_density = [](std::span<const double> l, std::span<double> out) {
    for (std::size_t i = 0; i < l.size(); ++i) out[i] = -0.5 * std::pow((l[i] - 0.03) / 0.003, 2);
  };
  for (int i = 0; i <= 160; ++i) base.push_back(0.0005 * i);
  log_base.resize(base.size());
  log_density(base, log_base);
  const double threshold = 0.035;
  const ScalarForecast carried =
      curve(forecast_of_density(base, log_base, log_density, curve.inverse(threshold)));
  constexpr Eigen::Index n = 20001;
  Eigen::VectorXd samples(n);
  for (Eigen::Index i = 0; i < n; ++i)
    samples[i] = curve(0.03 + 0.003 * numerics::normal_quantile((static_cast<double>(i) + 0.5) / n));
  const ScalarForecast sampled = forecast_of_samples(samples, Eigen::VectorXd::Ones(n), threshold);
  EXPECT_NEAR(carried.mean, sampled.mean, 6e-6);  // a quarter per cent of the standard deviation
  EXPECT_NEAR(carried.std, sampled.std, 6e-6);
  EXPECT_NEAR(carried.probability_above_threshold, sampled.probability_above_threshold, 1e-3);
  for (std::size_t k = 0; k < carried.values.size(); ++k)
    EXPECT_NEAR(carried.values[k], sampled.values[k], 2e-6);
  double mass = 0;
  for (std::size_t i = 0; i + 1 < carried.points.size(); ++i)
    mass += 0.5 * (carried.density[i] + carried.density[i + 1]) * (carried.points[i + 1] - carried.points[i]);
  EXPECT_NEAR(mass, 1, 0.01);
}

TEST(CrackBridge, SaysWhatIsWrongWithItsOptions) {
  const auto lengths = millimetres();
  const Eigen::MatrixXd solutions = smooth_solutions(lengths, 4);
  const auto message = [&](CrackBridgeOptions options, double imposed, Eigen::Index dofs) {
    try {
      (void)CrackBridge(CrackMetaModel(lengths, solutions),
                        {Eigen::VectorXd::Zero(dofs), Eigen::MatrixXd::Zero(dofs, 1)}, imposed, options);
    } catch (const Error& e) {
      return std::string(e.what());
    }
    return std::string();
  };
  EXPECT_EQ(message({}, 1e-4, 4), "");
  EXPECT_NE(message({0.04, -1.0, 0.04}, 1e-4, 4).find("std positive"), std::string::npos);
  EXPECT_NE(message({}, 0.0, 4).find("choose a later horizon"), std::string::npos);
  EXPECT_NE(message({}, 1e-4, 5).find("at 4 observed dofs"), std::string::npos);
}

}  // namespace
}  // namespace knothe::assimilation
