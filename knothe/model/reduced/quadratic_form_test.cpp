#include <gtest/gtest.h>

#include <random>

#include "knothe/model/reduced/spline_functions.hpp"
#include "knothe/numerics/integrate/grid_evaluator.hpp"

namespace knothe::model {
namespace {

using Nodes = std::vector<std::vector<double>>;

struct Evaluated {
  Eigen::VectorXd value;
  Eigen::MatrixXd gradient, hessian;
};

Evaluated evaluate(QuadraticForm& form, const Eigen::MatrixXd& points, int derivatives) {
  const Eigen::Index n = points.rows(), d = points.cols();
  Evaluated result{Eigen::VectorXd::Zero(n), Eigen::MatrixXd::Zero(n, d),
                   Eigen::MatrixXd::Zero(n, d * (d + 1) / 2)};
  form.evaluate(points, derivatives, result.value, result.gradient, result.hessian);
  return result;
}

Eigen::MatrixXd random_matrix(Eigen::Index rows, Eigen::Index columns, unsigned seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  return Eigen::MatrixXd::NullaryExpr(rows, columns,
                                      [&](Eigen::Index, Eigen::Index) { return normal(random); });
}

/// Points in the box, nodes and corners among them.
Eigen::MatrixXd points_in(const Nodes& nodes, Eigen::Index n) {
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> uniform(0, 1);
  Eigen::MatrixXd points(n, static_cast<Eigen::Index>(nodes.size()));
  for (std::size_t a = 0; a < nodes.size(); ++a) {
    for (Eigen::Index i = 0; i < n; ++i) {
      const auto& axis = nodes[a];
      points(i, static_cast<Eigen::Index>(a)) =
          i % 3 == 0 ? axis[static_cast<std::size_t>(uniform(random) * static_cast<double>(axis.size()))]
                     : axis.front() + uniform(random) * (axis.back() - axis.front());
    }
  }
  return points;
}

std::vector<double> random_values(const Nodes& nodes, Eigen::Index count) {
  std::size_t n = static_cast<std::size_t>(count);
  for (const auto& axis : nodes) n *= axis.size();
  const Eigen::MatrixXd random = random_matrix(static_cast<Eigen::Index>(n), 1, 8);
  return {random.data(), random.data() + random.size()};
}

const std::vector<Nodes> k_grids = {
    {{0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.1}},
    {{-2.0, 3.0}},
    {{0.5, 0.7, 0.75, 1.2, 1.5}, {-1, 0, 1, 2, 3, 4, 5, 6}},
    {{0.0, 1.0}, {1.0, 2.0, 4.0}},
    {{0.0, 1.0, 2.0, 3.0, 4.0}, {0.0, 0.3, 2.0}, {5.0, 6.0, 8.0, 9.0}},
    {{0.0, 1.0, 2.0, 3.0}, {0.0, 1.0}, {0.0, 1.0, 2.0}, {0.0, 1.0}},
    {{0.0, 1.0}, {0.0, 1.0}, {0.0, 1.0}, {0.0, 1.0, 2.0}, {0.0, 1.0}},
};

/// The form of the tensor grid against the generic one, made of w itself.
void expect_like_generic(const Nodes& nodes, Eigen::Index count, Eigen::Index rank, bool linear,
                         double size) {
  const JointFunctions functions(nodes, random_values(nodes, count), count);
  const auto fast = functions.make_quadratic_form();
  const auto generic = functions.ParameterFunctions::make_quadratic_form();
  const Eigen::MatrixXd a = size * random_matrix(rank, count, 1);
  const Eigen::VectorXd b = size * random_matrix(rank, 1, 2);
  const Eigen::VectorXd c = (linear ? size : 0.0) * random_matrix(count, 1, 3);
  fast->set(a, b, c, -3.25);
  generic->set(a, b, c, -3.25);
  const Eigen::MatrixXd points = points_in(nodes, 50);
  const Evaluated got = evaluate(*fast, points, 2), expected = evaluate(*generic, points, 2);
  const auto near = [](const auto& x, const auto& y) {
    return (x - y).array().abs().maxCoeff() <= 1e-11 * (1 + y.array().abs().maxCoeff());
  };
  EXPECT_TRUE(near(got.value, expected.value)) << (got.value - expected.value).cwiseAbs().maxCoeff();
  EXPECT_TRUE(near(got.gradient, expected.gradient))
      << (got.gradient - expected.gradient).cwiseAbs().maxCoeff();
  EXPECT_TRUE(near(got.hessian, expected.hessian)) << (got.hessian - expected.hessian).cwiseAbs().maxCoeff();
  for (int derivatives : {0, 1}) {
    EXPECT_TRUE(near(evaluate(*fast, points, derivatives).value, expected.value));
    EXPECT_TRUE(near(evaluate(*generic, points, derivatives).value, expected.value));
  }
  EXPECT_TRUE(near(evaluate(*fast, points, 1).gradient, expected.gradient));
}

TEST(QuadraticForm, OfATensorGridIsThatOfItsFunctions) {
  for (const Nodes& nodes : k_grids) {
    for (Eigen::Index rank : {0, 1, 7, 8, 11}) {
      expect_like_generic(nodes, 11, rank, true, 1.0);
      expect_like_generic(nodes, 11, rank, false, 1.0);
    }
    expect_like_generic(nodes, 1, 1, true, 30.0);
    // Large enough for cells where squares are summed.
    expect_like_generic(nodes, 5, 3, true, 1e4);
  }
}

/// Runs of 23 nodes to an axis, one or two in each row that is not left out.
std::vector<numerics::GridRun> some_runs(Eigen::Index d) {
  std::vector<numerics::GridRun> runs;
  Eigen::Index at = 0;
  const Eigen::Index rows = d == 1 ? 1 : d == 2 ? 23 : 23 * 23;
  for (Eigen::Index row = 0; row < rows; row += d == 3 ? 7 : 1) {
    for (const auto& [begin, end] :
         {std::pair{row % 5, 9 + row % 7}, std::pair{Eigen::Index{17}, 17 + row % 7}}) {
      if (begin == end) continue;
      runs.push_back({row, begin, end, at});
      at += end - begin;
    }
  }
  return runs;
}

void expect_on_grid_as_at_points(const ParameterFunctions& functions, const Nodes& nodes) {
  const auto d = static_cast<Eigen::Index>(nodes.size());
  const auto form = functions.make_quadratic_form();
  auto* const on_grid = dynamic_cast<numerics::GridEvaluator*>(form.get());
  ASSERT_NE(on_grid, nullptr);
  ASSERT_TRUE(on_grid->has_grid());
  Eigen::MatrixXd axes(23, d);  // a little beyond the box too, where a prior's quantile may be by rounding
  for (Eigen::Index k = 0; k < d; ++k) {
    const auto& axis = nodes[static_cast<std::size_t>(k)];
    axes.col(k).setLinSpaced(23, axis.front() - (k == 0 ? 1e-9 : 0), axis.back() + (k == 0 ? 0 : 1e-9));
  }
  const std::vector<numerics::GridRun> runs = some_runs(d);
  const Eigen::MatrixXd points = numerics::nodes_of(axes, runs);
  for (const double size : {1.0, 1e4}) {  // the large one has cells where squares are summed
    form->set(size * random_matrix(7, 11, 1), size * random_matrix(7, 1, 2), size * random_matrix(11, 1, 3),
              -3.25);
    const Eigen::VectorXd expected = evaluate(*form, points, 0).value;
    Eigen::VectorXd got(points.rows());
    on_grid->set_grid(axes);
    on_grid->evaluate_runs(runs, got);
    EXPECT_LE((got - expected).cwiseAbs().maxCoeff(), 1e-12 * expected.cwiseAbs().maxCoeff());
  }
}

TEST(QuadraticForm, OnAGridOfNodesIsThatAtItsPoints) {
  for (const std::size_t grid : {2, 3, 4})
    expect_on_grid_as_at_points(JointFunctions(k_grids[grid], random_values(k_grids[grid], 11), 11),
                                k_grids[grid]);
  for (const std::size_t grid : {0, 2, 4}) {
    std::vector<std::vector<double>> values;
    for (const auto& axis : k_grids[grid]) values.push_back(random_values({axis}, 11));
    expect_on_grid_as_at_points(CanonicalFunctions(k_grids[grid], values, 11), k_grids[grid]);
  }
}

TEST(QuadraticForm, IsRightNearItsMaximumWhereTheFormIsLarge) {
  // ℓ falls to −1e10 in every cell: near the maximum an expanded polynomial would be wrong by 1e-5.
  const Nodes nodes = k_grids[2];
  const JointFunctions functions(nodes, random_values(nodes, 4), 4);
  const Eigen::RowVector2d top(0.93, 2.4);
  FunctionBatch batch;
  batch.resize(1, 2, 4, 0);
  functions.evaluate(top, 0, batch);
  const Eigen::MatrixXd a = 1e5 * Eigen::MatrixXd::Identity(4, 4);
  const Eigen::VectorXd b = -a * batch.value.row(0).transpose();
  const auto form = functions.make_quadratic_form();
  form->set(a, b, Eigen::VectorXd::Zero(4), 0);
  for (double step : {0.0, 1e-6, 1e-5}) {
    const Eigen::RowVector2d p = top + Eigen::RowVector2d(step, -step);
    functions.evaluate(p, 0, batch);
    const double expected = -0.5 * (a * batch.value.row(0).transpose() + b).squaredNorm();
    EXPECT_NEAR(evaluate(*form, p, 2).value[0], expected, 1e-8 * std::max(1.0, -expected));
  }
}

TEST(QuadraticForm, DoesNotDependOnOtherPointsNorOnEarlierForms) {
  for (const Nodes& nodes : k_grids) {
    const JointFunctions functions(nodes, random_values(nodes, 9), 9);
    for (const auto& form :
         {functions.make_quadratic_form(), functions.ParameterFunctions::make_quadratic_form()}) {
      const Eigen::MatrixXd a = random_matrix(9, 9, 1), points = points_in(nodes, 37);
      const Eigen::VectorXd b = random_matrix(9, 1, 2), c = random_matrix(9, 1, 3);
      form->set(a, b, c, 1);
      const Evaluated all = evaluate(*form, points, 2);
      form->set(a.topRows(2), b.head(2), 0 * c, 4);
      evaluate(*form, points.bottomRows(20), 1);
      form->set(a, b, c, 1);
      for (Eigen::Index i = points.rows() - 1; i >= 0; --i) {
        const Evaluated one = evaluate(*form, points.row(i), 2);
        EXPECT_EQ(one.value[0], all.value[i]);
        EXPECT_EQ(one.gradient.row(0), all.gradient.row(i));
        EXPECT_EQ(one.hessian.row(0), all.hessian.row(i));
      }
    }
  }
}

TEST(QuadraticForm, MagnitudeBoundsTheFunctions) {
  const Nodes& nodes = k_grids[2];
  const JointFunctions functions(nodes, random_values(nodes, 6), 6);
  const Eigen::VectorXd centre = random_matrix(6, 1, 9);
  const Eigen::VectorXd bound = functions.magnitude(centre);
  FunctionBatch batch;
  batch.resize(200, 2, 6, 0);
  functions.evaluate(points_in(nodes, 200), 0, batch);
  const RowMatrix distance = (batch.value.rowwise() - centre.transpose()).cwiseAbs();
  for (Eigen::Index k = 0; k < 6; ++k) {
    EXPECT_LE(distance.col(k).maxCoeff(), bound[k]);
    EXPECT_GE(10 * distance.col(k).maxCoeff(), bound[k]);
  }
}

}  // namespace
}  // namespace knothe::model
