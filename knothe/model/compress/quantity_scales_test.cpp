#include "knothe/model/compress/quantity_scales.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/files/testing/test_folder.hpp"
#include "knothe/model/observe/scalar_observations.hpp"

namespace knothe::model {
namespace {

using files::message_of;
using ::testing::HasSubstr;

/// A force of 1e5 N and a strain of 1e-6, smooth in p and q.
double formula(std::size_t dof, double t, double p, double q) {
  return dof == 0 ? 1e5 * std::exp(-p * t) * (1 + 0.3 * q) : 1e-6 * (std::sin(t + q) + p * p * t);
}

Snapshots quantities() {
  Snapshots snapshots;
  snapshots.axes = {{"p", {}, "1", "first"}, {"q", {}, "1", "second"}};
  for (Axis& axis : snapshots.axes)
    for (int i = 0; i < 7; ++i) axis.nodes.push_back(0.5 + i / 6.0);
  snapshots.time = {0.5, 1, 1.5};
  snapshots.quantities = {{"force", "N"}, {"strain", "1"}};
  snapshots.field = {"1", "quantities"};
  for (const double p : snapshots.axes[0].nodes)
    for (const double q : snapshots.axes[1].nodes)
      for (const double t : snapshots.time)
        for (std::size_t dof : {0, 1}) snapshots.values.push_back(formula(dof, t, p, q));
  return snapshots;
}

SeparatedModel model_of(const Snapshots& snapshots, Form form = Form::tree) {
  CompressionOptions options;
  options.form = form;
  options.modes = 8;
  return SeparatedModel(compress(snapshots, options), "the model");
}

TEST(Quantities, OfAllSizesAreSeparatedEquallyWell) {
  for (const Form form : {Form::tree, Form::canonical}) {
    const SeparatedModel model = model_of(quantities(), form);
    for (std::size_t step : {0, 1, 2}) {
      const std::vector<double> value = model.evaluate(std::vector{0.83, 1.21}, step).value;
      const double t = quantities().time[step];
      EXPECT_NEAR(value[0] / formula(0, t, 0.83, 1.21), 1, 1e-4) << to_text(form);
      EXPECT_NEAR(value[1] / formula(1, t, 0.83, 1.21), 1, 1e-4) << to_text(form);
    }
  }
}

TEST(Quantities, HaveTheSameErrorsWhateverTheirUnit) {
  Snapshots other = quantities();
  for (std::size_t i = 0; i < other.values.size(); i += 2) other.values[i] *= 1e-9;
  CompressionOptions options;
  options.modes = 3;
  const ModelContents one = compress(quantities(), options), two = compress(other, options);
  EXPECT_GT(one.relative_error, 0);
  EXPECT_NEAR(one.relative_error / two.relative_error, 1, 1e-6);
  EXPECT_NEAR(one.max_error_m / two.max_error_m, 1, 1e-6);
  // Off the grid too: the model of half of the nodes, judged at a point between them.
  const auto off_grid = [](Snapshots snapshots, const ModelContents& model) {
    OffGridSolution at{snapshots.parameters_at(0), {}};
    at.parameters[0] += 0.01;
    const auto solution = snapshots.solution(0);
    at.values.assign(solution.begin(), solution.end());
    return off_grid_error_in_scales(snapshots, model, 1, [&](std::size_t) { return at; });
  };
  const ModelError first = off_grid(quantities(), one), second = off_grid(other, two);
  EXPECT_GT(first.max, 1e-4);
  EXPECT_NEAR(first.max / second.max, 1, 1e-6);
  EXPECT_NEAR(first.relative / second.relative, 1, 1e-6);
  EXPECT_THAT(largest_error(0.01, one.quantities), HasSubstr("0.01 of how a quantity varies"));
  EXPECT_EQ(largest_error(1.5e-6, {}), "at most 1.5 µm on any dof");
}

TEST(Quantities, AreOutputsAndAreObservedByName) {
  const SeparatedModel model = model_of(quantities());
  EXPECT_EQ(model.output_names(), (std::vector<std::string>{"force", "strain"}));
  EXPECT_EQ(model.quantity("strain"), 1u);
  EXPECT_FALSE(model.quantity("stress").has_value());
  const std::vector<double> p = {0.83, 1.21};
  const std::vector<double> strain = model.evaluate_output("strain", p).value;
  const ScalarObservation sensor{"strain", "strain", {}, {}, {}};
  const ObservedModel observed = with_scalars(observe(model, Dofs()), model, {&sensor, 1});
  EXPECT_EQ(observed.functions->count(), model.functions()->count());
  for (std::size_t step : {0, 1, 2}) {
    const double value = model.evaluate(p, step).value[1];
    EXPECT_NEAR(strain[step], value, 1e-12 * std::abs(value));
    EXPECT_NEAR(observed.predict(Eigen::Vector2d(p[0], p[1]), step)[0], value, 1e-12 * std::abs(value));
  }
  EXPECT_THAT(message_of<DataError>([&] {
                (void)observe(model, {{0, 0, 0}, {0}});
              }),
              HasSubstr("the model has no /dofs"));
}

TEST(Quantities, AreInTheFilesOfSnapshotsAndModels) {
  const files::TestFolder folder;
  write_snapshots(quantities(), folder.file("s.h5"));
  const Snapshots read = read_snapshots(folder.file("s.h5"));
  ASSERT_EQ(read.quantities.size(), 2u);
  EXPECT_EQ(read.quantities[0].name, "force");
  EXPECT_EQ(read.quantities[0].units, "N");
  const SeparatedModel model = model_of(read);
  write_model(model.contents(), folder.file("m.h5"));
  const SeparatedModel again = SeparatedModel::load(folder.file("m.h5"));
  EXPECT_EQ(again.quantity("strain"), 1u);
  EXPECT_EQ(again.output_names(), model.output_names());
  EXPECT_EQ(again.evaluate(std::vector{0.83, 1.21}, 1).value,
            model.evaluate(std::vector{0.83, 1.21}, 1).value);
  Snapshots wrong = quantities();
  wrong.quantities[1].name = "force";
  EXPECT_THAT(message_of<DataError>([&] { write_snapshots(wrong, folder.file("s.h5")); }),
              HasSubstr("attribute names of /dofs has \"force\" twice"));
  wrong.quantities.pop_back();
  EXPECT_THAT(message_of<DataError>([&] { write_snapshots(wrong, folder.file("s.h5")); }),
              HasSubstr("attribute names of /dofs has 1 entries, the field has 2 dofs"));
}

}  // namespace
}  // namespace knothe::model
