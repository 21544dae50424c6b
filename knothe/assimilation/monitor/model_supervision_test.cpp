#include "knothe/assimilation/monitor/model_supervision.hpp"

#include <gtest/gtest.h>

#include <memory>
#include <optional>

#include "knothe/assimilation/testing/test_priors.hpp"
#include "knothe/assimilation/update/posterior_solver.hpp"
#include "knothe/likelihood/step/prior_of_model.hpp"
#include "knothe/likelihood/testing/test_models.hpp"

namespace knothe::assimilation {
namespace {

/// The steps of data taken through supervision and solver one by one, as `SequentialUpdate` does.
struct Supervised {
  static constexpr Eigen::Index n = 12, n_t = 12;
  std::shared_ptr<const model::ObservedModel> model =
      likelihood::test::random_model(std::make_shared<likelihood::test::CurvedFunctions>(), n, 4, n_t, 5);
  Eigen::VectorXd std = Eigen::VectorXd::Constant(n, 0.3);
  Eigen::MatrixXd data = likelihood::test::synthetic_data(*model, Eigen::Vector2d(1.1, 0.9), std, 9);
  std::shared_ptr<const posterior::PriorTransform> transform =
      likelihood::truncated_to_box(*model, test::papers_priors());
  likelihood::StepStore store{model, likelihood::NoiseModel::independent(std),
                              likelihood::medians(*transform)};
  PosteriorSolver solver;
  ModelSupervision supervision;
  likelihood::FormSums sums = likelihood::FormSums::zero(3);
  UpdateResult result;

  explicit Supervised(const UpdateOptions& options)
      : solver(*model, transform, store.projector().central_functions(), options),
        supervision(model, store.projector().noise(), transform, options) {
    store.make_moved_forms(supervision.is_joint());
  }
  void add(std::size_t step) {
    store.add(likelihood::test::datum(step, data.col(static_cast<Eigen::Index>(step))), step);
    (void)store.update_forms();
  }
  /// The alarm, if it went off.
  std::optional<ModelSupervision::DriftAlarm> assimilate(std::size_t step) {
    add(step);
    likelihood::StoredStep& stored = store.steps().at(step);
    supervision.save(step);
    supervision.correct(step, stored, store.projector());
    const auto alarm = supervision.check_prediction(step, stored, store.projector().central_functions());
    sums.add(stored);
    solver.set(sums, supervision.shares());
    solver.solve(stored.assimilated(), result, result.elapsed_us);
    supervision.learn(stored, {}, result);
    return alarm;
  }
};

UpdateOptions automatic() {
  UpdateOptions options;
  options.bias_correction = likelihood::BiasCorrectionMode::automatic;
  options.bias.way = likelihood::BiasOptions::Way::modes;
  return options;
}

TEST(ModelSupervision, RingsWhenTheDataLeaveTheModelAndThenAsksForCorrection) {
  Supervised s(automatic());
  s.data.rightCols(6).array() += 1.5;  // five times the noise, at every sensor
  std::size_t step = 0;
  std::optional<ModelSupervision::DriftAlarm> alarm;
  while (step < 12 && !(alarm = s.assimilate(step))) ++step;
  ASSERT_TRUE(alarm);
  EXPECT_GE(step, 6u);
  EXPECT_LE(step, 9u);
  EXPECT_GE(alarm->steps, 1);
  EXPECT_LE(alarm->steps, 4);
  EXPECT_EQ(alarm->notice, s.result.notice);
  EXPECT_TRUE(s.result.monitor.alarm);
  EXPECT_EQ(s.result.notice.rfind("the model does not fit the data: ", 0), 0u) << s.result.notice;
  EXPECT_FALSE(s.result.bias_corrected);
  EXPECT_TRUE(s.supervision.asks_for_correction(step));
  EXPECT_EQ(s.supervision.begin_correction(6, step), 6u);
  EXPECT_FALSE(s.supervision.asks_for_correction(step));
}

TEST(ModelSupervision, CorrectsByHandTheStepsNamedAndNoOthers) {
  UpdateOptions options;
  options.learn_bias = true;
  options.bias.way = likelihood::BiasOptions::Way::modes;
  Supervised s(options);
  s.supervision.correct_by_hand(2, 3);
  for (const std::size_t step : {0u, 1u, 2u, 3u, 4u}) {
    s.assimilate(step);
    EXPECT_EQ(s.result.bias_corrected, step == 2 || step == 3) << step;
    EXPECT_EQ(s.store.steps().at(step).corrected_form.has_value(), step == 2 || step == 3) << step;
  }
}

TEST(ModelSupervision, GoesBackToTheStateBeforeAStep) {
  Supervised s({}), fresh({});
  for (const std::size_t step : {0u, 1u, 2u}) fresh.assimilate(step);
  for (const std::size_t step : {0u, 1u, 2u, 3u, 4u}) s.assimilate(step);
  EXPECT_TRUE(s.supervision.remembers(3));
  EXPECT_FALSE(s.supervision.remembers(5));
  EXPECT_EQ(s.supervision.restore(3), 3u);
  // What it says of step 3 is what it says when the steps after it have never come.
  likelihood::StoredStep third = s.store.steps().at(3);
  fresh.add(3);
  const Eigen::VectorXd& central = s.store.projector().central_functions();
  EXPECT_FALSE(s.supervision.check_prediction(3, third, central));
  EXPECT_FALSE(fresh.supervision.check_prediction(3, fresh.store.steps().at(3), central));
  s.supervision.learn(third, {}, fresh.result);
  const MonitorReport ours = fresh.result.monitor;
  fresh.supervision.learn(third, {}, fresh.result);
  EXPECT_EQ(ours.cumulative_sum, fresh.result.monitor.cumulative_sum);
  EXPECT_EQ(ours.upper_probability, fresh.result.monitor.upper_probability);
}

}  // namespace
}  // namespace knothe::assimilation
