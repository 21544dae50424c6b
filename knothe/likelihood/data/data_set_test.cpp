#include "knothe/likelihood/data/data_set.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "knothe/base/error.hpp"

namespace knothe::likelihood {
namespace {

DatumPointer datum(std::size_t step, std::string source, double value, std::size_t time_index) {
  return std::make_shared<const Datum>(Datum{
      {std::move(source), "s", 0}, step, time_index, Eigen::VectorXd::Constant(1, value), std::nullopt});
}

DatumPointer datum(std::size_t step, std::string source, double value) {
  return datum(step, std::move(source), value, step);
}

TEST(DataSet, IsTheSameInWhateverOrderTheDataCame) {
  const std::vector<DatumPointer> data = {datum(0, "a", 1), datum(0, "b", 2), datum(2, "a", 3),
                                          datum(1, "b", 4)};
  DataSet forward, backward;
  for (const DatumPointer& d : data) EXPECT_TRUE(forward.add(d));
  for (auto it = data.rbegin(); it != data.rend(); ++it) (void)backward.add(*it);
  EXPECT_FALSE(forward.add(datum(0, "a", 9)));  // its key is there: nothing changes
  const auto values = [](const DataSet& set, std::optional<std::size_t> after, std::size_t step) {
    std::vector<double> found;
    for (const DatumPointer& d : set.between(after, step)) found.push_back(d->values[0]);
    return found;
  };
  for (const DataSet* set : {&forward, &backward}) {
    EXPECT_EQ(values(*set, std::nullopt, 2), (std::vector<double>{1, 2, 4, 3}));
    EXPECT_EQ(values(*set, 0, 1), (std::vector<double>{4}));
    EXPECT_EQ(set->last(0)->values[0], 2);
    EXPECT_EQ(set->last(5), nullptr);
    EXPECT_EQ(set->count(0), 2U);
    EXPECT_EQ(set->last_step(), 2U);
  }
}

TEST(DataSet, WhatIsWithdrawnLeavesNoTrace) {
  DataSet set;
  (void)set.add(datum(3, "a", 1));
  EXPECT_FALSE(set.withdraw(3, {"b", "s", 0}));
  EXPECT_FALSE(set.withdraw(4, {"a", "s", 0}));
  EXPECT_TRUE(set.withdraw(3, {"a", "s", 0}));
  EXPECT_TRUE(set.step_numbers().empty());
  EXPECT_EQ(set.last_step(), std::nullopt);
  EXPECT_TRUE(set.add(datum(3, "a", 2)));
}

TEST(DataSet, DataThatArePutAwayAreTheSame) {
  DataSet set;
  set.set_archive(::testing::TempDir());
  for (std::size_t step = 0; step < 20; ++step) {
    (void)set.add(datum(step, "a", 0.1 * step));
    (void)set.add(datum(step, "b", std::numeric_limits<double>::quiet_NaN()));
  }
  Datum own = *datum(3, "c", 1);
  own.noise = GaussianNoise::independent(Eigen::VectorXd::Ones(1));
  (void)set.add(std::make_shared<const Datum>(own));
  set.keep_in_memory(10, 11);
  EXPECT_EQ(set.in_memory(), 3U);  // and the one with a noise of its own
  const DataSet copy = set;
  EXPECT_TRUE(set.contains(7, {"b", "s", 0}));
  EXPECT_FALSE(set.add(datum(7, "a", 9)));
  EXPECT_TRUE(set.withdraw(7, {"b", "s", 0}));
  EXPECT_TRUE(set.withdraw(8, {"a", "s", 0}));
  EXPECT_TRUE(set.withdraw(8, {"b", "s", 0}));
  EXPECT_TRUE(set.add(datum(7, "c", 5)));
  for (int again = 0; again < 2; ++again) {
    EXPECT_EQ(set.count(7), 2U);
    EXPECT_EQ(set.at(7)[0]->values[0], 0.1 * 7);
    EXPECT_EQ(set.last(7)->values[0], 5);
    EXPECT_EQ(set.last(7)->key, (DatumKey{"c", "s", 0}));
    EXPECT_EQ(set.last(3)->noise.has_value(), true);
    EXPECT_EQ(set.count(8), 0U);
    EXPECT_EQ(set.step_from(8), 9U);
    EXPECT_EQ(set.step_after(6, 2), 9U);
    EXPECT_EQ(set.step_after(6, 20), std::nullopt);
    EXPECT_EQ(set.step_of_last(5, 9), 6U);  // 2 each at 9, 7, 6
    EXPECT_EQ(set.step_of_last(999, 9), 0U);
    set.keep_in_memory(19, 19);
    EXPECT_EQ(set.in_memory(), 1U);
  }
  EXPECT_EQ(copy.count(7), 2U);
  EXPECT_TRUE(std::isnan(copy.last(7)->values[0]));
  EXPECT_EQ(copy.all().size(), 41U);
}

TEST(DataSet, DataStayInMemoryWhereTheFileCannotBeMade) {
  DataSet set;
  set.set_archive("/nowhere");
  for (std::size_t step = 0; step < 20; ++step) (void)set.add(datum(step, "a", 1.0 * step));
  set.keep_in_memory(0, 0);
  EXPECT_EQ(set.in_memory(), 20U);
  EXPECT_EQ(set.last(7)->values[0], 7);
}

TEST(DataSet, DataOfAStepAreOfOneModelTime) {
  DataSet set;
  (void)set.add(datum(3, "a", 1));
  try {
    (void)set.add(datum(3, "b", 1, 2));
    FAIL();
  } catch (const UsageError& error) {
    EXPECT_STREQ(error.what(), "step 3: its data are of model time 3, not 2");
  }
}

}  // namespace
}  // namespace knothe::likelihood
