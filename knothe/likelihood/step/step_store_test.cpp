#include "knothe/likelihood/step/step_store.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "knothe/base/error.hpp"
#include "knothe/likelihood/testing/test_models.hpp"

namespace knothe::likelihood {
namespace {

struct StepStoreTest : ::testing::Test {
  static constexpr Eigen::Index n = 6;
  std::shared_ptr<const model::ObservedModel> model =
      test::random_model(std::make_shared<test::CurvedFunctions>(), n, 4, 4, 33);
  Eigen::VectorXd std = Eigen::VectorXd::Constant(n, 0.5);
  Eigen::MatrixXd data = test::synthetic_data(*model, Eigen::Vector2d(1.0, 1.2), std, 4);

  /// Steps share an error of each sensor, so that the form of one depends on those before it.
  [[nodiscard]] StepStore make(bool shared) const {
    const NoiseModel noise = NoiseModel::independent(std);
    return {model, shared ? noise.with_offsets(0.2) : noise, Eigen::Vector2d(1, 1)};
  }
  void add(StepStore& store, std::size_t step) const {
    store.add(test::datum(step, data.col(static_cast<Eigen::Index>(step))), step);
  }
};

bool same(const StepForm& a, const StepForm& b) {
  return a.quadratic == b.quadratic && a.linear == b.linear && a.constant == b.constant &&
         a.log_normaliser == b.log_normaliser && a.used == b.used;
}

std::string message(const std::function<void()>& action) {
  try {
    action();
  } catch (const UsageError& error) {
    return error.what();
  }
  return "";
}

TEST_F(StepStoreTest, FormsDoNotDependOnTheOrderInWhichStepsCame) {
  for (const bool shared : {false, true}) {
    StepStore in_order = make(shared), late = make(shared);
    for (const std::size_t step : {0u, 1u, 2u, 3u}) add(in_order, step);
    for (const std::size_t step : {3u, 0u, 2u, 1u}) add(late, step);
    EXPECT_EQ(in_order.update_forms(), 0u);
    EXPECT_EQ(late.update_forms(), 0u);
    EXPECT_EQ(late.update_forms(), std::nullopt);
    for (const auto& [step, stored] : in_order.steps())
      EXPECT_TRUE(same(stored.form, late.steps().at(step).form)) << step;
    EXPECT_EQ(late.last(), 3u);
  }
}

TEST_F(StepStoreTest, AStepTakenOutLeavesNoTrace) {
  for (const bool shared : {false, true}) {
    StepStore all = make(shared), without = make(shared);
    for (const std::size_t step : {0u, 1u, 2u, 3u}) {
      add(all, step);
      if (step != 1) add(without, step);
    }
    (void)all.update_forms();
    (void)without.update_forms();
    all.steps().at(0).log_evidence = -1;
    all.steps().at(3).log_evidence = -4;
    all.withdraw(1, {});
    EXPECT_EQ(all.update_forms(), 1u);
    for (const auto& [step, stored] : without.steps())
      EXPECT_TRUE(same(stored.form, all.steps().at(step).form)) << step;
    EXPECT_EQ(all.steps().at(0).log_evidence, -1);  // of the data before it
    EXPECT_FALSE(all.steps().at(3).log_evidence);
  }
}

/// Complete, incomplete and with a noise of its own: G of each is its own or that of all complete ones.
TEST_F(StepStoreTest, AStepOfSeveralDataIsTheSumOfTheirFormsHoweverTheyCameAndWent) {
  std::vector<DatumPointer> all;
  for (std::int64_t k = 0; k < 5; ++k) {
    Datum datum{{"s", "", k}, 0, 0, data.col(k % 4), std::nullopt};
    if (k == 1 || k == 3) datum.values[k] = std::numeric_limits<double>::quiet_NaN();
    if (k == 2) datum.noise = GaussianNoise::independent(2 * std);
    all.push_back(std::make_shared<const Datum>(datum));
  }
  const auto form_of = [&](const std::vector<std::size_t>& kept, const std::vector<std::size_t>& withdrawn) {
    StepStore store = make(false);
    for (const std::size_t k : kept) store.add(all[k], 0);
    for (const std::size_t k : withdrawn) store.withdraw(0, all[k]->key);
    (void)store.update_forms();
    return store.steps().at(0).form;
  };
  std::vector<StepForm> alone;
  for (const std::size_t k : {0u, 1u, 2u, 3u, 4u}) alone.push_back(form_of({k}, {}));
  StepForm sum = alone[0];
  for (const std::size_t k : {1u, 2u, 3u, 4u}) sum.add(alone[k]);
  std::vector<std::size_t> order = {0, 1, 2, 3, 4};
  do {
    EXPECT_TRUE(same(form_of(order, {}), sum));
    for (const std::size_t last : order) {
      std::vector<std::size_t> others = order;
      std::erase(others, last);
      EXPECT_TRUE(same(form_of(order, others), alone[last])) << last;
      StepStore store = make(false);  // the one that is left is joined by the others again
      for (const std::size_t k : order) store.add(all[k], 0);
      for (const std::size_t k : others) store.withdraw(0, all[k]->key);
      for (const std::size_t k : others) store.add(all[k], 0);
      (void)store.update_forms();
      EXPECT_TRUE(same(store.steps().at(0).form, sum)) << last;
    }
  } while (std::next_permutation(order.begin(), order.end()));
}

TEST_F(StepStoreTest, StepsThatAreLetGoComeAgainToTheBit) {
  StepStore all = make(false), few = make(false);
  data(2, 1) = std::numeric_limits<double>::quiet_NaN();
  few.set_recall([&](std::size_t step) {
    return std::vector<DatumPointer>{test::datum(step, data.col(static_cast<Eigen::Index>(step)))};
  });
  for (StepStore* store : {&all, &few}) {
    for (const std::size_t step : {0u, 1u, 2u, 3u}) add(*store, step);
    (void)store->update_forms();
    store->at(1).log_evidence = -1;
  }
  const auto expect_all = [&] {
    std::size_t seen = 0;
    few.for_each(0, 4, [&](std::size_t step, const StoredStep& stored) {
      EXPECT_EQ(step, seen++);
      EXPECT_TRUE(same(stored.form, all.at(step).form)) << step;
      EXPECT_EQ(stored.time, all.at(step).time);
    });
    EXPECT_EQ(seen, 4u);
  };
  few.keep_in_memory(4, 4);
  EXPECT_EQ(few.steps().size(), 2u);  // the last two
  EXPECT_EQ(few.log_evidence(1), -1);
  EXPECT_FALSE(few.log_evidence(0));
  expect_all();
  EXPECT_EQ(few.steps().size(), 2u);
  EXPECT_EQ(few.step_before(2), 1u);
  EXPECT_EQ(few.step_before(0), std::nullopt);
  EXPECT_TRUE(few.contains(1));
  EXPECT_EQ(few.at(1).log_evidence, -1);
  EXPECT_EQ(few.steps().size(), 3u);
  few.keep_in_memory(4, 4);
  few.withdraw(0, {});
  EXPECT_EQ(few.update_forms(), 0u);
  EXPECT_FALSE(few.log_evidence(1));
  add(few, 0);
  (void)few.update_forms();
  expect_all();
}

TEST_F(StepStoreTest, RefusesWhatIsNotThereAndWhatCannotBe) {
  StepStore store = make(false);
  add(store, 2);
  EXPECT_EQ(message([&] { store.withdraw(1, {}); }),
            "step 1 is not assimilated: there is nothing to withdraw");
  EXPECT_EQ(message([&] { (void)store.at(1); }), "step 1 is not assimilated: there is no posterior of it");
  EXPECT_THROW(store.add(test::datum(3, Eigen::VectorXd::Constant(n, 1e200)), 3), DataError);
  EXPECT_EQ(store.steps().size(), 1u);
}

TEST_F(StepStoreTest, GoesBackNoFurtherThanTheFirstStep) {
  StepStore store = make(false);
  for (const std::size_t step : {0u, 1u, 3u}) add(store, step);
  EXPECT_EQ(store.before(3, 0), 3u);
  EXPECT_EQ(store.before(3, 1), 1u);
  EXPECT_EQ(store.before(3, 9), 0u);
}

TEST_F(StepStoreTest, SumsAreOfTheFormsAsAssimilated) {
  StepStore store = make(false);
  add(store, 0);
  add(store, 1);
  StoredStep& second = store.steps().at(1);
  FormSums plain = FormSums::zero(3), corrected = FormSums::zero(3), levels = FormSums::zero(3);
  for (const auto& [step, stored] : store.steps()) plain.add(stored);
  second.corrected_form = StepForm::zero(3);
  for (const auto& [step, stored] : store.steps()) corrected.add(stored);
  EXPECT_TRUE(same(corrected.form, [&] {
    StepForm sum = StepForm::zero(3);
    sum.add(store.steps().at(0).form);
    sum.add(StepForm::zero(3));
    return sum;
  }()));
  EXPECT_FALSE(same(corrected.form, plain.form));
  // Sizes of a discrepancy: before it was there, each was the sum without.
  second.corrected_form.reset();
  second.levels = {StepForm::zero(3), second.form};
  for (const auto& [step, stored] : store.steps()) levels.add(stored);
  ASSERT_EQ(levels.levels.size(), 2u);
  EXPECT_TRUE(same(levels.form, plain.form));
  EXPECT_TRUE(same(levels.levels[0], corrected.form));
  EXPECT_TRUE(same(levels.levels[1], plain.form));
}

}  // namespace
}  // namespace knothe::likelihood
