#include "knothe/model/grid/grid_solutions.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "knothe/base/error.hpp"
#include "knothe/files/testing/test_folder.hpp"
#include "knothe/model/compress/low_rank.hpp"
#include "knothe/model/reduced/separated_model.hpp"
#include "knothe/model/reduced/truncation_error.hpp"
#include "knothe/model/testing/test_models.hpp"

namespace knothe::model {
namespace {

using files::message_of;
using ::testing::HasSubstr;

constexpr std::size_t k_dofs = 40;

Snapshots front_snapshots() {
  return snapshots_of(travelling_front(k_dofs), two_axes(), uneven_steps(12), k_dofs);
}

/// Solutions that are sums of five modes of quite different norms, and the same expanded.
std::pair<GridSolutions, Snapshots> sums_of_modes() {
  Snapshots frame = front_snapshots();
  frame.outputs.clear();
  const auto times = static_cast<Eigen::Index>(frame.time.size());
  const Eigen::VectorXd size = (Eigen::VectorXd(5) << 1, 30, 1e-3, 0.2, 4).finished();
  const Eigen::MatrixXd modes = normal_matrix(k_dofs, 5, 3) * size.asDiagonal();
  std::vector<Eigen::MatrixXd> coordinates;
  for (std::size_t g = 0; g < frame.grid_size(); ++g)
    coordinates.push_back(size.cwiseInverse().asDiagonal() * normal_matrix(5, times, 100 + g));
  Eigen::MatrixXd lift = Eigen::MatrixXd::Zero(5, times);
  lift.row(0).setLinSpaced(0.1, 1.0);
  Snapshots expanded = frame;
  expanded.values.clear();
  for (const Eigen::MatrixXd& c : coordinates) {
    const Eigen::MatrixXd u = modes * c;
    expanded.values.insert(expanded.values.end(), u.data(), u.data() + u.size());
  }
  const Eigen::MatrixXd u = modes * lift;
  expanded.lift.assign(u.data(), u.data() + u.size());
  return {solutions_in_modes(frame, modes, coordinates, lift), expanded};
}

TEST(GridSolutions, SumsOfModesGiveTheModelOfTheExpandedFields) {
  const auto [solutions, expanded] = sums_of_modes();
  EXPECT_EQ(solutions.snapshots.dof_count(), 5u);
  for (const Form form : {Form::tree, Form::canonical}) {
    CompressionOptions options;
    options.form = form;
    options.modes = 4;
    options.sweeps = 200;
    const ModelContents small = compress(solutions, options), large = compress(expanded, options);
    EXPECT_EQ(small.dof_count(), k_dofs);
    if (form == Form::tree) {  // alternating least squares may end elsewhere for another rounding
      EXPECT_NEAR(small.relative_error, large.relative_error, 1e-10);
      EXPECT_NEAR(small.max_error_m, large.max_error_m, 1e-9 * large.max_error_m);
      const SeparatedModel a(small), b(large);
      for (std::size_t i = 0; i < k_dofs; ++i)
        EXPECT_NEAR(a.evaluate(std::vector{0.63, 1.27}, 7).value[i],
                    b.evaluate(std::vector{0.63, 1.27}, 7).value[i], 1e-9);
    }
    // The errors told are those of the model's own fields.
    const ModelError error = training_error(small, expanded);
    EXPECT_NEAR(std::max(error.relative, error.plain_relative), small.relative_error, 1e-10);
    EXPECT_NEAR(error.max, small.max_error_m, 1e-10 * error.max);
    const TruncationError t = truncation_error(small, solutions), s = truncation_error(small, expanded);
    EXPECT_NEAR(t.persistence, s.persistence, 1e-9);
    ASSERT_EQ(t.variance.size(), s.variance.size());
    for (std::size_t i = 0; i < t.covariance.size(); ++i)
      EXPECT_NEAR(std::abs(t.covariance[i]), std::abs(s.covariance[i]), 1e-8);
  }
  const std::vector<std::size_t> chosen = {3, 17};
  const Snapshots part = solutions.at_dofs(chosen);
  for (std::size_t step = 0; step < part.time.size(); ++step)
    EXPECT_NEAR(part.solution(11)[2 * step + 1], expanded.solution(11)[step * k_dofs + 17], 1e-12);
}

TEST(GridSolutions, CoordinatesThatDoNotFitTheirModesAreRefused) {
  const Snapshots frame = front_snapshots();
  const Eigen::MatrixXd modes = normal_matrix(k_dofs, 2, 3), right = Eigen::MatrixXd::Zero(2, 12);
  const std::vector<Eigen::MatrixXd> few(3, right);
  EXPECT_THAT(message_of<UsageError>([&] { (void)solutions_in_modes(frame, modes, few, right); }),
              HasSubstr("the coordinates do not fit the modes"));
}

}  // namespace
}  // namespace knothe::model
