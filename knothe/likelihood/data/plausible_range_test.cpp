#include "knothe/likelihood/data/plausible_range.hpp"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <limits>

#include "knothe/likelihood/testing/test_models.hpp"

namespace knothe::likelihood {
namespace {

constexpr double k_nan = std::numeric_limits<double>::quiet_NaN();

/// w(p) = p on [−1, 2]^d.
class BoundedFunctions final : public test::LinearFunctions {
 public:
  using LinearFunctions::LinearFunctions;
  [[nodiscard]] Eigen::VectorXd lower() const override { return Eigen::VectorXd::Constant(dimension(), -1); }
  [[nodiscard]] Eigen::VectorXd upper() const override { return Eigen::VectorXd::Constant(dimension(), 2); }
};

model::Sensors sensors_along(const std::vector<int>& components, std::vector<std::string> scalars) {
  model::Dofs dofs;
  for (std::size_t i = 0; i < components.size(); ++i) {
    dofs.points.insert(dofs.points.end(), {0.1 * static_cast<double>(i), 0, 0.5});
    dofs.components.push_back(components[i]);
  }
  return model::Sensors(std::move(dofs), std::move(scalars));
}

model::ObservedModel model_of(std::shared_ptr<const model::ParameterFunctions> functions,
                              const Eigen::MatrixXd& space, const Eigen::MatrixXd& lift) {
  model::ObservedModel model;
  const Eigen::Index r = functions->count();
  model.functions = std::move(functions);
  model.space = space;
  model.lift = lift;
  for (Eigen::Index t = 0; t < lift.cols(); ++t) {
    model.time.push_back(static_cast<double>(t));
    model.core.emplace_back(static_cast<double>(t) * Eigen::MatrixXd::Identity(r, r));
  }
  return model;
}

/// y = t (±p_1 … ±p_8), whose largest answer is at one corner, whichever the signs are.
TEST(PlausibleRange, NoCornerOfEightParametersIsLeftOut) {
  const auto functions = std::make_shared<BoundedFunctions>(8);
  for (unsigned signs = 0; signs < 256; ++signs) {
    Eigen::MatrixXd space(1, 8);
    for (int a = 0; a < 8; ++a) space(0, a) = (signs >> a) & 1u ? 1 : -1;
    const int ups = std::popcount(signs);
    const double most = 3 * std::max(2 * ups + (8 - ups), ups + 2 * (8 - ups));
    const auto model = model_of(functions, space, Eigen::MatrixXd::Zero(1, 4));
    const PlausibleRange range(model, sensors_along({0}, {}), Eigen::VectorXd::Constant(1, 1e-3));
    ASSERT_NEAR(range.limit(0), 100 * most, 1e-9 * most) << signs;
  }
}

TEST(PlausibleRange, EachKindOfSensorHasItsLimit) {
  const auto functions = std::make_shared<BoundedFunctions>(1);
  Eigen::MatrixXd space(5, 1), lift = Eigen::MatrixXd::Zero(5, 2);
  space << 1, 3, 0, 0.5, 1000;  // x, x, z, y, force
  lift.row(3).setConstant(7);
  const auto sensors = sensors_along({0, 0, 2, 1}, {"force"});
  Eigen::VectorXd std(5);
  std << 0.1, 0.1, 0.2, std::numeric_limits<double>::infinity(), 1;
  PlausibleRange range(model_of(functions, space, lift), sensors, std);
  EXPECT_DOUBLE_EQ(range.limit(0), 600);
  EXPECT_DOUBLE_EQ(range.limit(1), 600);
  EXPECT_DOUBLE_EQ(range.limit(2), 20);  // the model does not move it: of the noise
  EXPECT_DOUBLE_EQ(range.limit(3), 800);
  EXPECT_DOUBLE_EQ(range.limit(4), 200000);
  Eigen::VectorXd values(5);
  values << 600, -600, k_nan, 800, 2e5;
  EXPECT_EQ(range.complaint(values), "");
  values[1] = -601;
  EXPECT_EQ(range.complaint(values), "sensor 1, x at (0.1, 0, 0.5) m, is -601 m, beyond the limit of 600 m");
  range.limit_displacements(0.01);
  range.limit_scalar(0, 5);
  EXPECT_EQ(range.complaint(values),
            "sensor 0, x at (0, 0, 0.5) m, is 600 m, beyond the limit of 0.01 m (and 3 more)");
  values << 0, 0.01, -0.01, k_nan, 6;
  EXPECT_EQ(range.complaint(values), "force is 6, beyond the limit of 5");
}

TEST(PlausibleRange, AModelWithoutABoxHasNoLimit) {
  const auto functions = std::make_shared<test::LinearFunctions>(2);
  const auto model = model_of(functions, Eigen::MatrixXd::Ones(1, 2), Eigen::MatrixXd::Zero(1, 2));
  const PlausibleRange range(model, sensors_along({1}, {}), Eigen::VectorXd::Ones(1));
  EXPECT_EQ(range.complaint(Eigen::VectorXd::Constant(1, 1e300)), "");
}

}  // namespace
}  // namespace knothe::likelihood
