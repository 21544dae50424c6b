#include "knothe/posterior/map/map_file.hpp"

#include <fmt/format.h>

#include <cstdint>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/base/version.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/hdf5.hpp"

namespace knothe::posterior {

namespace {

constexpr int k_schema_version = 1;
constexpr const char* k_kind = "transport map";
/// The functions of every map (TailedHermite).
constexpr const char *k_basis = "hermite", *k_tails = "bent";

std::string part_group(std::size_t i) {
  return fmt::format("/parts/{}", i);
}

// Writing: one overload per kind of part. A new alternative of ComposedMap::Part does not compile without.

void write_part(files::Hdf5Writer& file, const std::string& group, const AffineMap& map) {
  const std::size_t d = map.dimension();
  file.text_attribute(group, "kind", "affine");
  file.write(group + "/shift", {map.shift.data(), d}, {d}, {"1", "shift of x -> shift + rotation lower x"});
  const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> lower = map.lower;
  file.write(group + "/lower", {lower.data(), d * d}, {d, d}, {"1", "lower triangular matrix"});
  if (map.is_triangular()) return;
  const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> rotation = map.rotation;
  file.write(group + "/rotation", {rotation.data(), d * d}, {d, d}, {"1", "orthogonal matrix"});
}

void write_part(files::Hdf5Writer& file, const std::string& group, const TriangularMap& map) {
  const Parametrisation& p = map.parametrisation();
  file.text_attribute(group, "kind", "triangular");
  file.text_attribute(group, "rectifier", to_text(p.rectifier));
  file.text_attribute(group, "basis", k_basis);
  file.text_attribute(group, "tails", k_tails);
  const double radii[] = {p.radii.level, p.radii.bend, p.radii.tangent};
  file.write(group + "/radii", radii, {3}, {"1", "radii of the tails: level, bend, tangent"});
  const std::size_t count = map.coefficients().size();
  file.write(group + "/coefficients", {map.coefficients().data(), count}, {count}, {"1", "coefficients"});
  std::vector<std::int64_t> terms, factors;
  for (Index k = 0; k < map.dimension(); ++k) {
    const MapComponent& c = map.component(k);
    for (const std::int64_t set : {0, 1})
      for (const MultiIndex& index : set == 0 ? c.constant : c.monotone) {
        const std::int64_t coefficient = terms.size() / 2;
        terms.insert(terms.end(), {k, set});
        for (const auto& f : index.factors)
          factors.insert(factors.end(), {coefficient, f.variable, f.degree});
      }
  }
  file.write_integers(group + "/terms", terms, {count, 2}, {"1", "component and set of each coefficient"});
  if (!factors.empty())
    file.write_integers(group + "/factors", factors, {factors.size() / 3, 3},
                        {"1", "coefficient, variable, degree"});
}

// Reading.

[[noreturn]] void fail(const files::Hdf5Reader& file, const std::string& what) {
  throw DataError(fmt::format("{}: {}", file.path(), what));
}

/// An attribute that counts something.
Index count_attribute(const files::Hdf5Reader& file, const std::string& name, double most) {
  const double value = file.number_attribute("/", name);
  if (!(value >= 0 && value <= most && value == static_cast<Index>(value)))
    fail(file, fmt::format("attribute {} of / is {}: an integer from 0 to {} is needed", name, value, most));
  return static_cast<Index>(value);
}

std::vector<std::int64_t> read_table(const files::Hdf5Reader& file, const std::string& name,
                                     std::size_t columns) {
  const files::Shape shape = file.shape(name);
  if (shape.size() != 2 || shape[1] != columns)
    fail(file, fmt::format("data set {} must have 2 dimensions, the second of size {}", name, columns));
  return file.read_integers(name);
}

AffineMap read_affine(const files::Hdf5Reader& file, const std::string& group, Index d) {
  const std::size_t size = d;
  const std::vector<double> shift = file.read(group + "/shift", files::Shape{size});
  const std::vector<double> lower = file.read(group + "/lower", files::Shape{size, size});
  AffineMap map = AffineMap::identity(d);
  for (Index i = 0; i < d; ++i) {
    map.shift[i] = shift[i];
    for (Index j = 0; j < d; ++j) {
      map.lower(i, j) = lower[i * d + j];
      if (j > i && map.lower(i, j) != 0)
        fail(file, fmt::format("data set {}/lower[{},{}] is {}: it must be 0 above the diagonal", group, i, j,
                               map.lower(i, j)));
    }
    if (!(map.lower(i, i) > 0))
      fail(file, fmt::format("data set {}/lower[{},{}] is {}: the diagonal must be positive", group, i, i,
                             map.lower(i, i)));
  }
  const std::string name = group + "/rotation";
  if (!file.has(name)) return map;
  const std::vector<double> rotation = file.read(name, files::Shape{size, size});
  map.rotation.resize(d, d);
  for (Index i = 0; i < d; ++i)
    for (Index j = 0; j < d; ++j) map.rotation(i, j) = rotation[i * d + j];
  const Eigen::MatrixXd square = map.rotation.transpose() * map.rotation;
  if (!(square - Eigen::MatrixXd::Identity(d, d)).isZero(1e-10))
    fail(file, fmt::format("data set {} is not orthogonal", name));
  return map;
}

/// The index of every coefficient, in order.
std::vector<MultiIndex> read_indices(const files::Hdf5Reader& file, const std::string& group,
                                     std::size_t count) {
  std::vector<MultiIndex> indices(count);
  const std::string name = group + "/factors";
  if (!file.has(name)) return indices;
  const std::vector<std::int64_t> factors = read_table(file, name, 3);
  for (std::size_t f = 0; f < factors.size() / 3; ++f) {
    const std::int64_t coefficient = factors[3 * f], variable = factors[3 * f + 1],
                       degree = factors[3 * f + 2];
    if (coefficient < 0 || coefficient >= std::ssize(indices) || variable < 0 || variable > 1'000'000 ||
        degree < 1 || degree > k_max_order)
      fail(file,
           fmt::format("data set {}[{}] is ({}, {}, {}): no coefficient, variable and degree of this map",
                       name, f, coefficient, variable, degree));
    indices[coefficient].factors.push_back({static_cast<int>(variable), static_cast<int>(degree)});
  }
  return indices;
}

TriangularMap read_triangular(const files::Hdf5Reader& file, const std::string& group, Index d) {
  const std::string terms_name = group + "/terms";
  const std::vector<std::int64_t> terms = read_table(file, terms_name, 2);
  const std::size_t count = terms.size() / 2;
  const std::vector<double> coefficients = file.read(group + "/coefficients", files::Shape{count});
  const std::vector<double> radii = file.read(group + "/radii", files::Shape{3});
  std::vector<MultiIndex> indices = read_indices(file, group, count);
  MapSpecification specification;
  specification.components.resize(d);
  std::int64_t last_component = 0, last_set = 0;
  for (std::size_t m = 0; m < count; ++m) {
    const std::int64_t component = terms[2 * m], set = terms[2 * m + 1];
    const bool in_order = component > last_component || (component == last_component && set >= last_set);
    if (component < 0 || component >= d || set < 0 || set > 1 || !in_order)
      fail(file,
           fmt::format("data set {}[{}] is ({}, {}): components from 0 to {}, each with set 0, then set 1, "
                       "are needed in order",
                       terms_name, m, component, set, d - 1));
    auto& c = specification.components[component];
    (set == 0 ? c.constant : c.monotone).push_back(std::move(indices[m]));
    last_component = component, last_set = set;
  }
  const std::string basis = file.text_attribute(group, "basis"), tails = file.text_attribute(group, "tails");
  if (basis != k_basis || tails != k_tails)
    fail(file, fmt::format("{} is made of \"{}\" functions with \"{}\" tails: \"{}\" with \"{}\" are needed",
                           group, basis, tails, k_basis, k_tails));
  try {
    specification.parametrisation = {rectifier_from(file.text_attribute(group, "rectifier")),
                                     {radii[0], radii[1], radii[2]}};
    TriangularMap map(std::move(specification));
    map.set_coefficients(Eigen::Map<const Eigen::VectorXd>(coefficients.data(), std::ssize(coefficients)));
    return map;
  } catch (const UsageError& error) {
    fail(file, fmt::format("{}: {}", group, error.what()));
  }
}

ComposedMap::Part read_part(const files::Hdf5Reader& file, const std::string& group, Index d) {
  const std::string kind = file.text_attribute(group, "kind");
  if (kind == "affine") return read_affine(file, group, d);
  if (kind == "triangular") return read_triangular(file, group, d);
  fail(file,
       fmt::format("attribute kind of {} is \"{}\": \"affine\" or \"triangular\" is needed", group, kind));
}

/// Before anything else: is it a map, and one that this program understands?
void check_schema(const files::Hdf5Reader& file) {
  if (!file.has_attribute("/", "kind") || !file.has_attribute("/", "schema_version") ||
      file.text_attribute("/", "kind") != k_kind)
    fail(file, fmt::format("not a transport map (attribute kind of / should be \"{}\")", k_kind));
  const double version = file.number_attribute("/", "schema_version");
  if (version != k_schema_version)
    fail(file, fmt::format("schema_version is {}, this is {} and reads {}: {}", version, k_created_by,
                           k_schema_version,
                           version > k_schema_version ? "use a newer knothe" : "make the map again"));
}

}  // namespace

void save_map(const std::string& path, const ComposedMap& map, const MapMetadata& metadata) {
  if (metadata.contains("")) throw UsageError(fmt::format("{}: a metadata text has no name", path));
  files::write_atomically(path, [&](const std::string& temporary) {
    files::Hdf5Writer file(temporary);
    file.integer_attribute("/", "schema_version", k_schema_version);
    file.text_attribute("/", "created_by", k_created_by);
    file.text_attribute("/", "kind", k_kind);
    file.integer_attribute("/", "dimension", map.dimension());
    file.integer_attribute("/", "parts", std::ssize(map.parts()));
    file.make_group("/metadata");
    std::vector<std::string> names;
    for (const auto& [name, text] : metadata) {
      names.push_back(name);
      file.text_attribute("/metadata", "text:" + name, text);
    }
    if (!names.empty()) file.texts_attribute("/metadata", "names", names);
    for (Index i = 0; i < std::ssize(map.parts()); ++i) {
      file.make_group(part_group(i));
      std::visit([&](const auto& part) { write_part(file, part_group(i), part); }, map.parts()[i]);
    }
    file.close();
  });
}

StoredMap load_map(const std::string& path) {
  const files::Hdf5Reader file(path);
  check_schema(file);
  const Index d = count_attribute(file, "dimension", 1e6), parts = count_attribute(file, "parts", 1e6);
  StoredMap stored{ComposedMap(d), {}, file.text_attribute("/", "created_by")};
  if (file.has("/metadata") && file.has_attribute("/metadata", "names"))
    for (const std::string& name : file.texts_attribute("/metadata", "names"))
      stored.metadata[name] = file.text_attribute("/metadata", "text:" + name);
  for (Index i = 0; i < parts; ++i) stored.map.append(read_part(file, part_group(i), d));
  return stored;
}

}  // namespace knothe::posterior
