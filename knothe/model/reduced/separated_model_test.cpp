#include "knothe/model/reduced/separated_model.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <random>

#include "knothe/base/error.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/seal.hpp"
#include "knothe/files/testing/test_folder.hpp"
#include "knothe/model/testing/test_models.hpp"
#include "knothe/numerics/functions/cubic_spline.hpp"

namespace knothe::model {
namespace {

using files::message_of;
using files::TestFolder;
using ::testing::HasSubstr;

/// The sum over modes written out, with 1-D interpolation by another path (CubicSpline through node values).
double by_definition(const ModelContents& m, std::size_t dof, std::size_t t, std::span<const double> p) {
  const std::size_t dofs = m.dof_count();
  const auto spline = [](const std::vector<double>& nodes, const std::vector<double>& values, double x) {
    return numerics::CubicSpline(nodes, values).value(x);
  };
  double u = m.lift[t * dofs + dof];
  for (std::size_t k = 0; k < m.parameter_modes; ++k) {
    if (m.form == Form::canonical) {
      double term = m.space[k * dofs + dof] * m.temporal[k * m.time.size() + t];
      for (std::size_t i = 0; i < 2; ++i) {
        const std::size_t n = m.axes[i].nodes.size();
        const auto first = m.parameters[i].begin() + static_cast<std::ptrdiff_t>(k * n);
        term *= spline(m.axes[i].nodes, {first, first + static_cast<std::ptrdiff_t>(n)}, p[i]);
      }
      u += term;
      continue;
    }
    const std::size_t n0 = m.axes[0].nodes.size(), n1 = m.axes[1].nodes.size();
    std::vector<double> rows;
    for (std::size_t i = 0; i < n0; ++i) {
      const auto first = m.joint.begin() + static_cast<std::ptrdiff_t>((k * n0 + i) * n1);
      rows.push_back(spline(m.axes[1].nodes, {first, first + static_cast<std::ptrdiff_t>(n1)}, p[1]));
    }
    const double beta = spline(m.axes[0].nodes, rows, p[0]);
    for (std::size_t l = 0; l < m.space_modes; ++l) {
      u += m.space[l * dofs + dof] * m.temporal[(t * m.space_modes + l) * m.parameter_modes + k] * beta;
    }
  }
  return u;
}

class EitherForm : public ::testing::TestWithParam<Form> {};

TEST_P(EitherForm, IsTheSumOverItsModes) {
  const SeparatedModel model(random_contents(GetParam()));
  for (const auto& p : {std::vector{0.5, 0.5}, std::vector{0.83, 1.41}, std::vector{1.5, 0.97}}) {
    for (const std::size_t t : {0U, 3U}) {
      const FieldDerivatives all = model.evaluate(p, t);
      ASSERT_EQ(all.count, model.dof_count());
      for (std::size_t dof = 0; dof < all.count; ++dof) {
        EXPECT_NEAR(all.value[dof], by_definition(model.contents(), dof, t, p), 1e-11);
      }
      const std::vector<std::size_t> some{7, 0, 35};
      const FieldDerivatives few = model.evaluate(p, t, some);
      for (std::size_t i = 0; i < 3; ++i) EXPECT_NEAR(few.value[i], all.value[some[i]], 1e-12);
    }
  }
}

/// Central differences against gradient and Hessian, at points that no node is near.
template <class Evaluate>
void expect_derivatives(const Evaluate& evaluate) {
  const std::vector<double> p{0.81, 1.13};
  const double h = 1e-4;
  const FieldDerivatives at = evaluate(p);
  for (std::size_t a = 0; a < 2; ++a) {
    std::vector<double> left = p, right = p;
    left[a] -= h;
    right[a] += h;
    const FieldDerivatives low = evaluate(left), high = evaluate(right);
    for (std::size_t i = 0; i < at.count; ++i) {
      EXPECT_NEAR((high.value[i] - low.value[i]) / (2 * h), at.gradient[i * 2 + a], 1e-4);
      for (std::size_t b = 0; b < 2; ++b) {
        // Within one polynomial piece the second difference of a slope is exact to the order h².
        EXPECT_NEAR((high.gradient[i * 2 + b] - low.gradient[i * 2 + b]) / (2 * h),
                    at.hessian[(i * 2 + a) * 2 + b], 1e-3);
      }
    }
  }
}

TEST_P(EitherForm, DerivativesAgreeWithFiniteDifferences) {
  const SeparatedModel model(random_contents(GetParam()));
  const std::vector<std::size_t> dofs{3, 20};
  expect_derivatives([&](const std::vector<double>& p) { return model.evaluate(p, 2, dofs, 2); });
  expect_derivatives([&](const std::vector<double>& p) { return model.evaluate_output("force", p, 2); });
}

TEST_P(EitherForm, SavedAndLoadedToTheBit) {
  const TestFolder folder;
  const SeparatedModel model(random_contents(GetParam()));
  model.save(folder.file("m.h5"));
  const SeparatedModel loaded = SeparatedModel::load(folder.file("m.h5"));
  const ModelContents& a = model.contents();
  const ModelContents& b = loaded.contents();
  EXPECT_EQ(b.form, a.form);
  EXPECT_EQ(b.space, a.space);
  EXPECT_EQ(b.temporal, a.temporal);
  EXPECT_EQ(b.parameters, a.parameters);
  EXPECT_EQ(b.joint, a.joint);
  EXPECT_EQ(b.lift, a.lift);
  EXPECT_EQ(b.outputs[0].values, a.outputs[0].values);
  EXPECT_EQ(b.crack.length, a.crack.length);
  EXPECT_EQ(b.crack.modes, a.crack.modes);
  EXPECT_EQ(b.crack.coefficients, a.crack.coefficients);
  EXPECT_EQ(b.project, a.project);
  EXPECT_THAT(b.created_by, HasSubstr("knothe "));
  EXPECT_EQ(b.relative_error, 1.5e-3);
  EXPECT_EQ(b.max_error_m, 2e-7);
  EXPECT_EQ(b.mesh->cells, a.mesh->cells);
  const std::vector<double> p{0.77, 1.33};
  EXPECT_EQ(loaded.evaluate(p, 1, {}, 2).hessian, model.evaluate(p, 1, {}, 2).hessian);
  // Every data set says what it is.
  const files::Hdf5Reader file(folder.file("m.h5"));
  for (const char* name :
       {"/modes/space", "/modes/time", "/lift", "/time", "/parameters/Y0", "/outputs/force", "/dofs/points",
        "/mesh/cells", "/crack/length", "/crack/modes"}) {
    EXPECT_NE(file.labels(name).units, "") << name;
    EXPECT_NE(file.labels(name).long_name, "") << name;
  }
  EXPECT_EQ(file.text_attribute("/parameters/Y0", "basis"), "not-a-knot cubic spline");
  EXPECT_EQ(file.shape("/outputs/force"), (files::Shape{5, 6, 4}));
}

INSTANTIATE_TEST_SUITE_P(Forms, EitherForm, ::testing::Values(Form::canonical, Form::tree),
                         [](const auto& form) { return to_text(form.param); });

/// A flipped bit, a file cut off, a stretch of zeros or of nonsense.
std::string damaged(std::string content, std::mt19937_64& random) {
  const std::size_t at = random() % content.size(),
                    length = std::min<std::size_t>(1 + random() % 600, content.size() - at);
  switch (random() % 4) {
    case 0:
      content[at] = static_cast<char>(content[at] ^ (1 << random() % 8));
      break;
    case 1:
      content.resize(at);
      break;
    case 2:
      std::fill_n(content.begin() + static_cast<std::ptrdiff_t>(at), length, '\0');
      break;
    default:
      for (std::size_t i = at; i < at + length; ++i) content[i] = static_cast<char>(random());
  }
  return content;
}

void write_bytes(const std::string& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary | std::ios::trunc) << bytes;
}

int variants() {
  const char* wanted = std::getenv("KNOTHE_VARIANTS");  // 100,000 at night
  return wanted ? std::atoi(wanted) : 60;
}

TEST(ModelFile, DamagedBytesAreRefusedByName) {
  const TestFolder folder;
  const std::string path = folder.file("m.h5");
  write_model(random_contents(Form::tree), path);
  const std::string whole = files::read_text(path);
  std::mt19937_64 random(5);
  for (int i = 0; i < variants(); ++i) {
    const std::string content = damaged(whole, random);
    write_bytes(path, content);
    if (content == whole)
      EXPECT_NO_THROW((void)read_model(path));
    else
      ASSERT_THAT(message_of<DataError>([&] { (void)read_model(path); }), HasSubstr("m.h5")) << i;
  }
}

TEST(ModelFile, WithoutASealItIsReadAndNoDamageEndsTheProcess) {
  const TestFolder folder;
  const std::string path = folder.file("m.h5");
  const ModelContents model = random_contents(Form::tree);
  write_model(model, path);
  const std::string whole = files::read_text(path).substr(512);
  write_bytes(path, whole);
  EXPECT_EQ(read_model(path).joint, model.joint);
  std::mt19937_64 random(6);
  int refused = 0;
  const int count = std::min(variants() / 2, 1000);  // HDF5 goes round for ever in some: ten seconds each
  for (int i = 0; i < count; ++i) {
    write_bytes(path, damaged(whole, random));
    try {
      (void)read_model(path);
    } catch (const DataError&) {
      ++refused;
    }
  }
  EXPECT_GT(refused, count / 4);  // numbers that are wrong are not seen without a seal
  EXPECT_THAT(message_of<DataError>([&] { files::require_sound(path, [] { std::abort(); }); }),
              HasSubstr("does not survive"));
}

TEST(SeparatedModel, WrongQuestionsAreNamed) {
  const SeparatedModel model(random_contents(Form::tree));
  const std::vector<double> inside{1.0, 1.0}, outside{1.0, 1.6}, short_point{1.0};
  const auto ask = [&](const auto& question) { return message_of<UsageError>(question); };
  EXPECT_THAT(ask([&] { (void)model.evaluate(outside, 0); }),
              HasSubstr("parameter Ad = 1.6 is outside the model's box [0.5, 1.5]"));
  EXPECT_THAT(ask([&] { (void)model.evaluate(short_point, 0); }), HasSubstr("1 parameter values given"));
  EXPECT_THAT(ask([&] { (void)model.evaluate(inside, 4); }),
              HasSubstr("no time step 4: the model has steps 0 to 3"));
  const std::vector<std::size_t> dofs{36};
  EXPECT_THAT(ask([&] { (void)model.evaluate(inside, 0, dofs); }), HasSubstr("no dof 36"));
  EXPECT_THAT(ask([&] { (void)model.evaluate_output("forse", inside); }),
              HasSubstr("did you mean \"force\"?"));
}

TEST(ModelFile, ForeignOtherSchemaAndTruncatedFilesAreRefused) {
  const TestFolder folder;
  const auto load = [&](const std::string& name) {
    return message_of<DataError>([&] { (void)SeparatedModel::load(folder.file(name)); });
  };
  EXPECT_THAT(load("none.h5"),
              HasSubstr("none.h5: there is no such model: `knothe offline PROJECT.toml -o none.h5`"));
  {
    files::Hdf5Writer file(folder.file("foreign.h5"));
    file.write("/snapshots", std::vector<double>{1.0}, {1}, {});
    file.close();
  }
  EXPECT_THAT(load("foreign.h5"),
              HasSubstr("not a reduced model: attribute schema_version of / is missing (these are "
                        "snapshots: make a model of them with knothe model import)"));
  {
    files::Hdf5Writer file(folder.file("newer.h5"));
    file.integer_attribute("/", "schema_version", 99);
    file.close();
  }
  EXPECT_THAT(load("newer.h5"), HasSubstr("schema_version is 99"));
  EXPECT_THAT(load("newer.h5"), HasSubstr("use a newer knothe"));
  write_model(random_contents(Form::tree), folder.file("m.h5"));
  std::filesystem::resize_file(folder.file("m.h5"), std::filesystem::file_size(folder.file("m.h5")) / 2);
  EXPECT_THAT(load("m.h5"), HasSubstr("m.h5: the file is truncated"));
}

TEST(ModelFile, InconsistentContentsAreNamedAndNotWritten) {
  const TestFolder folder;
  ModelContents model = random_contents(Form::canonical);
  model.parameters[1].pop_back();
  EXPECT_THAT(message_of<DataError>([&] { write_model(model, folder.file("m.h5")); }),
              HasSubstr("m.h5: /modes/parameters/Ad has 17 entries, shape (3, 6) needs 18"));
  EXPECT_EQ(folder.number_of_files(), 0U);
}

}  // namespace
}  // namespace knothe::model
