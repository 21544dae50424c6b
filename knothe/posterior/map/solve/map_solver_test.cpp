#include "knothe/posterior/map/solve/map_solver.hpp"

#include <gtest/gtest.h>
#include <numbers>

#include <cmath>
#include <limits>
#include <string>

#include "knothe/base/error.hpp"
#include "knothe/numerics/integrate/sobol.hpp"
#include "knothe/posterior/testing/test_targets.hpp"

namespace knothe::posterior {
namespace {

using targets::Planar;

Eigen::MatrixXd correlated_precision(Eigen::Index d) {
  Eigen::MatrixXd a = Eigen::MatrixXd::Identity(d, d);
  for (Eigen::Index i = 0; i < d; ++i)
    for (Eigen::Index j = 0; j < i; ++j) a(i, j) = 0.6 / static_cast<double>(i - j);
  return 4 * a * a.transpose();
}

TEST(MapSolver, LinearGaussianIsExactAtOrderOne) {
  for (Eigen::Index d : {1, 2, 3, 6}) {
    targets::Gaussian target(Eigen::VectorXd::LinSpaced(d, -0.5, 1.2), correlated_precision(d), -3.25);
    MapSolver solver;
    const MapResult result = solver.solve(target);
    EXPECT_EQ(result.order, 1);
    EXPECT_TRUE(result.tolerance_reached);
    EXPECT_TRUE(result.reason.empty());
    EXPECT_LT(result.verified_diagnostic, 1e-18);
    EXPECT_NEAR(result.map_log_evidence(), -3.25, 1e-10);
    EXPECT_LT((result.mode - target.mean).cwiseAbs().maxCoeff(), 1e-10);
    const Eigen::MatrixXd covariance = target.precision.inverse();
    // T is x ↦ mean + L x: checked at the unit vectors.
    Eigen::MatrixXd points = Eigen::MatrixXd::Zero(d + 1, d);
    points.bottomRows(d).setIdentity();
    const Eigen::MatrixXd image = result.evaluate(points);
    const Eigen::MatrixXd l = (image.bottomRows(d).rowwise() - image.row(0)).transpose();
    EXPECT_LT((l * l.transpose() - covariance).cwiseAbs().maxCoeff(), 1e-10);
    EXPECT_LT((image.row(0).transpose() - target.mean).cwiseAbs().maxCoeff(), 1e-10);
    const auto corrected = solver.correct(target, result);
    EXPECT_NEAR(corrected.log_evidence, -3.25, 1e-10);
    EXPECT_NEAR(corrected.ess, 1, 1e-10);
    EXPECT_TRUE(corrected.trust.trusted);
  }
}

TEST(MapSolver, TheBananaIsExactAtOrderTwo) {
  MapSolverOptions options;
  options.parametrisation.radii.tangent = 9;  // beyond all points: x² is then in the span everywhere
  options.decrease_tolerance = 1e-14;
  MapSolver solver(options);
  Planar target(targets::banana());
  const MapResult result = solver.solve(target);
  EXPECT_EQ(result.order, 2);
  EXPECT_LT(result.verified_diagnostic, 1e-12);
  EXPECT_NEAR(result.map_log_evidence(), 0, 1e-8);
  const Eigen::MatrixXd z = result.evaluate((Eigen::MatrixXd(2, 2) << 1.3, -0.4, -2.1, 0.9).finished());
  EXPECT_NEAR(z(0, 1), -0.4 + 1.3 * 1.3, 1e-6);
  EXPECT_NEAR(z(1, 1), 0.9 + 2.1 * 2.1, 1e-6);
  MapSolver standard;  // and with the standard radii the tails cost almost nothing
  EXPECT_LT(standard.solve(target).verified_diagnostic, 1e-5);
}

TEST(MapSolver, MinimisersAgree) {
  Planar with_hessian(targets::Ridge{1, 1.05, 0.1, 1.2, 0.3});
  Planar with_gradient(targets::Ridge{1, 1.05, 0.1, 1.2, 0.3}, 1),
      values_only(targets::Ridge{1, 1.05, 0.1, 1.2, 0.3}, 0);
  MapSolverOptions options;
  options.max_order = options.min_order = 2;
  options.decrease_tolerance = 1e-13;
  options.orientation = Orientation::given;
  options.fallback = false;
  const double newton = MapSolver(options).solve(with_hessian).training_objective;
  EXPECT_NEAR(MapSolver(options).solve(with_gradient).training_objective, newton, 1e-7);
  options.minimiser = MinimiserKind::bfgs;
  EXPECT_NEAR(MapSolver(options).solve(with_hessian).training_objective, newton, 1e-7);
  for (const MinimiserKind kind : {MinimiserKind::newton_cg, MinimiserKind::lbfgs}) {
    options.minimiser = kind;
    EXPECT_NEAR(MapSolver(options).solve(with_hessian).training_objective, newton, 1e-7);
  }
  options.minimiser = MinimiserKind::nelder_mead;
  EXPECT_NEAR(MapSolver(options).solve(with_hessian).training_objective, newton, 1e-5);
  EXPECT_NEAR(MapSolver(options).solve(values_only).training_objective, newton, 1e-5);
}

/// A Gaussian bent into a sine, in units of 1e7 and 1e-5: values alone.
class BentValues final : public LogDensity {
 public:
  [[nodiscard]] Eigen::Index dimension() const override { return 2; }
  [[nodiscard]] int available_derivatives() const override { return 0; }
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int /*derivatives*/,
                LogDensityBatch& out) override {
    count += points.rows();
    for (Eigen::Index i = 0; i < points.rows(); ++i) {
      const double x = (points(i, 0) - 5e9) / 1e7, y = (points(i, 1) / 1e-5 - std::sin(x)) / 0.4;
      out.value[i] = -0.5 * (x * x + y * y);
    }
  }
  std::int64_t count = 0;
};

TEST(MapSolver, ValuesAloneAreDifferencedInTheUnitsOfTheMode) {
  BentValues target;
  MapSolverOptions options;
  options.scan = ScanReach::wide;
  MapSolver solver(options);
  const MapResult result = solver.solve(target);
  EXPECT_EQ(result.density_evaluations, target.count);
  EXPECT_LT(target.count, 200'000);  // by the simplex method 30 millions
  const ImportanceCorrection corrected = solver.correct(target, result);
  EXPECT_TRUE(corrected.trust.trusted) << corrected.trust.reason;
  EXPECT_NEAR(corrected.log_evidence, std::log(2 * std::numbers::pi * 1e7 * 0.4e-5), 2e-3);
  EXPECT_NEAR(corrected.mean[0], 5e9, 1e5);
  EXPECT_NEAR(corrected.mean[1], 0, 1e-7);
  // Var y = E sin² x + 0.4² = (1 − e⁻²)/2 + 0.16.
  EXPECT_NEAR(corrected.covariance(1, 1) / 1e-10, 0.5 * (1 - std::exp(-2.0)) + 0.16, 0.01);
}

TEST(MapSolver, ASpuriousMinimumIsNotReported) {
  // Concave slope of log π over most of the line: an unguarded Newton step from the identity changes the sign
  // of h (notes.md).
  Planar target([](double x, double y, double* r) {
    const double u = y - 1.5 * std::sin(2 * x);
    r[0] = -0.5 * x * x - 8 * u * u;
    r[1] = -x + 16 * u * 3 * std::cos(2 * x);
    r[2] = -16 * u;
    r[3] = -1 - 16 * 9 * std::cos(2 * x) * std::cos(2 * x) - 16 * u * 6 * std::sin(2 * x);
    r[4] = 48 * std::cos(2 * x);
    r[5] = -16;
  });
  MapSolver solver;
  const MapResult result = solver.solve(target);
  const auto corrected = solver.correct(target, result);
  if (result.tolerance_reached) {
    EXPECT_LE(result.verified_diagnostic, 1e-3);
  } else {
    EXPECT_NE(result.reason.find("variance diagnostic"), std::string::npos);
  }
  if (corrected.trust.trusted) {
    EXPECT_NEAR(corrected.log_evidence, std::log(2 * std::numbers::pi / 4), 0.02);  // √(2π) √(2π/16)
  }
  EXPECT_EQ(result.verification.points.rows(), 1024);
}

TEST(MapSolver, ASecondModeIsFlagged) {
  MapSolver solver;
  for (double a : {2.5, 3.0, 6.0, 10.0}) {
    Planar target(targets::mixture(a));
    const MapResult result = solver.solve(target);
    EXPECT_TRUE(result.second_mode_found) << a;
    EXPECT_FALSE(solver.correct(target, result).trust.trusted);
    EXPECT_NEAR(std::abs(result.second_mode[0]), a, 0.1);
  }
  Planar uneven(targets::mixture(4, 0.02));
  EXPECT_TRUE(solver.solve(uneven).second_mode_found);
  Planar one(targets::mixture(1)), bent(targets::banana(1.5));
  EXPECT_FALSE(solver.solve(one).second_mode_found);
  EXPECT_FALSE(solver.solve(bent).second_mode_found);
}

TEST(MapSolver, NotANumberIsAClearError) {
  Planar target([](double x, double y, double* r) {
    targets::banana()(x, y, r);
    if (x > 0.3) r[0] = std::nan("");
  });
  try {
    (void)MapSolver().solve(target);
    FAIL();
  } catch (const NumericalError& error) {
    EXPECT_NE(std::string(error.what()).find("the log-density is nan at z = ("), std::string::npos);
  }
  Planar gradient([](double x, double y, double* r) {
    targets::banana()(x, y, r);
    r[2] = std::numeric_limits<double>::infinity();
  });
  try {
    (void)MapSolver().solve(gradient);
    FAIL();
  } catch (const NumericalError& error) {
    EXPECT_NE(std::string(error.what()).find("gradient of the log-density is not finite"), std::string::npos);
  }
  struct Forgetful : LogDensity {  // writes nothing: the poisoned buffer shows it
    Eigen::Index dimension() const override { return 1; }
    void evaluate(const Eigen::Ref<const Eigen::MatrixXd>&, int, LogDensityBatch&) override {}
  } forgetful;
  EXPECT_THROW((void)MapSolver().solve(forgetful), NumericalError);
}

TEST(MapSolver, ADensityThatIsZeroSomewhereIsSurvived) {
  // N(0, I) cut off at x < −1: log evidence log Φ(1).
  Planar target([](double x, double y, double* r) {
    r[0] = x < -1 ? -std::numeric_limits<double>::infinity()
                  : -0.5 * (x * x + y * y) - std::log(2 * std::numbers::pi);
    r[1] = -x, r[2] = -y, r[3] = -1, r[4] = 0, r[5] = -1;
  });
  MapSolver solver;
  const MapResult result = solver.solve(target);
  const auto corrected = solver.correct(target, result);
  EXPECT_TRUE(std::isfinite(result.verified_diagnostic));
  EXPECT_FALSE(result.tolerance_reached);
  EXPECT_FALSE(result.reason.empty());
  EXPECT_NEAR(corrected.log_evidence, std::log(0.5 * std::erfc(-1 / std::numbers::sqrt2)), 0.05);
  EXPECT_TRUE(corrected.mean.allFinite() && corrected.covariance.allFinite() &&
              corrected.quantiles.allFinite());
  Planar nowhere([](double, double, double* r) {
    std::fill(r, r + 6, 0.0);
    r[0] = -std::numeric_limits<double>::infinity();
  });
  EXPECT_THROW((void)MapSolver().solve(nowhere), NumericalError);
}

TEST(MapSolver, IsDeterministicWhateverWasSolvedBefore) {
  Planar ridge(targets::Ridge{1, 1.05, 0.01, 1.35, 0.15}), banana(targets::banana(1, 0.2)),
      bimodal(targets::mixture(3));
  MapSolver solver, fresh;
  fresh.prepare(2);
  const MapResult first = solver.solve(ridge);
  const auto corrected = solver.correct(ridge, first);
  (void)solver.correct(banana, solver.solve(banana));
  (void)solver.solve(bimodal);
  for (MapSolver* s : {&solver, &fresh}) {
    const MapResult again = s->solve(ridge);
    EXPECT_EQ(again.map.coefficients(), first.map.coefficients());
    EXPECT_EQ(again.mode, first.mode);
    EXPECT_EQ(again.verified_diagnostic, first.verified_diagnostic);
    EXPECT_EQ(again.verification.log_weight, first.verification.log_weight);
    EXPECT_EQ(again.density_evaluations, first.density_evaluations);
    const auto c = s->correct(ridge, again);
    EXPECT_EQ(c.mean, corrected.mean);
    EXPECT_EQ(c.quantiles, corrected.quantiles);
    EXPECT_EQ(c.log_evidence, corrected.log_evidence);
  }
}

TEST(MapSolver, HandlesScalesAndDimensions) {
  for (double scale : {1e-4, 1e-2, 30.0}) {
    targets::Gaussian target(Eigen::Vector2d(0.4, -0.2), Eigen::Matrix2d::Identity() / (scale * scale));
    const MapResult result = MapSolver().solve(target);
    EXPECT_TRUE(result.tolerance_reached) << scale;
    EXPECT_NEAR(result.map_log_evidence(), 0, 1e-8);
  }
  MapSolverOptions options;
  options.max_order = 0;
  EXPECT_THROW(MapSolver{options}, UsageError);
}

TEST(MapSolver, TheFirstVariableRunsAlongARidge) {
  // Across the ridge a triangular map is poor, along it good; the solver finds that out at order 2.
  MapSolverOptions options;
  options.fallback = false;
  options.max_order = 6;
  const targets::Ridge ridge{3, 1, 0.02, 1.0, 0.4};
  Planar target(ridge);
  options.orientation = Orientation::given;
  const double given = MapSolver(options).solve(target).verified_diagnostic;
  options.orientation = Orientation::principal;
  const double principal = MapSolver(options).solve(target).verified_diagnostic;
  options.orientation = Orientation::automatic;
  const MapResult result = MapSolver(options).solve(target);
  EXPECT_LT(principal, 0.5 * given);
  EXPECT_LT(result.verified_diagnostic, 0.5 * given);
  EXPECT_FALSE(result.pre_map.is_triangular());
  EXPECT_NE(result.method.find("principal axes"), std::string::npos);
  // A rotated pre-map is inverted, and its density normalised, as any other.
  const Eigen::MatrixXd x = (Eigen::MatrixXd(3, 2) << 0, 0, 1, -1.5, -0.7, 2).finished();
  EXPECT_LT((result.inverse(result.evaluate(x)) - x).cwiseAbs().maxCoeff(), 1e-9);
  // The banana's own axes are the right ones: they stay.
  Planar banana(targets::banana());
  EXPECT_TRUE(MapSolver().solve(banana).pre_map.is_triangular());
}

TEST(MapSolver, EveryRectifierSolvesAndIsReported) {
  Planar target(targets::Ridge{1, 1.05, 0.05, 1.2, 0.3});
  for (const Rectifier rectifier : {Rectifier::square, Rectifier::softplus, Rectifier::exponential}) {
    MapSolverOptions options;
    options.tolerance = 5e-3;
    options.parametrisation.rectifier = rectifier;
    options.fallback = false;
    MapSolver solver(options);
    const MapResult result = solver.solve(target);
    EXPECT_TRUE(result.tolerance_reached) << to_text(rectifier) << " " << result.reason;
    EXPECT_EQ(result.method.find(to_text(rectifier)), 0u) << result.method;
    EXPECT_EQ(result.map.parametrisation().rectifier, rectifier);
    const auto corrected = solver.correct(target, result);
    EXPECT_GT(corrected.ess, 0.98);
  }
}

TEST(MapSolver, TrainsOnGivenNodesToo) {
  Planar target(targets::Ridge{1, 1.05, 0.1, 1.2, 0.3});
  MapSolverOptions options;
  options.nodes_per_axis = 10;
  options.tolerance = 1e-2;
  const MapResult result = MapSolver(options).solve(target);
  EXPECT_TRUE(result.tolerance_reached) << result.reason;
  EXPECT_LT(std::abs(result.verified_objective - result.training_objective), 0.05);
  options.nodes_per_axis = -1;
  EXPECT_THROW(MapSolver{options}, UsageError);
}

TEST(MapSolver, AFamilyOfTheCallersIsUsed) {
  Planar target(targets::banana());
  MapSolverOptions options;
  options.family = [](Eigen::Index d, int order) { return sparse_map(total_order_map(d, order), {{}, {}}); };
  options.fallback = false;
  const MapResult diagonal = MapSolver(options).solve(target);
  EXPECT_FALSE(diagonal.tolerance_reached);  // the banana is not a product
  EXPECT_EQ(diagonal.map.component(1).constant.size(), 1u);
  options.family = [](Eigen::Index, int order) { return total_order_map(3, order); };
  try {
    (void)MapSolver(options).solve(target);
    FAIL();
  } catch (const UsageError& error) {
    EXPECT_NE(std::string(error.what()).find("gives a map in 3 dimensions for a density in 2"),
              std::string::npos);
  }
}

}  // namespace
}  // namespace knothe::posterior
