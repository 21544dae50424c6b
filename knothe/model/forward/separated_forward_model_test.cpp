#include "knothe/model/forward/separated_forward_model.hpp"

#include <gtest/gtest.h>

#include "knothe/base/error.hpp"
#include "knothe/model/testing/test_models.hpp"

namespace knothe::model {
namespace {

const std::vector<std::size_t> k_dofs = {2, 7, 11}, k_steps = {3, 1};

/// Against SeparatedModel, which evaluates step by step, dof by dof: output i is dof i mod 3 at step i / 3.
void expect_the_models_own(ForwardModel& model, const SeparatedModel& judge) {
  const Eigen::MatrixXd points = (Eigen::MatrixXd(2, 3) << 0.6, 1.1, 1.45, 0.55, 1.25, 0.9).finished();
  const Eigen::MatrixXd sensitivities = Eigen::MatrixXd::Random(6, 3);
  Eigen::MatrixXd values(6, 3), jacobians(12, 3), hessians(4, 3);
  model.evaluate(points, values);
  model.jacobian(points, jacobians);
  model.hessian(points, sensitivities, hessians);
  for (Eigen::Index i = 0; i < 3; ++i) {
    const Eigen::Vector2d p = points.col(i);
    Eigen::Matrix2d hessian = Eigen::Matrix2d::Zero();
    for (Eigen::Index s = 0; s < 2; ++s) {
      const auto field = judge.evaluate({p.data(), 2}, k_steps[static_cast<std::size_t>(s)], k_dofs, 2);
      for (Eigen::Index j = 0; j < 3; ++j) {
        const Eigen::Index output = 3 * s + j;
        const auto at = static_cast<std::size_t>(j);
        EXPECT_NEAR(values(output, i), field.value[at], 1e-12 * (1 + std::abs(field.value[at])));
        for (Eigen::Index k = 0; k < 2; ++k)
          EXPECT_NEAR(jacobians(k * 6 + output, i), field.gradient[at * 2 + static_cast<std::size_t>(k)],
                      1e-10);
        hessian += sensitivities(output, i) * Eigen::Map<const Eigen::Matrix2d>(field.hessian.data() + 4 * j);
      }
    }
    EXPECT_LT((hessians.col(i).reshaped(2, 2) - hessian).norm(), 1e-9 * (1 + hessian.norm()));
  }
}

TEST(SeparatedForwardModel, StepsAreStackedInBothForms) {
  for (const Form form : {Form::canonical, Form::tree}) {
    const SeparatedModel judge(random_contents(form));
    SeparatedForwardModel model(observe_dofs(judge, k_dofs), k_steps, "M");
    EXPECT_EQ(model.output_count(), 6);
    expect_the_models_own(model, judge);
    EXPECT_EQ(model.calls().evaluations, 3);
  }
}

TEST(SeparatedForwardModel, OfAnOutputIsTheOutputAtItsSteps) {
  const SeparatedModel judge(random_contents(Form::tree));
  SeparatedForwardModel model(observe_output(judge, "force"), {3, 0}, "M");
  const Eigen::Vector2d p(0.8, 1.1);
  Eigen::MatrixXd value(2, 1), jacobian(4, 1), hessian(4, 1);
  model.evaluate(p, value);
  model.jacobian(p, jacobian);
  model.hessian(p, Eigen::Vector2d(2, -1), hessian);
  const auto all = judge.evaluate_output("force", {p.data(), 2}, 2);
  EXPECT_EQ(value(0, 0), all.value[3]);
  EXPECT_EQ(value(1, 0), all.value[0]);
  for (std::size_t k = 0; k < 2; ++k) {
    EXPECT_EQ(jacobian(static_cast<Eigen::Index>(2 * k), 0), all.gradient[3 * 2 + k]);
    EXPECT_EQ(jacobian(static_cast<Eigen::Index>(2 * k + 1), 0), all.gradient[k]);
  }
  for (std::size_t ab = 0; ab < 4; ++ab)
    EXPECT_NEAR(hessian(static_cast<Eigen::Index>(ab), 0), 2 * all.hessian[3 * 4 + ab] - all.hessian[ab],
                1e-12);
}

TEST(SeparatedForwardModel, WhatIsNotThereIsNamed) {
  const SeparatedModel model(random_contents(Form::tree), "M.h5");
  const auto message = [](const auto& call) -> std::string {
    try {
      call();
    } catch (const UsageError& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_EQ(message([&] { SeparatedForwardModel(observe_dofs(model, k_dofs), {4}, "M.h5"); }),
            "M.h5: there is no step 4: the model has steps 0 to 3");
  EXPECT_EQ(message([&] { (void)observe_output(model, "farce"); }),
            "M.h5 has no output \"farce\" (did you mean \"force\"?); it has force");
}

}  // namespace
}  // namespace knothe::model
