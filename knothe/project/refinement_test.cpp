#include "knothe/project/refinement.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fmt/format.h>

#include <numeric>
#include <random>

#include "knothe/base/error.hpp"
#include "knothe/files/testing/test_folder.hpp"
#include "knothe/likelihood/data/synthetic_measurements.hpp"
#include "knothe/model/testing/test_models.hpp"

namespace knothe::project {
namespace {

using Eigen::Index;
using Eigen::VectorXd;
using model::Snapshots;

constexpr std::size_t k_dofs = 20, k_times = 10;
constexpr double k_noise = 1e-7;  // m

/// A front that travels along 20 dofs: what stands for a full-order model, known at every point.
double front(std::size_t dof, double t, std::span<const double> p) {
  const double x = static_cast<double>(dof) / k_dofs;
  return 1e-4 * (t * x + 0.2 / (1 + std::exp(-8 * (t * p[0] - x - 0.3 * p[1]))));
}

Snapshots front_on(std::vector<model::Axis> axes) {
  std::vector<double> time;
  for (std::size_t i = 0; i < k_times; ++i) time.push_back(0.1 * static_cast<double>(i + 1));
  Snapshots snapshots = model::snapshots_of(front, std::move(axes), time, k_dofs);
  for (std::size_t i = 0; i < k_dofs; ++i)
    snapshots.dofs.add(std::array{0.01 * static_cast<double>(i), 0.0, 0.0}, 0);
  return snapshots;
}

std::vector<model::Axis> five_by_five() {
  const std::vector<double> nodes = {0.5, 0.75, 1.0, 1.25, 1.5};
  return {{.name = "a", .nodes = nodes}, {.name = "b", .nodes = nodes}};
}

/// Solves by the formula, and counts.
class FrontSimulator final : public model::Simulator {
 public:
  explicit FrontSimulator(std::vector<std::string> names = {"a", "b"}) : names_(std::move(names)) {}
  [[nodiscard]] std::string key(std::span<const double> p) const override {
    return "front at " + model::describe(names_, p);
  }
  [[nodiscard]] Snapshots solve(std::span<const double> p) override {
    return front_on({{.name = names_[0], .nodes = {p[0]}}, {.name = names_[1], .nodes = {p[1]}}});
  }

 private:
  std::vector<std::string> names_;
};

/// Mean and standard deviation of the exact posterior, uniform prior on the box, by the midpoint rule on
/// grids that zoom in.
struct ExactPosterior {
  VectorXd mean, std;
};
ExactPosterior exact_posterior(const likelihood::Measurements& data) {
  constexpr Index n = 81;
  Eigen::Vector2d low(0.5, 0.5), high(1.5, 1.5), mean, std;
  for (int zoom = 0; zoom < 4; ++zoom) {
    Eigen::MatrixXd log_likelihood(n, n);
    const Eigen::Vector2d step = (high - low) / n;
    for (Index i = 0; i < n; ++i)
      for (Index j = 0; j < n; ++j) {
        const std::array<double, 2> p = {low[0] + (static_cast<double>(i) + 0.5) * step[0],
                                         low[1] + (static_cast<double>(j) + 0.5) * step[1]};
        double misfit = 0;
        for (std::size_t t = 0; t < k_times; ++t)
          for (std::size_t dof = 0; dof < k_dofs; ++dof) {
            const double residual =
                data.values(static_cast<Index>(dof), static_cast<Index>(t)) - front(dof, data.time[t], p);
            misfit += residual * residual;
          }
        log_likelihood(i, j) = -0.5 * misfit / (k_noise * k_noise);
      }
    Eigen::ArrayXXd weight = (log_likelihood.array() - log_likelihood.maxCoeff()).exp();
    weight /= weight.sum();
    for (int a = 0; a < 2; ++a) {
      const Eigen::ArrayXd marginal = a == 0 ? Eigen::ArrayXd(weight.rowwise().sum())
                                             : Eigen::ArrayXd(weight.colwise().sum().transpose());
      const Eigen::ArrayXd at = low[a] + (Eigen::ArrayXd::LinSpaced(n, 0, n - 1) + 0.5) * step[a];
      mean[a] = (marginal * at).sum();
      std[a] = std::max(std::sqrt((marginal * (at - mean[a]).square()).sum()), step[a]);
    }
    low = low.cwiseMax(mean - 7 * std);
    high = high.cwiseMin(mean + 7 * std);
  }
  return {mean, std};
}

/// All data of a project, and the result of the last.
struct Assimilated {
  std::unique_ptr<assimilation::Engine> engine;
  assimilation::StepResult result;
};
Assimilated assimilate(const Project& project) {
  UpdateSetup setup = set_up(project);
  Assimilated all{std::make_unique<assimilation::Engine>(engine_setup(project, setup)), {}};
  RecordedData data(std::move(setup));
  while (auto item = data.next({})) all.result = all.engine->assimilate(item->datum);
  return all;
}

class RefinementTest : public testing::Test {
 protected:
  void SetUp() override {
    const Snapshots snapshots = front_on(five_by_five());
    model::CompressionOptions compression;
    compression.modes = 20;
    const model::ModelContents model = model::compress(snapshots, compression);
    std::vector<model::OffGridSolution> off_grid;
    for (const auto& p :
         {std::vector{0.61, 1.4}, std::vector{1.37, 0.66}, std::vector{0.87, 0.91}, std::vector{1.12, 1.14}})
      off_grid.push_back(
          {p, front_on({{.name = "a", .nodes = {p[0]}}, {.name = "b", .nodes = {p[1]}}}).values});
    model::write_model(model, model::truncation_error(model, snapshots, off_grid), folder_ + "model.h5");
  }

  void write_data(const std::array<double, 2>& truth, std::uint64_t seed) {
    const Snapshots exact =
        front_on({{.name = "a", .nodes = {truth[0]}}, {.name = "b", .nodes = {truth[1]}}});
    std::vector<std::size_t> all(k_dofs);
    std::iota(all.begin(), all.end(), std::size_t{0});
    measurements_ = likelihood::add_noise(
        exact.dofs, all, exact.time, Eigen::Map<const Eigen::MatrixXd>(exact.values.data(), k_dofs, k_times),
        k_noise, seed);
    likelihood::write_measurements(folder_ + "data.h5", measurements_, "", seed);
  }

  [[nodiscard]] Project project(const std::string& more = "") const {
    return parse_project(fmt::format("model = \"model.h5\"\ndata = \"data.h5\"\nresults = \"results/\"\n"
                                     "[parameters]\na = {{ prior = \"uniform\", lower = 0.5, upper = 1.5 }}\n"
                                     "b = {{ prior = \"uniform\", lower = 0.5, upper = 1.5 }}\n{}",
                                     more),
                         folder_ + "project.toml");
  }

  /// Assimilates all data, then asks the full-order model.
  struct Run {
    assimilation::StepResult before, after;
    std::size_t runs = 0, version = 0;
  };
  [[nodiscard]] Run run(const Project& project, std::vector<std::string> names = {"a", "b"}) const {
    UpdateSetup setup = set_up(project);
    auto engine = std::make_unique<assimilation::Engine>(engine_setup(project, setup));
    RecordedData data(std::move(setup));
    Run run;
    while (auto item = data.next({})) run.after = engine->assimilate(item->datum);
    run.before = run.after;
    Refinement refinement(project, data.setup(), std::make_unique<FrontSimulator>(std::move(names)),
                          folder_ + "refined");
    EXPECT_TRUE(refinement.refine(engine, run.after, 14, true));
    run.runs = refinement.runs();
    run.version = refinement.version();
    return run;
  }

  files::TestFolder files_;  // each test is a process of its own beside others
  const std::string folder_ = files_.file("");
  likelihood::Measurements measurements_;
};

TEST_F(RefinementTest, ThePosteriorBecomesThatOfTheFullOrderModel) {
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> inside(0.6, 1.4);
  int was_wrong = 0;
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const std::array<double, 2> truth = {inside(random), inside(random)};
    write_data(truth, seed);
    const Run run = this->run(project());
    const ExactPosterior exact = exact_posterior(measurements_);
    const auto off = [&](const posterior::Posterior& p) {
      return (p.mean - exact.mean).cwiseQuotient(exact.std).cwiseAbs().maxCoeff();
    };
    was_wrong += off(run.before.update) > 1;
    EXPECT_LT(off(run.after.update), 0.1) << truth[0] << " " << truth[1];
    const VectorXd ratio = run.after.update.standard_deviations().cwiseQuotient(exact.std);
    EXPECT_LT((ratio.array() - 1).abs().maxCoeff(), 0.05) << truth[0] << " " << truth[1];
    EXPECT_LE(run.runs, 14u);
    EXPECT_EQ(run.after.model_version, run.version);
    EXPECT_EQ(run.after.update.verdict.level, assimilation::VerdictLevel::ok)
        << assimilation::verdict_text(run.after.update.verdict);
  }
  EXPECT_GE(was_wrong, 10);  // or there was nothing to refine
}

TEST_F(RefinementTest, WhatItLeavesOfTheModelsErrorIsInTheNoise) {
  for (const std::array<double, 2>& truth :
       {std::array{0.87, 1.13}, std::array{1.21, 0.74}, std::array{0.7, 0.8}}) {
    write_data(truth, 5);
    const Run with = run(project("[method]\ntruncation_error = \"on\"\n"));
    const ExactPosterior exact = exact_posterior(measurements_);
    const auto wider = [&](const assimilation::StepResult& result) -> VectorXd {
      return result.update.standard_deviations().cwiseQuotient(exact.std);
    };
    EXPECT_GT(wider(with.before).minCoeff(), 1.05);  // by the error of the coarse model
    EXPECT_LT((wider(with.after).array() - 1).abs().maxCoeff(), 0.05);
    const VectorXd off = (with.after.update.mean - exact.mean).cwiseQuotient(exact.std);
    EXPECT_LT(off.cwiseAbs().maxCoeff(), 0.1);
  }
}

TEST_F(RefinementTest, TheProjectsOrderOfTheParametersCounts) {
  write_data({0.87, 1.13}, 3);
  const Run one = run(project());
  Project other = parse_project(
      "model = \"model.h5\"\ndata = \"data.h5\"\n[parameters]\nb = { prior = \"uniform\", lower = 0.5, upper "
      "= 1.5 }\n"
      "a = { prior = \"uniform\", lower = 0.5, upper = 1.5 }\n",
      folder_ + "other.toml");
  class Swapped final : public model::Simulator {
   public:
    [[nodiscard]] std::string key(std::span<const double>) const override { return "swapped"; }
    [[nodiscard]] Snapshots solve(std::span<const double> p) override {
      Snapshots solution = front_on({{.name = "a", .nodes = {p[1]}}, {.name = "b", .nodes = {p[0]}}});
      std::swap(solution.axes[0], solution.axes[1]);
      return solution;
    }
  };
  UpdateSetup setup = set_up(other);
  auto engine = std::make_unique<assimilation::Engine>(engine_setup(other, setup));
  RecordedData data(std::move(setup));
  assimilation::StepResult result;
  while (auto item = data.next({})) result = engine->assimilate(item->datum);
  Refinement refinement(other, data.setup(), std::make_unique<Swapped>(), folder_ + "swapped");
  ASSERT_TRUE(refinement.refine(engine, result, 14, true));
  EXPECT_NEAR(result.update.mean[0], one.after.update.mean[1],
              0.05 * one.after.update.standard_deviations()[1]);
  EXPECT_NEAR(result.update.mean[1], one.after.update.mean[0],
              0.05 * one.after.update.standard_deviations()[0]);
}

TEST_F(RefinementTest, TheDoubtOfTheVerdictMakesItAsk) {
  write_data({0.87, 1.13}, 3);
  const Project project = this->project("[method]\nverify_runs = 4\n");
  UpdateSetup setup = set_up(project);
  auto engine = std::make_unique<assimilation::Engine>(engine_setup(project, setup));
  RecordedData data(std::move(setup));
  Refinement refinement(project, data.setup(), std::make_unique<FrontSimulator>(), folder_ + "refined");
  bool asked_before_the_end = false;
  while (auto item = data.next({})) {
    assimilation::StepResult result = engine->assimilate(item->datum);
    const bool is_last = item->datum.step + 1 == data.size();
    const bool doubted = result.update.verdict.level != assimilation::VerdictLevel::ok;
    const std::size_t before = refinement.runs();
    const bool asked = refinement.refine_if_needed(engine, result, is_last);
    if (!is_last) {
      EXPECT_TRUE(doubted || !asked);
      EXPECT_LE(refinement.runs(), 2u);
      asked_before_the_end |= asked;
    }
    EXPECT_GE(refinement.runs(), before);
  }
  EXPECT_TRUE(asked_before_the_end);
  EXPECT_EQ(refinement.runs(), 4u);
}

TEST_F(RefinementTest, SolutionsThatWereMadeBeforeAreUsedAndNotAskedAgain) {
  write_data({0.87, 1.13}, 3);
  const Project project = this->project();
  auto [engine, result] = assimilate(project);
  const std::vector<double> mean = {result.update.mean[0], result.update.mean[1]};
  RefinementStart start{{FrontSimulator().solve(mean)}, 0, 3, true};
  Refinement refinement(project, set_up(project), std::make_unique<FrontSimulator>(), folder_ + "refined",
                        std::move(start));
  ASSERT_TRUE(refinement.refine(engine, result, 1, true));  // it is all that is allowed
  EXPECT_EQ(refinement.runs(), 1u);
  EXPECT_EQ(refinement.version(), 4u);
  EXPECT_EQ(refinement.file(), refined_model(folder_ + "refined", 4));
  EXPECT_EQ(result.model_version, 4u);
  EXPECT_FALSE(refinement.refine(engine, result, 1, true));
}

TEST_F(RefinementTest, ASolverThatCannotBeRunCostsNothingButTheVerdict) {
  class Missing final : public model::Simulator {
   public:
    [[nodiscard]] std::string key(std::span<const double>) const override { return "missing"; }
    [[nodiscard]] Snapshots solve(std::span<const double>) override {
      throw IoError("cannot run the solver");
    }
  };
  write_data({0.87, 1.13}, 3);
  const Project project = this->project();
  auto [engine, result] = assimilate(project);
  const VectorXd mean = result.update.mean;
  Refinement refinement(project, set_up(project), std::make_unique<Missing>(), folder_ + "refined");
  EXPECT_FALSE(refinement.refine_if_needed(engine, result, true));
  EXPECT_EQ(result.update.mean, mean);
  EXPECT_NE(result.update.verdict.level, assimilation::VerdictLevel::ok);
  EXPECT_THAT(
      assimilation::verdict_text(result.update.verdict),
      testing::HasSubstr(
          "could not be used, so the error of the reduced model is not verified: cannot run the solver"));
}

/// b is recorded, and another at each time; a is inferred.
TEST_F(RefinementTest, AParameterThatIsKnownHasItsRecordedValues) {
  const double truth = 1.13;
  write_data({truth, 1}, 3);
  std::vector<double> known;
  for (Index t = 0; t < measurements_.values.cols(); ++t) {
    known.push_back(0.62 + 0.7 * measurements_.time[t]);
    for (Index dof = 0; dof < measurements_.values.rows(); ++dof) {
      const double time = measurements_.time[t];
      measurements_.values(dof, t) +=
          front(dof, time, std::array{truth, known.back()}) - front(dof, time, std::array{truth, 1.0});
    }
  }
  measurements_.series["b"] = {known, {}, {}, "", {}, {}};
  likelihood::write_measurements(folder_ + "data.h5", measurements_, "", 3);
  const Project project = parse_project(
      "model = \"model.h5\"\ndata = \"data.h5\"\nresults = \"results/\"\n[parameters]\n"
      "a = { prior = \"uniform\", lower = 0.5, upper = 1.5 }\nb = { prior = \"known\" }\n",
      folder_ + "project.toml");
  double sum = 0, first = 0, second = 0;  // of the exact posterior, by the midpoint rule
  for (double a = 1.0; a < 1.3; a += 2e-5) {
    double misfit = 0;
    for (Index t = 0; t < measurements_.values.cols(); ++t)
      for (Index dof = 0; dof < measurements_.values.rows(); ++dof)
        misfit += std::pow(
            measurements_.values(dof, t) - front(dof, measurements_.time[t], std::array{a, known[t]}), 2);
    const double weight =
        std::exp(-0.5 * (misfit / (k_noise * k_noise) - static_cast<double>(measurements_.values.size())));
    sum += weight, first += weight * a, second += weight * a * a;
  }
  const double mean = first / sum, std = std::sqrt(second / sum - mean * mean);
  const Run run = this->run(project);
  EXPECT_GT(std::abs(run.before.update.mean[0] - mean), 0.3 * std);  // or there was nothing to refine
  EXPECT_LT(std::abs(run.after.update.mean[0] - mean), 0.1 * std);
  EXPECT_NEAR(run.after.update.standard_deviations()[0], std, 0.05 * std);
}

TEST_F(RefinementTest, WhatDoesNotGoTogetherIsRefused) {
  write_data({0.87, 1.13}, 3);
  EXPECT_THAT(files::message_of<ProjectError>(
                  [&] { (void)full_order_simulator(project("[method]\nverify = \"full-order\"\n")); }),
              testing::HasSubstr("the table [offline] that the model was made from"));
}

}  // namespace
}  // namespace knothe::project
