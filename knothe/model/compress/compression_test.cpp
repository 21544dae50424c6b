#include "knothe/model/compress/compression.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "knothe/base/error.hpp"
#include "knothe/files/testing/test_folder.hpp"
#include "knothe/model/compress/cp_als.hpp"
#include "knothe/model/compress/low_rank.hpp"
#include "knothe/model/reduced/deviation.hpp"
#include "knothe/model/reduced/parameter_product.hpp"
#include "knothe/model/reduced/truncation_error.hpp"
#include "knothe/model/testing/test_models.hpp"
#include "knothe/numerics/linear/dense_svd.hpp"

namespace knothe::model {
namespace {

using files::message_of;
using ::testing::HasSubstr;

constexpr std::size_t k_dofs = 40;

/// Three separable terms of quite different size; with zero lift their canonical rank is 3.
Snapshots three_terms() {
  static const std::vector<double> a = normal_values(3 * k_dofs, 21);
  const auto field = [](std::size_t dof, double t, std::span<const double> p) {
    return a[dof] * std::sin(3 * t) * (1 + p[0] * p[0]) * p[1] +
           0.3 * a[k_dofs + dof] * std::exp(-t) * std::cos(2 * p[0]) * (2 - p[1] * p[1]) +
           0.05 * a[2 * k_dofs + dof] * t * t * (p[0] - 1) * std::sin(4 * p[1]);
  };
  Snapshots snapshots = snapshots_of(field, two_axes(), uneven_steps(12), k_dofs);
  snapshots.lift.assign(12 * k_dofs, 0.0);
  return snapshots;
}

Snapshots front_snapshots() {
  return snapshots_of(travelling_front(k_dofs), two_axes(), uneven_steps(12), k_dofs);
}

TEST(Deviation, WeightsAreTheTrapezoidRule) {
  const std::vector<double> nodes{0.0, 1.0, 3.0};
  const Eigen::VectorXd weights = trapezoid_weights(nodes);
  EXPECT_NEAR(weights[0], 0.5 / 3, 1e-15);
  EXPECT_NEAR(weights[1], 1.5 / 3, 1e-15);
  EXPECT_NEAR(weights[2], 1.0 / 3, 1e-15);
  EXPECT_EQ(trapezoid_weights(std::vector<double>{2.0})[0], 1.0);
  const Snapshots snapshots = front_snapshots();
  const Deviation deviation(snapshots);
  // The grid's weights are products, C order; without a lift in the file the mean over the grid is taken.
  const Eigen::VectorXd first = trapezoid_weights(snapshots.axes[0].nodes),
                        second = trapezoid_weights(snapshots.axes[1].nodes);
  EXPECT_NEAR(deviation.grid_weights()[3 * 6 + 2], first[3] * second[2], 1e-15);
  double mean = 0.0;
  for (std::size_t g = 0; g < 30; ++g) mean += snapshots.solution(g)[4 * k_dofs + 7] / 30;
  EXPECT_NEAR(deviation.lift()(7, 4), mean, 1e-18);
  EXPECT_NEAR(deviation.at_time(4)(11, 7), snapshots.solution(11)[4 * k_dofs + 7] - mean, 1e-18);
}

TEST(LowRank, DominantSpaceAgreesWithTheSvd) {
  // 400 × 300 with singular values 2^-i: more than the direct limit, so the randomised path.
  const Eigen::MatrixXd left = dominant_space(normal_matrix(400, 60, 1), 0.0, 1, 1).basis;
  const Eigen::MatrixXd right = dominant_space(normal_matrix(300, 60, 2), 0.0, 1, 1).basis;
  Eigen::VectorXd sigma(60);
  for (Eigen::Index i = 0; i < 60; ++i) sigma[i] = std::pow(0.5, static_cast<double>(i));
  const Eigen::MatrixXd a = left * sigma.asDiagonal() * right.transpose();
  const double allowed = 1e-8;
  const DominantSpace space = dominant_space(a, allowed, 5, 1);
  const double rest = (a - space.basis * (space.basis.transpose() * a)).squaredNorm();
  EXPECT_LE(rest, allowed * 1.001);
  // The best possible rank for that error: Σ_{i ≥ l} 4^-i ≤ 1e-8 from l = 14 on.
  EXPECT_EQ(space.basis.cols(), 14);
  for (Eigen::Index i = 0; i < 14; ++i) EXPECT_NEAR(std::sqrt(space.energy[i]), sigma[i], 1e-9);
  EXPECT_LT((space.basis.transpose() * space.basis - Eigen::MatrixXd::Identity(14, 14)).norm(), 1e-12);
  EXPECT_EQ(dominant_space(a, allowed, 5, 2).basis, space.basis);
}

TEST(CpAls, RecoversAnExactDecomposition) {
  CpFactors truth;
  truth.factors = {normal_matrix(9, 3, 1), normal_matrix(7, 3, 2), normal_matrix(4, 3, 3),
                   normal_matrix(5, 3, 4)};
  // The unfolding against the definition.
  const CoreTensor tensor{unfolded(truth), {7, 4, 5}};
  double entry = 0.0;
  for (Eigen::Index c = 0; c < 3; ++c) {
    entry +=
        truth.factors[0](8, c) * truth.factors[1](2, c) * truth.factors[2](3, c) * truth.factors[3](1, c);
  }
  EXPECT_NEAR(tensor.unfolded(8, (2 * 4 + 3) * 5 + 1), entry, 1e-14);
  const CpFactors found = als(tensor, random_start(tensor, 3, 17), 2000);
  EXPECT_LT((unfolded(found) - tensor.unfolded).norm(), 1e-6 * tensor.unfolded.norm());
}

TEST(CpAls, ErrorIsTheTrueOneAndFallsWithEveryMode) {
  const CoreTensor tensor{normal_matrix(6, 60, 8), {5, 4, 3}};
  CpFactors cp;
  double before = tensor.unfolded.norm();
  for (std::uint64_t m = 1; m <= 5; ++m) {
    cp = als(tensor, with_one_more_mode(tensor, cp, m), 50);
    EXPECT_EQ(cp.modes(), static_cast<Eigen::Index>(m));
    EXPECT_NEAR(cp.error, (unfolded(cp) - tensor.unfolded).norm(), 1e-7 * before);
    EXPECT_LT(cp.error, before);
    before = cp.error;
  }
}

TEST(Compression, SeparableFieldsAreRecoveredExactly) {
  const Snapshots snapshots = three_terms();
  for (const Form form : {Form::tree, Form::canonical}) {
    CompressionOptions options;
    options.form = form;
    options.modes = 3;
    options.sweeps = 3000;
    const ModelContents model = compress(snapshots, options);
    EXPECT_EQ(model.parameter_modes, 3U);
    EXPECT_EQ(model.space_modes, 3U);
    EXPECT_LT(model.relative_error, form == Form::tree ? 1e-12 : 1e-6);
    EXPECT_NEAR(
        model.relative_error,
        std::max(training_error(model, snapshots).relative, training_error(model, snapshots).plain_relative),
        1e-15);
  }
}

/// ‖u − û‖ by plain loops over all entries.
struct Brute {
  double weighted = 0, weighted_norm = 0, plain = 0, plain_norm = 0, max = 0;
};
Brute brute_force(const ModelContents& contents, const Snapshots& snapshots) {
  const SeparatedModel model(contents);
  const Deviation deviation(snapshots);
  Brute sums;
  for (std::size_t g = 0; g < snapshots.grid_size(); ++g) {
    for (std::size_t t = 0; t < snapshots.time.size(); ++t) {
      const FieldDerivatives field = model.evaluate(snapshots.parameters_at(g), t);
      const double weight = deviation.grid_weights()[static_cast<Eigen::Index>(g)] *
                            deviation.time_weights()[static_cast<Eigen::Index>(t)];
      for (std::size_t dof = 0; dof < k_dofs; ++dof) {
        const double u = snapshots.solution(g)[t * k_dofs + dof], e = u - field.value[dof];
        sums.weighted += weight * e * e;
        sums.weighted_norm += weight * u * u;
        sums.plain += e * e;
        sums.plain_norm += u * u;
        sums.max = std::max(sums.max, std::abs(e));
      }
    }
  }
  return sums;
}

TEST(Compression, ReportedErrorsAreTheTrueOnes) {
  const Snapshots snapshots = front_snapshots();
  for (const Form form : {Form::tree, Form::canonical}) {
    CompressionOptions options;
    options.form = form;
    options.modes = 4;
    const ModelContents model = compress(snapshots, options);
    const ModelError error = training_error(model, snapshots);
    const Brute brute = brute_force(model, snapshots);
    EXPECT_NEAR(error.relative, std::sqrt(brute.weighted / brute.weighted_norm), 1e-9 * error.relative);
    EXPECT_NEAR(error.plain_relative, std::sqrt(brute.plain / brute.plain_norm), 1e-9 * error.plain_relative);
    EXPECT_NEAR(error.max, brute.max, 1e-9 * brute.max);
    EXPECT_EQ(model.max_error_m, error.max);
    EXPECT_GT(error.relative_to_lift, error.relative);
  }
}

TEST(Compression, TreeErrorIsTheTailOfTheSingularValues) {
  // The bound of Eckart and Young, here by Eigen's SVD of the whole weighted matrix.
  const Snapshots snapshots = front_snapshots();
  const Deviation deviation(snapshots);
  Eigen::MatrixXd matrix(30, 12 * static_cast<Eigen::Index>(k_dofs));
  for (Eigen::Index t = 0; t < 12; ++t) {
    matrix.middleCols(t * 40, 40) =
        std::sqrt(deviation.time_weights()[t]) *
        (deviation.grid_weights().cwiseSqrt().asDiagonal() * deviation.at_time(t));
  }
  const Eigen::VectorXd sigma = numerics::singular_values(matrix);
  const std::vector<std::size_t> modes{1, 3, 6, 10};
  CompressionOptions options;
  options.parameter_norm = ParameterNorm::nodes;
  for (const StudiedModel& studied : compression_study(snapshots, options, modes)) {
    const auto r = static_cast<Eigen::Index>(studied.row.parameter_modes);
    const double best = sigma.tail(30 - r).norm() / sigma.norm();
    EXPECT_GE(studied.row.training.relative_to_lift, best * (1 - 1e-9));
    EXPECT_LE(studied.row.training.relative_to_lift, best * 1.001);  // the space basis adds its share
  }
}

TEST(Compression, ManyPointsAreCompressedAsTheSingularValueDecompositionDoes) {
  // 4⁴ = 256 points: more than are decomposed directly. The judge is the SVD of the whole matrix in the norm
  // of the splines, and the errors of the model that it gives.
  std::vector<Axis> axes;
  for (const char* name : {"a", "b", "c", "d"}) axes.push_back({name, {0.0, 0.2, 0.7, 1.0}, "1", "", 1.0});
  const auto field = [](std::size_t dof, double t, std::span<const double> p) {
    const double x = static_cast<double>(dof) / k_dofs;
    return t * x +
           0.2 / (1 + std::exp(-6 * (t * (0.5 + p[0] - 0.3 * p[2]) - x * (1 + 0.2 * p[3]) - 0.3 * p[1])));
  };
  const Snapshots snapshots = snapshots_of(field, axes, uneven_steps(12), k_dofs);
  const Deviation deviation(snapshots);
  for (const ParameterNorm norm : {ParameterNorm::nodes, ParameterNorm::spline}) {
    CompressionOptions options;
    options.parameter_norm = norm;
    const ParameterProduct product(snapshots.axes, options);
    Eigen::MatrixXd matrix(256, 12 * static_cast<Eigen::Index>(k_dofs));
    for (Eigen::Index t = 0; t < 12; ++t)
      matrix.middleCols(t * 40, 40) =
          std::sqrt(deviation.time_weights()[t]) * product.transposed_times(deviation.at_time(t));
    const Eigen::MatrixXd all = numerics::dense_svd(matrix).left;
    for (const std::size_t modes : {5U, 12U, 30U}) {
      options.modes = modes;
      const ModelContents model = compress(snapshots, options);
      const auto r = static_cast<Eigen::Index>(modes);
      const Eigen::MatrixXd left = all.leftCols(r);
      const Eigen::MatrixXd rest = matrix - left * (left.transpose() * matrix);
      // The space basis adds its share, 1e-4 of the square: what is compared is the space of the parameters.
      const Eigen::Map<const RowMatrix> beta(model.joint.data(), r, 256);
      const Eigen::MatrixXd found = product.transposed_times(beta.transpose());
      const Eigen::MatrixXd left_out = matrix - found * (found.transpose() * matrix);
      EXPECT_LT((found.transpose() * found - Eigen::MatrixXd::Identity(r, r)).norm(), 1e-11);
      EXPECT_NEAR(left_out.norm() / matrix.norm(), rest.norm() / matrix.norm(), 1e-10);
      options.threads = 1;
      EXPECT_EQ(compress(snapshots, options).joint, model.joint);
    }
  }
}

TEST(Compression, ToleranceIsKeptInBothNormsAndBothForms) {
  const Snapshots snapshots = front_snapshots();
  for (const Form form : {Form::tree, Form::canonical}) {
    CompressionOptions options;
    options.form = form;
    options.tolerance = form == Form::tree ? 1e-3 : 2e-2;
    options.random_starts = 0;
    const ModelContents model = compress(snapshots, options);
    const ModelError error = training_error(model, snapshots);
    EXPECT_LE(error.relative, options.tolerance);
    EXPECT_LE(error.plain_relative, options.tolerance);
    EXPECT_LT(model.parameter_modes, 30U);
  }
  CompressionOptions impossible;
  impossible.form = Form::canonical;
  impossible.tolerance = 1e-9;
  impossible.max_modes = 2;
  EXPECT_THAT(message_of<NumericalError>([&] { (void)compress(snapshots, impossible); }),
              HasSubstr("does not reach the tolerance 1e-09 with 2 modes"));
  impossible.tolerance = -1;
  EXPECT_THAT(message_of<UsageError>([&] { (void)compress(snapshots, impossible); }),
              HasSubstr("must be between 0 and 1"));
}

TEST(Compression, ModesAreNormalisedAsThePaperSays) {
  const Snapshots snapshots = front_snapshots();
  CompressionOptions options;
  options.modes = 4;
  options.parameter_norm = ParameterNorm::nodes;
  const ModelContents tree = compress(snapshots, options);
  const Deviation deviation(snapshots);
  const Eigen::Map<const RowMatrix> beta(tree.joint.data(), 4, 30);
  EXPECT_LT(
      (beta * deviation.grid_weights().asDiagonal() * beta.transpose() - Eigen::MatrixXd::Identity(4, 4))
          .norm(),
      1e-12);
  options.form = Form::canonical;
  const ModelContents canonical = compress(snapshots, options);
  double before = std::numeric_limits<double>::infinity();
  for (std::size_t k = 0; k < 4; ++k) {
    const Eigen::Map<const Eigen::VectorXd> space(canonical.space.data() + k * k_dofs, k_dofs);
    EXPECT_NEAR(space.norm(), 1.0, 1e-12);
    for (std::size_t i = 0; i < 2; ++i) {
      const Eigen::VectorXd weights = trapezoid_weights(canonical.axes[i].nodes);
      const Eigen::Map<const Eigen::VectorXd> alpha(
          canonical.parameters[i].data() + k * static_cast<std::size_t>(weights.size()), weights.size());
      EXPECT_NEAR(weights.dot(alpha.cwiseAbs2()), 1.0, 1e-12);
      EXPECT_GE(weights.dot(alpha), 0.0);
    }
    const Eigen::Map<const Eigen::VectorXd> time(canonical.temporal.data() + k * 12, 12);
    EXPECT_LE(time.norm(), before);
    before = time.norm();
  }
}

TEST(Compression, OffGridErrorsAndNoWorseWithMoreModes) {
  const Snapshots snapshots = front_snapshots();
  const Field front = travelling_front(k_dofs);
  std::vector<OffGridSolution> off_grid;
  for (const std::vector<double>& p : {std::vector{0.63, 1.13}, std::vector{1.31, 0.71}}) {
    OffGridSolution solution{p, {}};
    for (const double t : snapshots.time) {
      for (std::size_t dof = 0; dof < k_dofs; ++dof) solution.values.push_back(front(dof, t, p));
    }
    off_grid.push_back(solution);
  }
  const std::vector<std::size_t> modes{2, 5, 12};
  for (const Form form : {Form::tree, Form::canonical}) {
    CompressionOptions options;
    options.form = form;
    double before = 1.0;
    for (const StudiedModel& studied : compression_study(snapshots, options, modes, off_grid)) {
      EXPECT_LT(studied.row.training.relative, before);
      before = studied.row.training.relative;
      ASSERT_TRUE(studied.row.off_grid.has_value());
      EXPECT_GT(studied.row.off_grid->relative, 0.0);
      // Off the grid the interpolation comes on top, but does not dominate here.
      EXPECT_LT(studied.row.off_grid->relative, 3 * before + 0.05);
    }
  }
  EXPECT_THAT(message_of<UsageError>([&] {
                off_grid[0].values.pop_back();
                (void)compression_study(snapshots, {}, modes, off_grid);
              }),
              HasSubstr("differ in number of dofs"));
}

TEST(Compression, SameBitsForOneAndTwoThreads) {
  const Snapshots snapshots = front_snapshots();
  for (const Form form : {Form::tree, Form::canonical}) {
    CompressionOptions options;
    options.form = form;
    options.modes = 5;
    options.threads = 1;
    const ModelContents one = compress(snapshots, options);
    options.threads = 2;
    const ModelContents two = compress(snapshots, options);
    EXPECT_EQ(one.space, two.space);
    EXPECT_EQ(one.temporal, two.temporal);
    EXPECT_EQ(one.joint, two.joint);
    EXPECT_EQ(one.relative_error, two.relative_error);
  }
}

TEST(Compression, ImportKeepsOutputsMeshAndNames) {
  const files::TestFolder folder;
  Snapshots snapshots = three_terms();
  snapshots.outputs = {{"force", {"N", "reaction force"}, normal_values(30 * 12, 3)}};
  write_snapshots(snapshots, folder.file("s.h5"));
  CompressionOptions options;
  options.tolerance = 1e-10;
  const SeparatedModel model(import_model_and_error(folder.file("s.h5"), options).model);
  model.save(folder.file("m.h5"));
  const SeparatedModel loaded = SeparatedModel::load(folder.file("m.h5"));
  EXPECT_EQ(loaded.contents().parameter_modes, 3U);
  EXPECT_EQ(loaded.parameter_names(), (std::vector<std::string>{"Y0", "Ad"}));
  EXPECT_THAT(loaded.contents().project, HasSubstr("imported from"));
  const FieldDerivatives field = loaded.evaluate(std::vector{0.9, 1.2}, 5);
  const FieldDerivatives force = loaded.evaluate_output("force", std::vector{0.9, 1.2});
  const std::size_t g = 2 * 6 + 3;
  for (std::size_t dof = 0; dof < k_dofs; ++dof) {
    EXPECT_NEAR(field.value[dof], snapshots.solution(g)[5 * k_dofs + dof], 1e-9);
  }
  for (std::size_t t = 0; t < 12; ++t)
    EXPECT_NEAR(force.value[t], snapshots.outputs[0].values[g * 12 + t], 1e-12);
}

TEST(Compression, FieldsThatDoNotDependOnTheParametersAreFine) {
  const auto constant = [](std::size_t dof, double t, std::span<const double>) {
    return t * static_cast<double>(dof);
  };
  const Snapshots snapshots = snapshots_of(constant, two_axes(), uneven_steps(3), 5);
  for (const Form form : {Form::tree, Form::canonical}) {
    CompressionOptions options;
    options.form = form;
    const ModelContents model = compress(snapshots, options);
    EXPECT_LT(model.relative_error, 1e-14);
    EXPECT_NEAR(SeparatedModel(model).evaluate(std::vector{1.0, 1.0}, 2).value[4], snapshots.time[2] * 4,
                1e-12);
  }
}

TEST(Compression, AFieldThatIsZeroHasAModelThatIsZero) {
  const Snapshots snapshots = snapshots_of([](std::size_t, double, std::span<const double>) { return 0.0; },
                                           two_axes(), uneven_steps(3), 5);
  for (const Form form : {Form::tree, Form::canonical}) {
    CompressionOptions options;
    options.form = form;
    const ModelContents model = compress(snapshots, options);
    EXPECT_EQ(model.relative_error, 0.0);
    EXPECT_EQ(model.max_error_m, 0.0);
    for (const double value : SeparatedModel(model).evaluate(std::vector{1.1, 0.6}, 1).value)
      EXPECT_EQ(value, 0.0);
  }
}

TEST(Compression, OneAndThreeParameters) {
  const auto field = [](std::size_t dof, double t, std::span<const double> p) {
    double value = t * static_cast<double>(dof + 1);
    for (std::size_t i = 0; i < p.size(); ++i) value *= 1 + p[i] * static_cast<double>(i + 1);
    return value;
  };
  for (const std::size_t d : {1U, 3U}) {
    std::vector<Axis> axes;
    for (std::size_t i = 0; i < d; ++i) axes.push_back({std::to_string(i), {0.0, 0.5, 1.0}, "1", "", 1.0});
    const Snapshots snapshots = snapshots_of(field, axes, uneven_steps(4), 6);
    for (const Form form : {Form::tree, Form::canonical}) {
      CompressionOptions options;
      options.form = form;
      options.tolerance = 1e-6;
      const SeparatedModel model(compress(snapshots, options));
      const std::vector<double> p(d, 0.7);  // linear in every parameter: splines add nothing
      const double u = field(5, snapshots.time[3], p);
      EXPECT_NEAR(model.evaluate(p, 3).value[5], u, 1e-5 * u);
    }
  }
}

}  // namespace
}  // namespace knothe::model
