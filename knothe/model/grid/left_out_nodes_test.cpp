#include "knothe/model/grid/left_out_nodes.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "knothe/files/testing/test_folder.hpp"
#include "knothe/model/testing/test_models.hpp"
#include "knothe/numerics/functions/cubic_spline.hpp"

namespace knothe::model {
namespace {

TEST(AxisMisses, OfLongWavesAreThoseOfThePowerOfTheOrder) {
  // Splines through n nodes and through n − 1 reproduce all powers below their order: what both miss of the
  // next one is what they miss of any function that is smooth enough.
  for (const std::size_t n : {6U, 9U}) {
    std::vector<double> nodes, values;
    for (std::size_t i = 0; i < n; ++i) {
      nodes.push_back(std::pow(static_cast<double>(i), 1.2));
      values.push_back(std::pow(nodes.back(), 4));
    }
    const AxisMisses axis(nodes);
    const Eigen::Map<const Eigen::VectorXd> f(values.data(), static_cast<Eigen::Index>(n));
    const double missed = (axis.left_out() * f).norm() / std::sqrt(static_cast<double>(n - 2));
    const numerics::CubicSpline spline(nodes, values);
    double sum = 0;
    constexpr int k_samples = 100000;
    for (int i = 0; i < k_samples; ++i) {
      const double x = nodes.back() * (i + 0.5) / k_samples;
      sum += std::pow(spline.value(x) - std::pow(x, 4), 2) / k_samples;
    }
    EXPECT_NEAR(axis.between_nodes(0.0), std::sqrt(sum) / missed, 0.03 * std::sqrt(sum) / missed);
    // Straight lines are missed by neither.
    const Eigen::VectorXd line = Eigen::Map<const Eigen::VectorXd>(nodes.data(), f.size()) * 3.0;
    EXPECT_LT((axis.left_out() * line).norm() + (axis.of_lines() * line).norm(), 1e-10);
  }
  EXPECT_EQ(AxisMisses(std::vector{0.0, 1.0}).left_out().rows(), 0);
}

std::vector<Axis> axes_of(std::size_t parameters, std::size_t nodes) {
  std::vector<Axis> axes;
  for (std::size_t i = 0; i < parameters; ++i) {
    axes.push_back({std::string(1, static_cast<char>('a' + i)), {}, "1", "", 1.0});
    for (std::size_t k = 0; k < nodes; ++k)
      axes.back().nodes.push_back(static_cast<double>(k) / static_cast<double>(nodes - 1));
  }
  return axes;
}

constexpr std::size_t k_dofs = 40;

struct Manufactured {
  const char* name;
  Field field;
};

/// Smooth ones, ones that are hardly resolved, one with a kink of the second derivative, one that is steep at
/// an edge of the box.
std::vector<Manufactured> manufactured() {
  const auto x = [](std::size_t dof) { return static_cast<double>(dof) / k_dofs; };
  const auto front = [x](double steep) {
    return [x, steep](std::size_t dof, double t, std::span<const double> p) {
      const double where = t * (0.5 + 0.3 * p.front() - 0.09 * p.back());
      return t * x(dof) + 0.3 * std::tanh(steep * (x(dof) - where));
    };
  };
  return {{"gentle front", front(8)},
          {"front", front(20)},
          {"steep front", front(60)},
          {"decay",
           [x](std::size_t dof, double t, std::span<const double> p) {
             return t * x(dof) + 0.1 * std::exp(-2 * p.front()) * std::sin(3 * t + x(dof)) +
                    0.05 * std::exp(-1.5 * p.front() * p.back()) * std::cos(5 * x(dof));
           }},
          {"waves",
           [x](std::size_t dof, double t, std::span<const double> p) {
             return std::sin(6 * p.front() + 3 * t + 4 * x(dof)) + 0.3 * std::cos(5 * p.back() * t) * x(dof);
           }},
          {"ramp",
           [x](std::size_t dof, double t, std::span<const double> p) {
             const double over = std::max(0.0, t - 0.2 - 0.5 * p.front() - 0.1 * p.back());
             return t * x(dof) + over * over * std::cos(9 * x(dof));
           }},
          {"pole", [x](std::size_t dof, double t, std::span<const double> p) {
             return t / (0.2 + p.front() * (1 + x(dof)) + 0.3 * p.back() * t);
           }}};
}

TEST(LeftOutNodes, TheErrorOffTheGridIsEstimatedRatherAboveThanBelow) {
  const files::TestFolder folder;
  const std::vector<double> time{0.1, 0.3, 0.5, 0.7, 0.9, 1.0};
  std::vector<double> ratios;
  for (const auto& [parameters, nodes] :
       {std::pair{1U, 7U}, {2U, 4U}, {2U, 5U}, {2U, 7U}, {2U, 9U}, {3U, 3U}, {3U, 5U}})
    for (const Manufactured& one : manufactured()) {
      SCOPED_TRACE(fmt::format("{}, {} parameters, {} nodes", one.name, parameters, nodes));
      write_snapshots(snapshots_of(one.field, axes_of(parameters, nodes), time, k_dofs), folder.file("s.h5"));
      CompressionOptions options;
      options.tolerance = 1e-6;
      const ImportedModel imported = import_model_and_error(folder.file("s.h5"), options);
      std::vector<OffGridSolution> truth;
      const std::vector<double> places = normal_values(100 * parameters, 3);
      for (std::size_t i = 0; i < 100; ++i) {
        OffGridSolution& solution = truth.emplace_back();
        for (std::size_t k = 0; k < parameters; ++k)
          solution.parameters.push_back(0.5 * std::erfc(places[i * parameters + k] / std::sqrt(2.0)));
        for (const double t : time)
          for (std::size_t dof = 0; dof < k_dofs; ++dof)
            solution.values.push_back(one.field(dof, t, solution.parameters));
      }
      const ModelError error = off_grid_error(imported.model, truth);
      ASSERT_TRUE(imported.model.off_grid);
      const double ratio = imported.model.off_grid->relative_error / error.plain_relative;
      const double of_max = imported.model.off_grid->max_error_m / error.max;
      // The pole's error is that of the first interval alone, which no left-out node tells of.
      const double below = one.name == std::string("pole") ? 2.0 : 1.0;
      EXPECT_GT(ratio, 1 / (2.2 * below));
      EXPECT_LT(ratio, 4.0);
      EXPECT_GT(of_max, 1 / (3 * below));
      EXPECT_LT(of_max, 2.5);
      EXPECT_GT(imported.model.off_grid->relative_error, 10 * imported.model.relative_error);
      ratios.push_back(ratio);
      EXPECT_EQ(imported.truncation.off_grid_count(), 8U);
    }
  std::sort(ratios.begin(), ratios.end());
  EXPECT_GT(ratios[ratios.size() / 2], 1.0);  // rather above the truth than below
}

}  // namespace
}  // namespace knothe::model
