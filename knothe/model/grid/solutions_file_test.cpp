#include "knothe/model/grid/solutions_file.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "knothe/base/error.hpp"
#include "knothe/files/testing/test_folder.hpp"
#include "knothe/model/testing/test_models.hpp"

namespace knothe::model {
namespace {

constexpr SolutionsReading k_streamed{.whole_bytes = 0, .block_bytes = 6 * 4 * 36 * 8};

/// A front on the dofs of a mesh, so that later points have directions that the first ones lack.
Snapshots front(bool with_lift) {
  const Field field = travelling_front(36);
  Snapshots snapshots = snapshots_of(field, two_axes(), uneven_steps(4), 36);
  snapshots.mesh = small_mesh();
  snapshots.dofs = dofs_on(*snapshots.mesh);
  snapshots.outputs = {{"force", {"N", "reaction force"}, normal_values(30 * 4, 3)}};
  if (!with_lift) return snapshots;
  snapshots.lift = normal_values(4 * 36, 5);
  for (double& value : snapshots.lift) value *= 1e-5;
  return snapshots;
}

TEST(SolutionsFile, ReadInBlocksIsTheFileToThePrecisionStated) {
  const files::TestFolder folder;
  for (const bool with_lift : {false, true}) {
    const Snapshots written = front(with_lift);
    write_snapshots(written, folder.file("s.h5"));
    const GridSolutions read = read_solutions(folder.file("s.h5"), k_streamed);
    const Eigen::Index r = read.basis.cols();
    EXPECT_LT((read.basis.transpose() * read.basis - Eigen::MatrixXd::Identity(r, r)).norm(), 1e-12);
    double largest = 0;
    for (std::size_t g = 0; g < 30; ++g) {
      const Eigen::Map<const Eigen::MatrixXd> u(written.solution(g).data(), 36, 4);
      EXPECT_LT((read.field(g) - u).norm(), 1e-6 * u.norm());
      largest = std::max(largest, (read.field(g) - u).cwiseAbs().maxCoeff());
    }
    EXPECT_NEAR(read.largest_left_out, largest, 1e-15);
    EXPECT_EQ(read.dofs().points, written.dofs.points);
    EXPECT_EQ(read.snapshots.outputs[0].values, written.outputs[0].values);
    // The models are the same.
    CompressionOptions options;
    options.modes = 6;
    const ModelContents whole = compress(written, options), blocks = compress(read, options);
    EXPECT_NEAR(blocks.relative_error, whole.relative_error, 3e-7);
    EXPECT_NEAR(blocks.max_error_m, whole.max_error_m, 2 * largest + 1e-12);
    EXPECT_EQ(blocks.mesh->points, whole.mesh->points);
    const TruncationError a = truncation_error(whole, written), b = truncation_error(blocks, read);
    ASSERT_EQ(a.count, b.count);
    for (std::size_t t = 0; t < 4; ++t) {
      double trace_a = 36 * a.variance[t], trace_b = 36 * b.variance[t];
      for (std::size_t k = 0; k < a.count; ++k) {
        trace_a += a.covariance[a.count * a.count * t + (a.count + 1) * k];
        trace_b += b.covariance[b.count * b.count * t + (b.count + 1) * k];
      }
      EXPECT_NEAR(trace_b, trace_a, 1e-3 * trace_a);
    }
  }
}

TEST(SolutionsFile, TheRoundingOfSinglePrecisionTakesNoDirections) {
  const files::TestFolder folder;
  // More dofs than are decomposed directly.
  const Field field = [](std::size_t dof, double t, std::span<const double> p) {
    const double x = static_cast<double>(dof) / 400;
    return std::tanh(3 * (x - t * (0.5 + 0.3 * p[0] - 0.1 * p[1])));
  };
  const Snapshots written = snapshots_of(field, two_axes(), uneven_steps(40), 400);
  write_snapshots(written, folder.file("double.h5"));
  write_snapshots(written, folder.file("single.h5"), true);
  const GridSolutions fine = read_solutions(folder.file("double.h5"), k_streamed),
                      coarse = read_solutions(folder.file("single.h5"), k_streamed);
  EXPECT_LT(fine.basis.cols(), 40);
  EXPECT_LE(coarse.basis.cols(), fine.basis.cols() + 1);
  EXPECT_LT(coarse.largest_left_out, 1e-5);
}

TEST(SolutionsFile, SmallFilesAreReadAsTheyAre) {
  const files::TestFolder folder;
  write_snapshots(front(false), folder.file("s.h5"));
  const GridSolutions read = read_solutions(folder.file("s.h5"));
  EXPECT_EQ(read.basis.size(), 0);
  EXPECT_EQ(read.snapshots.values, front(false).values);
}

TEST(SolutionsFile, ABadNumberIsNamedAlsoInALaterBlock) {
  const files::TestFolder folder;
  const Snapshots s = front(false);
  std::vector<double> values = s.values;
  values[((3 * 6 + 2) * 4 + 1) * 36 + 7] = std::nan("");
  files::Hdf5Writer file(folder.file("s.h5"));
  const std::vector<std::string> names{"Y0", "Ad"};
  file.texts_attribute("/", "parameters", names);
  for (const Axis& axis : s.axes)
    file.write("/parameters/" + axis.name, axis.nodes, {axis.nodes.size()}, {"1", ""});
  file.write("/time", s.time, {4}, {"1", ""});
  file.write("/snapshots", values, {5, 6, 4, 36}, {"m", ""});
  file.close();
  EXPECT_THAT(files::message_of<DataError>([&] { (void)read_solutions(folder.file("s.h5"), k_streamed); }),
              ::testing::HasSubstr("snapshots[3,2,1,7] is NaN"));
}

TEST(SolutionsFile, AFieldThatIsZeroIsNoError) {
  const files::TestFolder folder;
  write_snapshots(
      snapshots_of([](std::size_t, double, std::span<const double>) { return 0.0; }, two_axes(), {1.0}, 5),
      folder.file("s.h5"));
  const GridSolutions read = read_solutions(folder.file("s.h5"), k_streamed);
  EXPECT_EQ(read.field(29).norm(), 0.0);
  EXPECT_EQ(compress(read, {}).max_error_m, 0.0);
}

}  // namespace
}  // namespace knothe::model
