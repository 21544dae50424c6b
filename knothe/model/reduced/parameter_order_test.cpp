#include "knothe/model/reduced/parameter_order.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "knothe/base/error.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/testing/test_folder.hpp"
#include "knothe/model/testing/test_models.hpp"

namespace knothe::model {
namespace {

using files::message_of;
using ::testing::HasSubstr;

TEST(ParameterOrder, SwappedModelsAreTheSameFunction) {
  for (const Form form : {Form::canonical, Form::tree}) {
    const SeparatedModel model(random_contents(form));
    const SeparatedModel swapped(
        with_parameter_order(random_contents(form), std::vector<std::string>{"Ad", "Y0"}));
    EXPECT_EQ(swapped.parameter_names(), (std::vector<std::string>{"Ad", "Y0"}));
    const FieldDerivatives a = model.evaluate(std::vector{0.8, 1.4}, 2, {}, 1);
    const FieldDerivatives b = swapped.evaluate(std::vector{1.4, 0.8}, 2, {}, 1);
    for (std::size_t i = 0; i < a.count; ++i) {
      EXPECT_NEAR(a.value[i], b.value[i], 1e-11);
      EXPECT_NEAR(a.gradient[2 * i], b.gradient[2 * i + 1], 1e-10);
    }
    const FieldDerivatives f = model.evaluate_output("force", std::vector{0.8, 1.4});
    const FieldDerivatives g = swapped.evaluate_output("force", std::vector{1.4, 0.8});
    for (std::size_t t = 0; t < f.count; ++t) EXPECT_NEAR(f.value[t], g.value[t], 1e-11);
  }
}

TEST(ParameterOrder, ThreeAxesInAnyOrder) {
  ModelContents model = random_contents(Form::tree);
  model.axes.push_back({"E", {0.8, 1.0, 1.2}, "1", "stiffness", 3e10});
  model.joint = normal_values(3 * 5 * 6 * 3, 11);
  model.outputs.clear();
  const SeparatedModel original(model);
  const SeparatedModel moved(with_parameter_order(model, std::vector<std::string>{"E", "Y0", "Ad"}));
  EXPECT_NEAR(original.evaluate(std::vector{0.8, 1.4, 1.1}, 1).value[5],
              moved.evaluate(std::vector{1.1, 0.8, 1.4}, 1).value[5], 1e-11);
}

TEST(ParameterOrder, NamesMustBeTheModels) {
  const auto complaint = [](const std::vector<std::string>& names) {
    return message_of<ProjectError>([&] { (void)with_parameter_order(random_contents(Form::tree), names); });
  };
  EXPECT_THAT(complaint({"Y0", "AD"}), HasSubstr("the model has no parameter AD (did you mean \"Ad\"?)"));
  EXPECT_THAT(complaint({"Y0"}), HasSubstr("the model's parameter Ad is missing"));
  EXPECT_THAT(complaint({"Y0", "Y0"}), HasSubstr("parameter Y0 is named twice"));
}

TEST(FieldFile, DisplacementsLandOnTheirPoints) {
  const files::TestFolder folder;
  ModelContents model = random_contents(Form::tree);
  std::vector<double> values(36);
  for (std::size_t i = 0; i < values.size(); ++i) values[i] = static_cast<double>(i);
  write_field(model, values, 0.5, folder.file("u.vtu"));
  const std::string text = files::read_text(folder.file("u.vtu"));
  // Dofs run over the points in order, so the block of the vector field is 0, 1, 2, …
  const std::string block(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(double));
  EXPECT_NE(text.find(block), std::string::npos);
  EXPECT_THAT(text, HasSubstr("Name=\"displacement\""));
  EXPECT_THAT(text, HasSubstr("Name=\"TimeValue\""));
  model.mesh.reset();
  EXPECT_THAT(message_of<DataError>([&] { write_field(model, values, 0.5, folder.file("u.vtu")); }),
              HasSubstr("the model has no mesh"));
}

}  // namespace
}  // namespace knothe::model
