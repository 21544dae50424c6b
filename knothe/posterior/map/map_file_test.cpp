/// @file Maps come back bit by bit; files that are not maps, or no longer, are refused by name.
#include "knothe/posterior/map/map_file.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <random>

#include "knothe/base/error.hpp"
#include "knothe/base/version.hpp"
#include "knothe/files/hdf5.hpp"
#include "knothe/files/testing/test_folder.hpp"

namespace knothe::posterior {
namespace {

using files::message_of;
using files::TestFolder;

TriangularMap random_map(MapSpecification specification, unsigned seed) {
  TriangularMap map(std::move(specification));
  std::mt19937 generator(seed);
  std::normal_distribution<double> normal(0, 0.1);
  Eigen::VectorXd a = map.coefficients();
  for (Eigen::Index i = 0; i < a.size(); ++i) a[i] += normal(generator);
  map.set_coefficients(a);
  return map;
}

AffineMap some_affine_map() {
  AffineMap map = AffineMap::identity(2);
  map.shift << 0.1, -1.0 / 3;
  map.lower << 0.7, 0, -1.1, 2.3;
  map.rotation.resize(2, 2);
  map.rotation << 0.6, -0.8, 0.8, 0.6;
  return map;
}

TEST(MapFile, RoundTripIsBitIdenticalForEveryRectifier) {
  const TestFolder folder;
  Eigen::MatrixXd x(3, 2);
  x << 0.3, -1.2, 4.1, 0.1, -6, 2.6;
  for (auto rectifier : {Rectifier::square, Rectifier::softplus, Rectifier::exponential}) {
    const Parametrisation p{rectifier, {2.0, 0.25, 3.0}};
    ComposedMap map(2);
    map.append(some_affine_map());
    map.append(random_map(total_order_map(2, 3, p), 1));
    map.append(random_map(sparse_map(total_order_map(2, 4, p), {{}, {}}), 2));
    save_map(folder.file("map.h5"), map, {{"target", "beam, step 17"}, {"note", "ĥ ∘ τ"}});
    const StoredMap stored = load_map(folder.file("map.h5"));
    EXPECT_EQ(stored.metadata, (MapMetadata{{"target", "beam, step 17"}, {"note", "ĥ ∘ τ"}}));
    EXPECT_EQ(stored.created_by, k_created_by);
    ASSERT_EQ(stored.map.parts().size(), 3u);
    const auto& affine = std::get<AffineMap>(stored.map.parts()[0]);
    EXPECT_EQ(affine.shift, some_affine_map().shift);
    EXPECT_EQ(affine.lower, some_affine_map().lower);
    EXPECT_EQ(affine.rotation, some_affine_map().rotation);
    for (std::size_t i : {1u, 2u}) {
      const auto& before = std::get<TriangularMap>(map.parts()[i]);
      const auto& after = std::get<TriangularMap>(stored.map.parts()[i]);
      EXPECT_EQ(after.coefficients(), before.coefficients());
      EXPECT_TRUE(after.parametrisation() == before.parametrisation());
      for (Eigen::Index k = 0; k < 2; ++k) {
        EXPECT_EQ(after.component(k).constant, before.component(k).constant);
        EXPECT_EQ(after.component(k).monotone, before.component(k).monotone);
      }
    }
    EXPECT_EQ(stored.map.evaluate(x), map.evaluate(x));
  }
  EXPECT_EQ(folder.number_of_files(), 1u);
}

TEST(MapFile, IdentityAndOneDimension) {
  const TestFolder folder;
  save_map(folder.file("identity.h5"), ComposedMap(4));
  EXPECT_EQ(load_map(folder.file("identity.h5")).map.dimension(), 4);
  ComposedMap map(1);
  map.append(TriangularMap(1, 1));  // no factors at all
  save_map(folder.file("one.h5"), map);
  EXPECT_EQ(load_map(folder.file("one.h5")).map.parts().size(), 1u);
  EXPECT_EQ(message_of<UsageError>([&] {
              save_map(folder.file("x.h5"), map, {{"", "text"}});
            }),
            folder.file("x.h5") + ": a metadata text has no name");
}

/// A file like one of ours with an affine part of two variables, of which `change` may spoil something.
struct Recipe {
  double schema = 1, dimension = 2, parts = 1;
  std::string kind = "transport map", part_kind = "affine";
  std::vector<double> shift{0, 0}, lower{1, 0, 0, 1};
};

std::string message_for(const TestFolder& folder, const Recipe& recipe) {
  const std::string path = folder.file("spoiled.h5");
  {
    files::Hdf5Writer file(path);
    file.number_attribute("/", "schema_version", recipe.schema);
    file.text_attribute("/", "created_by", "a test");
    file.text_attribute("/", "kind", recipe.kind);
    file.number_attribute("/", "dimension", recipe.dimension);
    file.number_attribute("/", "parts", recipe.parts);
    file.make_group("/parts/0");
    file.text_attribute("/parts/0", "kind", recipe.part_kind);
    if (!recipe.shift.empty()) file.write("/parts/0/shift", recipe.shift, {recipe.shift.size()}, {"1", ""});
    file.write("/parts/0/lower", recipe.lower, {2, 2}, {"1", ""});
    file.close();
  }
  const std::string message = message_of<DataError>([&] { (void)load_map(path); });
  EXPECT_EQ(message.rfind(path, 0), message.empty() ? std::string::npos : 0) << message;
  return message.substr(std::min(message.size(), path.size()));
}

TEST(MapFile, SaysWhatIsWrong) {
  const TestFolder folder;
  EXPECT_EQ(message_for(folder, {}), "");
  Recipe r;
  r.schema = 2;
  EXPECT_EQ(message_for(folder, r), std::string(": schema_version is 2, this is ") + k_created_by +
                                        " and reads 1: use a newer knothe");
  r = {};
  r.kind = "reduced model";
  EXPECT_EQ(message_for(folder, r),
            ": not a transport map (attribute kind of / should be \"transport map\")");
  r = {};
  r.part_kind = "spiral";
  EXPECT_EQ(message_for(folder, r),
            ": attribute kind of /parts/0 is \"spiral\": \"affine\" or \"triangular\" is needed");
  r = {};
  r.dimension = 2.5;
  EXPECT_EQ(message_for(folder, r),
            ": attribute dimension of / is 2.5: an integer from 0 to 1000000 is needed");
  r = {};
  r.lower = {1, 0, 3, -1};
  EXPECT_EQ(message_for(folder, r), ": data set /parts/0/lower[1,1] is -1: the diagonal must be positive");
  r.lower = {1, 0.5, 3, 1};
  EXPECT_EQ(message_for(folder, r), ": data set /parts/0/lower[0,1] is 0.5: it must be 0 above the diagonal");
  r = {};
  r.shift = {0, std::numeric_limits<double>::infinity()};
  EXPECT_EQ(message_for(folder, r), ": shift[1] is infinite: only finite numbers are allowed here");
  r.shift = {0, 0, 0};
  EXPECT_NE(message_for(folder, r).find("/parts/0/shift"), std::string::npos);
  r.shift = {};
  EXPECT_NE(message_for(folder, r).find("/parts/0/shift"), std::string::npos);
  r = {};
  r.parts = 2;
  EXPECT_NE(message_for(folder, r).find("/parts/1"), std::string::npos);
}

TEST(MapFile, TriangularPartsAreChecked) {
  const TestFolder folder;
  const std::string path = folder.file("map.h5");
  const auto message = [&](std::vector<std::int64_t> terms, std::vector<std::int64_t> factors,
                           const std::string& rectifier = "softplus", double level = 2.5,
                           const std::string& tails = "bent") {
    {
      files::Hdf5Writer file(path);
      file.integer_attribute("/", "schema_version", 1);
      file.text_attribute("/", "created_by", "a test");
      file.text_attribute("/", "kind", "transport map");
      file.integer_attribute("/", "dimension", 1);
      file.integer_attribute("/", "parts", 1);
      file.make_group("/parts/0");
      file.text_attribute("/parts/0", "kind", "triangular");
      file.text_attribute("/parts/0", "rectifier", rectifier);
      file.text_attribute("/parts/0", "basis", "hermite");
      file.text_attribute("/parts/0", "tails", tails);
      const double radii[] = {level, 0.5, 3.5};
      file.write("/parts/0/radii", radii, {3}, {"1", ""});
      const std::vector<double> coefficients(terms.size() / 2, 0.5);
      file.write("/parts/0/coefficients", coefficients, {coefficients.size()}, {"1", ""});
      file.write_integers("/parts/0/terms", terms, {terms.size() / 2, 2}, {"1", ""});
      file.write_integers("/parts/0/factors", factors, {factors.size() / 3, 3}, {"1", ""});
      file.close();
    }
    const std::string text = message_of<DataError>([&] { (void)load_map(path); });
    return text.substr(std::min(text.size(), path.size()));
  };
  EXPECT_EQ(message({0, 0, 0, 1, 0, 1}, {2, 0, 3}), "");
  EXPECT_EQ(
      message({0, 0, 0, 1, 1, 1}, {2, 0, 3}),
      ": data set /parts/0/terms[2] is (1, 1): components from 0 to 0, each with set 0, then set 1, are "
      "needed in order");
  EXPECT_EQ(message({0, 0, 0, 1, 0, 1}, {3, 0, 3}),
            ": data set /parts/0/factors[0] is (3, 0, 3): no coefficient, variable and degree of this map");
  EXPECT_EQ(
      message({0, 0, 0, 1, 0, 1}, {2, 1, 3}),
      ": /parts/0: triangular map, Φ_e of component 0: an index contains variable 1; only those below 1 "
      "may be there");
  EXPECT_EQ(
      message({0, 0, 0, 1, 0, 1}, {2, 0, 3}, "cube"),
      ": /parts/0: unknown rectifier \"cube\"; the choices are \"square\", \"softplus\", \"exponential\"");
  EXPECT_EQ(
      message({0, 0, 0, 1, 0, 1}, {2, 0, 3}, "square", 2.5, "tangent"),
      ": /parts/0 is made of \"hermite\" functions with \"tangent\" tails: \"hermite\" with \"bent\" are "
      "needed");
  EXPECT_EQ(message({0, 0, 0, 1, 0, 1}, {2, 0, 3}, "square", -1),
            ": /parts/0: triangular map: the radii of the tails must be positive (and below 1e6)");
}

TEST(MapFile, TruncatedAndDamagedFiles) {
  const TestFolder folder;
  const std::string path = folder.file("map.h5"), cut = folder.file("cut.h5");
  ComposedMap map(2);
  map.append(random_map(total_order_map(2, 3), 1));
  save_map(path, map);
  const auto size = std::filesystem::file_size(path);
  for (const double fraction : {0.0, 0.1, 0.5, 0.9}) {
    std::filesystem::copy_file(path, cut, std::filesystem::copy_options::overwrite_existing);
    std::filesystem::resize_file(cut, static_cast<std::uintmax_t>(fraction * static_cast<double>(size)));
    const std::string message = message_of<DataError>([&] { (void)load_map(cut); });
    EXPECT_NE(message.find(cut), std::string::npos) << fraction << " " << message;
  }
  EXPECT_NE(message_of<DataError>([&] { (void)load_map(folder.file("missing.h5")); }).find("missing.h5"),
            std::string::npos);
  // Bytes overwritten anywhere: a message, or a map, but nothing worse.
  std::mt19937 generator(5);
  for (int k = 0; k < 60; ++k) {
    std::filesystem::copy_file(path, cut, std::filesystem::copy_options::overwrite_existing);
    {
      std::fstream file(cut, std::ios::in | std::ios::out | std::ios::binary);
      file.seekp(static_cast<std::streamoff>(generator() % size));
      for (int i = 0; i < 16; ++i) file.put(static_cast<char>(generator() % 256));
    }
    try {
      EXPECT_EQ(load_map(cut).map.dimension(), 2);
    } catch (const DataError& error) {
      EXPECT_NE(std::string(error.what()).find(cut), std::string::npos) << error.what();
    }
  }
}

TEST(ComposedMap, DescribesItsPartsInTheOrderInWhichTheyAct) {
  ComposedMap map(2);
  EXPECT_EQ(map.describe(), "identity of 2 variables\n");
  map.append(some_affine_map());
  map.append(TriangularMap(2, 1));
  EXPECT_EQ(map.describe(),
            "map of 2 variables, 2 parts, the first to act first\n"
            "part 1: triangular of order 1, 5 coefficients\n"
            "component 1: squared Hermite polynomials, linear tails, 1 + 1 terms of degree up to 0; largest: "
            "0 (1); inside "
            "the integral: 1 (1)\n"
            "component 2: squared Hermite polynomials, linear tails, 2 + 1 terms of degree up to 1; largest: "
            "0 (1); inside "
            "the integral: 1 (1)\n"
            "part 2: affine, rotated: shift from -0.3333 to 0.1, diagonal from 0.7 to 2.3, log det 0.4762\n");
}

}  // namespace
}  // namespace knothe::posterior
