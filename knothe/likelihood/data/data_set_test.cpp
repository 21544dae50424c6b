#include "knothe/likelihood/data/data_set.hpp"

#include <gtest/gtest.h>

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
  EXPECT_TRUE(set.steps().empty());
  EXPECT_EQ(set.last_step(), std::nullopt);
  EXPECT_TRUE(set.add(datum(3, "a", 2)));
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
