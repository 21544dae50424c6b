#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>
#include <limits>
#include <random>

#include "knothe/knothe.hpp"
#include "knothe/model/testing/test_models.hpp"

namespace knothe {
namespace {

std::string message_of(const std::function<void()>& call) {
  try {
    call();
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

/// A model of random modes in a file of its own, some of its dofs, and data of it at given parameters.
class FacadeOfAssimilation : public ::testing::Test {
 protected:
  void SetUp() override {
    model::ModelContents contents = model::random_contents(model::Form::tree);
    for (std::size_t i = 0; i < 8; ++i) {
      sensors_.points.insert(sensors_.points.end(), contents.dofs.points.begin() + 9 * static_cast<long>(i),
                             contents.dofs.points.begin() + 9 * static_cast<long>(i) + 3);
      sensors_.components.push_back(static_cast<int>(contents.dofs.components[3 * i]));
    }
    model::write_model(contents, path_);
  }
  void TearDown() override { std::filesystem::remove(path_); }

  [[nodiscard]] Assimilation make() const {
    return {path_,
            sensors_,
            {.std = std::vector<double>(8, 0.5)},
            {Prior::uniform("Ad", 0.6, 1.4), Prior::normal("Y0", 1.0, 0.2)}};
  }
  [[nodiscard]] Datum datum(const Assimilation& assimilation, std::size_t step) const {
    std::vector<double> values = assimilation.predict(std::vector{0.9, 1.1}, step);
    for (std::size_t i = 0; i < values.size(); ++i)
      values[i] += 0.5 * std::sin(static_cast<double>(5 * i + step));
    return {step, values};
  }

  Sensors sensors_;
  std::string path_ = ::testing::TempDir() + "knothe_facade_model_" +
                      ::testing::UnitTest::GetInstance()->current_test_info()->name() + ".h5";
};

TEST_F(FacadeOfAssimilation, DependsOnTheSetOfDataAlone) {
  Assimilation forward = make(), other = make();
  EXPECT_EQ(forward.times().size(), 4U);
  for (const std::size_t step : {0, 1, 2, 3}) (void)forward.assimilate(datum(forward, step));
  const Posterior without = forward.withdraw(1);
  (void)other.assimilate(datum(other, 3));
  (void)other.assimilate(datum(other, 0));
  const Posterior expected = other.assimilate(datum(other, 2));
  EXPECT_EQ(forward.steps(), (std::vector<std::size_t>{0, 2, 3}));
  EXPECT_EQ(without.mean, expected.mean);
  EXPECT_EQ(without.points, expected.points);
  EXPECT_EQ(without.weights, expected.weights);
  EXPECT_EQ(without.log_evidence, expected.log_evidence);
}

TEST_F(FacadeOfAssimilation, APosteriorIsItsWeightedPoints) {
  Assimilation assimilation = make();
  const Posterior posterior = assimilation.assimilate(datum(assimilation, 2));
  ASSERT_EQ(posterior.dimension(), 2U);
  ASSERT_EQ(posterior.points.size(), 2 * posterior.weights.size());
  ASSERT_EQ(posterior.quantiles.size(), 2 * posterior.levels.size());
  for (std::size_t k = 0; k < 2; ++k) {
    double mean = 0, square = 0;
    for (std::size_t i = 0; i < posterior.weights.size(); ++i) {
      mean += posterior.weights[i] * posterior.points[2 * i + k];
      square += posterior.weights[i] * posterior.points[2 * i + k] * posterior.points[2 * i + k];
    }
    EXPECT_NEAR(mean, posterior.mean[k], 1e-9);
    EXPECT_NEAR(std::sqrt(square - mean * mean), posterior.std(k), 1e-3 * posterior.std(k));
  }
}

TEST_F(FacadeOfAssimilation, ADatumBringsItsNoise) {
  Assimilation own = make(), plain = make(), correlated = make();
  Datum noisy = datum(own, 2);
  noisy.noise.std.assign(8, 5.0);
  Datum same = noisy;
  same.noise = {};
  for (std::size_t i = 0; i < 8; ++i) {
    same.noise.precision.row_begin.push_back(static_cast<std::int64_t>(i));
    same.noise.precision.columns.push_back(static_cast<std::int64_t>(i));
    same.noise.precision.values.push_back(1 / 25.0);
  }
  same.noise.precision.row_begin.push_back(8);
  const Posterior wide = own.assimilate(noisy);
  EXPECT_GT(wide.std(0), plain.assimilate(datum(plain, 2)).std(0));
  EXPECT_NEAR(correlated.assimilate(same).mean[0], wide.mean[0], 1e-9);
}

TEST_F(FacadeOfAssimilation, SeriesStandBehindTheDisplacementsOrAlone) {
  // An output of the model, whose values at the nodes of the grid are known: exact there.
  const model::SeparatedModel model(model::read_model(path_), path_);
  const std::vector<Prior> priors = {Prior::uniform("Ad", 0.6, 1.4), Prior::normal("Y0", 1.0, 0.2)};
  Sensors both = sensors_;
  both.series = {"force"};
  Assimilation with(path_, both, {.std = std::vector<double>(9, 0.5)}, priors);
  Assimilation alone(path_, {.series = {"force"}}, {.std = {0.5}}, priors);
  const std::vector<double> p = {0.9, 1.1}, in_model = {1.1, 0.9};  // Ad, Y0 and the file's order
  for (const std::size_t step : {0, 3}) {
    const double force = model.evaluate_output("force", in_model).value[step];
    ASSERT_EQ(with.predict(p, step).size(), 9U);
    EXPECT_NEAR(with.predict(p, step)[8], force, 1e-6 * std::abs(force));
    EXPECT_NEAR(alone.predict(p, step)[0], force, 1e-6 * std::abs(force));
  }
  EXPECT_TRUE(alone.assimilate({1, alone.predict(p, 1)}).trusted);
  try {
    Assimilation unknown(path_, {.series = {"farce"}}, {.std = {0.5}}, priors);
    FAIL();
  } catch (const UsageError& error) {
    EXPECT_NE(std::string(error.what()).find("did you mean \"force\"?"), std::string::npos) << error.what();
  }
}

TEST_F(FacadeOfAssimilation, MistakesAreExplained) {
  Assimilation assimilation = make();
  const auto says = [](const std::string& message, const char* part) {
    EXPECT_NE(message.find(part), std::string::npos) << message;
  };
  says(message_of([&] {
         (void)assimilation.assimilate({4, std::vector<double>(8)});
       }),
       "step 4: the model has the steps 0 to 3");
  says(message_of([&] { (void)assimilation.assimilate({0, {1.0}}); }), "1 value for 8 sensors");
  says(message_of([&] {
         (void)assimilation.assimilate({0, std::vector<double>(8), {.std = {1.0}}});
       }),
       "noise of 1 value for 8 sensors");
  says(message_of([&] { (void)assimilation.predict(std::vector{1.0}, 0); }), "the model has 2");
  says(message_of([&] { (void)assimilation.withdraw(2); }), "2");
  says(message_of([&] { Assimilation(path_, {{0, 0}, {0}}, {{1.0}}, {}); }), "1 sensor with 2 coordinates");
}

/// x ~ N(0, 1), y ~ N(x²/2, 0.5²).
Density ridge() {
  return {2, [](std::span<const double> p) {
            const double u = 2 * p[1] - p[0] * p[0];
            return -0.5 * (p[0] * p[0] + u * u);
          }};
}

TEST(FacadeOfMaps, GoesThereAndBack) {
  const auto [map, posterior] = solve_map(ridge(), {.triangular = true});
  EXPECT_TRUE(posterior.trusted) << posterior.remark;
  EXPECT_NEAR(posterior.log_evidence, std::log(M_PI), 2e-3);
  const std::vector<double> reference = {0.3, -1.2, 1.5, 0.4}, points = map.evaluate(reference);
  const std::vector<double> back = map.inverse(points);
  for (std::size_t i = 0; i < 4; ++i) EXPECT_NEAR(back[i], reference[i], 1e-9);
  EXPECT_NEAR(map.log_density(std::vector{0.4, 0.2})[0],
              ridge().log_value(std::vector{0.4, 0.2}) - std::log(M_PI), 0.05);
  const std::vector<double> draws = map.conditional_sample(std::vector{1.0}, 5000, 3);
  double mean = 0;
  for (std::size_t i = 1; i < draws.size(); i += 2) mean += draws[i] / 5000;
  EXPECT_NEAR(mean, 0.5, 0.03);
  EXPECT_EQ(map.sample(10, 4), map.sample(10, 4));
  EXPECT_NE(message_of([&] { (void)map.evaluate(std::vector{1.0}); }).find("not a multiple of 2"),
            std::string::npos);
}

/// log τ ~ N(0, 1), eight x ~ N(0, τ²), each seen as y ~ N(x, 0.5²): a funnel, which no map of order 1
/// represents. Given τ everything is Gaussian, so that a sum over log τ is exact.
TEST(FacadeOfMaps, AFunnelIsAnsweredByAFewVariablesFirst) {
  constexpr std::size_t n = 8;
  const std::vector<double> y = {0.3, -0.2, 1.1, 0.4, -0.9, 0.1, 0.6, -0.5};
  const auto residual = [&](std::span<const double> p, std::size_t i) { return (y[i] - p[i + 1]) / 0.25; };
  const Density funnel{
      n + 1,
      [&](std::span<const double> p) {
        double value = -0.5 * p[0] * p[0] - n * p[0];
        for (std::size_t i = 0; i < n; ++i)
          value -= 0.5 * (p[i + 1] * p[i + 1] * std::exp(-2 * p[0]) + 0.25 * std::pow(residual(p, i), 2));
        return value;
      },
      [&](std::span<const double> p, std::span<double> slope) {
        const double precision = std::exp(-2 * p[0]);
        slope[0] = -p[0] - static_cast<double>(n);
        for (std::size_t i = 0; i < n; ++i) {
          slope[0] += precision * p[i + 1] * p[i + 1];
          slope[i + 1] = -precision * p[i + 1] + residual(p, i);
        }
      }};
  const auto [map, posterior] = solve_map(funnel, {.max_order = 1, .evaluations = 100'000'000});
  EXPECT_TRUE(posterior.trusted) << posterior.remark;
  EXPECT_NE(posterior.remark.find("by weighted draws, variable 0 first"), std::string::npos)
      << posterior.remark;
  double sum = 0, mean = 0, square = 0, first = 0;
  for (double s = -8; s < 8; s += 0.01) {
    const double variance = std::exp(2 * s), share = variance / (variance + 0.25);  // of y that is x
    double log_weight = -0.5 * s * s;
    for (const double v : y) log_weight -= 0.5 * (v * v / (variance + 0.25) + std::log(variance + 0.25));
    const double weight = std::exp(log_weight);
    sum += weight, mean += weight * s, square += weight * s * s, first += weight * share * y[2];
  }
  mean /= sum;
  const double std = std::sqrt(square / sum - mean * mean);
  EXPECT_NEAR(posterior.mean[0], mean, 0.1 * std);
  EXPECT_NEAR(posterior.std(0), std, 0.05 * std);
  EXPECT_NEAR(posterior.mean[3], first / sum, 0.1 * posterior.std(3));
}

/// A density with hard ends: of no map, and without a budget of no end.
TEST(FacadeOfMaps, ABudgetEndsWithTheBestAnswer) {
  std::int64_t calls = 0;
  const Density exponential{2, [&](std::span<const double> p) {
                              ++calls;
                              return p[0] >= 0 && p[1] >= 0 ? -p[0] - p[1] : -INFINITY;
                            }};
  const auto [map, posterior] = solve_map(exponential, {.evaluations = 40'000});
  EXPECT_LE(calls, 40'000);
  EXPECT_EQ(posterior.evaluations, calls);
  EXPECT_FALSE(map.trusted());
  EXPECT_TRUE(posterior.trusted) << posterior.remark;
  EXPECT_NE(posterior.remark.find("by weighted draws: a mean is off by at most"), std::string::npos)
      << posterior.remark;
  for (std::size_t k = 0; k < 2; ++k) {
    EXPECT_NEAR(posterior.mean[k], 1, 0.1);
    EXPECT_NEAR(posterior.std(k), 1, 0.05);
  }
  calls = 0;
  const MapSolution less = solve_map(exponential, {.evaluations = 1500});
  EXPECT_LE(calls, 1500);
  EXPECT_FALSE(less.posterior.trusted);
  EXPECT_NE(less.posterior.remark.find("the budget of 1500 calls is spent: evaluations = 3000 goes on"),
            std::string::npos)
      << less.posterior.remark;
  EXPECT_NE(message_of([&] {
              (void)solve_map(exponential, {.evaluations = 3});
            }).find("the budget of 3 calls is spent: evaluations = 6 goes on from here; there is no answer"),
            std::string::npos);
  EXPECT_NE(message_of([&] { (void)solve_map(exponential, {.evaluations = -1}); }).find("-1 evaluations"),
            std::string::npos);
}

TEST(FacadeOfMaps, OfSamples) {
  std::mt19937 generator(1);
  std::normal_distribution<double> normal;
  std::vector<double> samples;
  for (int i = 0; i < 2000; ++i) {
    const double x = normal(generator);
    samples.insert(samples.end(), {x, 0.5 * x * x + 0.5 * normal(generator)});
  }
  const auto map = TransportMap::from_samples(samples, 2);
  const std::vector<double> point = {0.5, 0.3}, back = map.evaluate(map.inverse(point));
  EXPECT_NEAR(back[0], point[0], 1e-9);
  EXPECT_NEAR(back[1], point[1], 1e-9);
  EXPECT_NEAR(map.log_density(point)[0], ridge().log_value(point) - std::log(M_PI), 0.25);
  EXPECT_TRUE(map.trusted()) << map.remark();
}

TEST(FacadeOfMaps, OfSamplesSayWhetherTheirFitsConverged) {
  // y from 1e-13 to 1e13: Newton's method often ends at its limit.
  const std::string path = ::testing::TempDir() + "knothe_facade_doubt.h5";
  int doubted = 0;
  for (std::uint32_t seed = 1; seed < 6; ++seed) {
    std::mt19937 generator(seed);
    std::normal_distribution<double> normal;
    std::vector<double> samples;
    for (int i = 0; i < 400; ++i) {
      const double x = normal(generator);
      samples.insert(samples.end(), {x, std::exp(10 * x)});
    }
    const auto map = TransportMap::from_samples(samples, 2, {.max_order = 8, .folds = 0});
    EXPECT_EQ(map.trusted(), map.remark().empty());
    doubted += map.trusted() ? 0 : 1;
    if (!map.trusted()) {
      EXPECT_NE(map.remark().find("component 1: the minimiser stopped with"), std::string::npos);
    }
    map.save(path);
    EXPECT_EQ(TransportMap::load(path).trusted(), map.trusted());
    EXPECT_EQ(TransportMap::load(path).remark(), map.remark());
  }
  EXPECT_GE(doubted, 1);
  std::filesystem::remove(path);
}

/// Dots at random places, moved by (u, v).
GreyPicture speckle(double u, double v) {
  GreyPicture picture{96, 80, std::vector<float>(std::size_t{96} * 80, 40.0F), 255};
  std::mt19937 generator(1);
  std::uniform_real_distribution<double> place(0, 96);
  for (int dot = 0; dot < 500; ++dot) {
    const double at_x = place(generator) + u, at_y = place(generator) + v;
    for (int y = 0; y < 80; ++y)
      for (int x = 0; x < 96; ++x) {
        const double distance = (x - at_x) * (x - at_x) + (y - at_y) * (y - at_y);
        picture.pixels[static_cast<std::size_t>(96 * y + x)] +=
            static_cast<float>(40 * std::exp(-distance / 8));
      }
  }
  return picture;
}

TEST(FacadeOfMaps, AFileGivesTheSameMapWhicheverWayItGoes) {
  const std::string path = ::testing::TempDir() + "knothe_facade_map.h5";
  const Density normal{.dimension = 2, .log_value = [](auto p) {
                         return -0.5 * (p[0] * p[0] + (p[1] - p[0] * p[0]) * (p[1] - p[0] * p[0]));
                       }};
  std::mt19937 generator(3);
  std::normal_distribution<double> gauss;
  std::vector<double> samples;
  for (int i = 0; i < 400; ++i) {
    const double x = gauss(generator);
    samples.insert(samples.end(), {x, 0.5 * x + 0.3 * gauss(generator)});
  }
  const std::vector<double> points{0.3, -0.2, 1.1, 0.4};
  for (const TransportMap& map : {solve_map(normal).map, TransportMap::from_samples(samples, 2)}) {
    map.save(path);
    const TransportMap read = TransportMap::load(path);
    EXPECT_EQ(read.evaluate(points), map.evaluate(points));
    EXPECT_EQ(read.inverse(points), map.inverse(points));
    EXPECT_EQ(read.log_density(points), map.log_density(points));
    EXPECT_EQ(read.sample(5, 7), map.sample(5, 7));
  }
  std::filesystem::remove(path);
  EXPECT_THROW((void)TransportMap::load(path), DataError);
}

TEST(FacadeOfCorrelation, MistakesAreExplainedAndPlacesFound) {
  EXPECT_NE(message_of([] {
              Correlation({8, 8, {}, 255});
            }).find("8 x 8 pixels with 0 grey levels"),
            std::string::npos);
  Correlation correlation(speckle(0, 0), {.element_size = 16});
  EXPECT_NE(message_of([&] {
              (void)correlation.at(std::vector{40.0, 40.0});
            }).find("correlate a picture first"),
            std::string::npos);
  for (const auto& [node, text] : {std::pair{4, "element 0 has the node 4; there are 4 nodes"},
                                   std::pair{2, "node 3 belongs to no element; leave it out"}}) {
    const PictureMesh mesh{{10, 70, 70, 10}, {10, 10, 70, 70}, {{0, 1, node, -1}}};
    EXPECT_NE(message_of([&] { Correlation(speckle(0, 0), {.mesh = mesh}); }).find(text), std::string::npos);
  }
  const PictureMesh triangles{{10, 70, 70, 10}, {10, 10, 70, 70}, {{0, 1, 2, -1}, {0, 2, 3, -1}}};
  Correlation on_triangles(speckle(0, 0), {.mesh = triangles});
  EXPECT_EQ(on_triangles.elements(), triangles.elements);
  EXPECT_NEAR(on_triangles.correlate(speckle(0.4, -0.2)).u[2], 0.4, 0.02);
  const Displacements displacements = correlation.correlate(speckle(0.4, -0.2));
  ASSERT_TRUE(displacements.converged) << displacements.message;
  EXPECT_EQ(displacements.precision.row_begin.size(), 2 * displacements.u.size() + 1);
  const std::vector<double> at = correlation.at(std::vector{40.0, 40.0, -5.0, 3.0});
  EXPECT_NEAR(at[0], 0.4, 0.02);
  EXPECT_NEAR(at[1], -0.2, 0.02);
  EXPECT_TRUE(std::isnan(at[2]));
}

}  // namespace
}  // namespace knothe
