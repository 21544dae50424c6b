#include "knothe/assimilation/update/compatibility.hpp"

#include <gtest/gtest.h>

#include <fstream>
#include <sstream>

#include "knothe/base/error.hpp"

namespace knothe::assimilation {
namespace {

Features both(Feature a, Feature b) {
  Features features;
  add(features, a);
  add(features, b);
  return features;
}

TEST(Compatibility, AConflictIsNamedWithItsReasonAndTheOtherOne) {
  EXPECT_NO_THROW(require_compatible({}));
  EXPECT_NO_THROW(require_compatible(both(Feature::gate, Feature::shared)));
  const Conflict found = find_conflict(both(Feature::changes, Feature::shared));
  EXPECT_EQ(found.key, "");
  EXPECT_EQ(found.message,
            "forgetting, change_points and on_alarm = \"restart\" cannot be combined with errors that steps "
            "share (shared_reference, offset_std, scales, shared_std): these require that old data keep "
            "their full weight");
  EXPECT_EQ(find_conflict(both(Feature::noise_level, Feature::student_t)).key, "method.noise_level");
  EXPECT_THROW(require_compatible(both(Feature::changes, Feature::shared)), UsageError);
}

TEST(Compatibility, NoiseSaysWhatItHas) {
  const likelihood::NoiseModel plain = likelihood::NoiseModel::independent(Eigen::Vector2d(1, 2));
  EXPECT_TRUE(features_of(plain).none());
  const likelihood::NoiseModel clock = plain.with_step_error(3, Eigen::Vector2d(1, 0));
  EXPECT_EQ(features_of(clock), both(Feature::dependent, Feature::dependent));
  EXPECT_EQ(features_of(clock.with_offsets(0.1)),
            both(Feature::dependent, Feature::shared) | both(Feature::shared_clock, Feature::shared_clock));
}

TEST(Compatibility, TheDocumentationHasTheTableAsItIs) {
  std::ifstream file(KNOTHE_DOCS "/explanation/assimilation.md");
  std::stringstream text;
  text << file.rdbuf();
  EXPECT_NE(text.str().find(compatibility_table()), std::string::npos)
      << "docs/explanation/assimilation.md, \"What cannot be combined\", should have:\n"
      << compatibility_table();
}

}  // namespace
}  // namespace knothe::assimilation
