#include <fmt/format.h>
#include <sys/stat.h>

#include <algorithm>
#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/base/text.hpp"
#include "knothe/files/hdf5_handle.hpp"

namespace knothe::files {

struct Hdf5Reader::Implementation {
  std::string path;
  Hdf5Handle file;

  [[noreturn]] void fail(const std::string& what) const {
    throw DataError(fmt::format("{}: {}", path, what));
  }
  [[nodiscard]] bool exists(const std::string& name) const;
  void require_own(hid_t object, const std::string& name) const;
  [[nodiscard]] Hdf5Handle object(const std::string& name) const;
  [[nodiscard]] Hdf5Handle data_set(const std::string& name) const;
  [[nodiscard]] Hdf5Handle attribute(const std::string& name, const std::string& attribute) const;
  [[nodiscard]] Shape shape_of(hid_t space, const std::string& name) const;
  void require_finite(const std::vector<double>& values, const std::string& name, const Shape& shape,
                      const Shape& offset) const;
  [[nodiscard]] std::vector<std::string> fixed_texts(hid_t attribute, hid_t type, std::size_t n) const;
  [[nodiscard]] std::vector<std::string> variable_texts(hid_t attribute, hid_t type, hid_t space,
                                                        std::size_t n) const;
};

namespace {

/// Memory for `n` entries of something the file claims to hold.
template <class T>
std::vector<T> allocate(std::size_t n, const std::string& path, const std::string& name) {
  try {
    return std::vector<T>(n);
  } catch (const std::exception&) {
    throw DataError(fmt::format("{}: data set {} has {} entries: they do not fit in memory", path, name, n));
  }
}

}  // namespace

namespace {

constexpr const char* k_elsewhere =
    "{} is in another file ({}): what a file says must be in it, or it has no identity; copy the content in "
    "(h5copy, h5repack)";

/// The file that an object is in.
std::string file_of(hid_t object) {
  std::string name(std::max<ssize_t>(H5Fget_name(object, nullptr, 0), 0), '\0');
  (void)H5Fget_name(object, name.data(), name.size() + 1);
  return name;
}

}  // namespace

/// Whether every part of an absolute name exists; H5Lexists fails, rather than answers, on a missing parent.
/// A link to another file is not followed.
bool Hdf5Reader::Implementation::exists(const std::string& name) const {
  if (name == "/" || name.empty()) return true;
  for (std::size_t end = name.find('/', 1);; end = name.find('/', end + 1)) {
    const std::string part = name.substr(0, end);
    if (H5Lexists(file.get(), part.c_str(), H5P_DEFAULT) <= 0) return false;
    H5L_info_t link;
    if (H5Lget_info(file.get(), part.c_str(), &link, H5P_DEFAULT) < 0 || link.type == H5L_TYPE_ERROR)
      return false;
    if (link.type != H5L_TYPE_HARD && link.type != H5L_TYPE_SOFT)
      fail(fmt::format(k_elsewhere, part, "an external link"));
    if (end == std::string::npos) break;
  }
  return H5Oexists_by_name(file.get(), name.c_str(), H5P_DEFAULT) > 0;
}

/// A soft link may lead to an external one, and a data set may have its values elsewhere.
void Hdf5Reader::Implementation::require_own(hid_t object, const std::string& name) const {
  if (const std::string other = file_of(object); other != file_of(file.get()))
    fail(fmt::format(k_elsewhere, name, other));
  if (H5Iget_type(object) != H5I_DATASET) return;
  const Hdf5Handle made(H5Dget_create_plist(object), H5Pclose);
  if (H5Pget_external_count(made.get()) > 0) fail(fmt::format(k_elsewhere, name, "external storage"));
  if (H5Pget_layout(made.get()) == H5D_VIRTUAL) fail(fmt::format(k_elsewhere, name, "a virtual data set"));
}

Hdf5Handle Hdf5Reader::Implementation::object(const std::string& name) const {
  if (!exists(name)) fail(fmt::format("there is no {} in the file", name));
  Hdf5Handle result(H5Oopen(file.get(), name.c_str(), H5P_DEFAULT), H5Oclose);
  if (!result) fail(fmt::format("could not open {}: {}", name, hdf5_cause()));
  require_own(result.get(), name);
  return result;
}

Hdf5Handle Hdf5Reader::Implementation::data_set(const std::string& name) const {
  if (!exists(name)) fail(fmt::format("data set {} is missing", name));
  const Hdf5Handle any = object(name);
  if (H5Iget_type(any.get()) != H5I_DATASET) fail(fmt::format("{} is not a data set", name));
  Hdf5Handle result(H5Dopen2(file.get(), name.c_str(), H5P_DEFAULT), H5Dclose);
  if (!result) fail(fmt::format("could not open data set {}: {}", name, hdf5_cause()));
  return result;
}

Hdf5Handle Hdf5Reader::Implementation::attribute(const std::string& name,
                                                 const std::string& attribute) const {
  const Hdf5Handle owner = object(name);
  if (H5Aexists(owner.get(), attribute.c_str()) <= 0) {
    fail(fmt::format("attribute {} of {} is missing", attribute, name));
  }
  Hdf5Handle result(H5Aopen(owner.get(), attribute.c_str(), H5P_DEFAULT), H5Aclose);
  if (!result) fail(fmt::format("could not open attribute {} of {}: {}", attribute, name, hdf5_cause()));
  return result;
}

Shape Hdf5Reader::Implementation::shape_of(hid_t space, const std::string& name) const {
  const int rank = H5Sget_simple_extent_ndims(space);
  if (rank < 0) fail(fmt::format("could not read the shape of {}: {}", name, hdf5_cause()));
  std::vector<hsize_t> extents(rank);
  if (H5Sget_simple_extent_dims(space, extents.data(), nullptr) < 0) {
    fail(fmt::format("could not read the shape of {}: {}", name, hdf5_cause()));
  }
  double total = 8.0;
  for (const hsize_t extent : extents) total *= extent;
  if (total > 1e15) fail(fmt::format("data set {} claims {:.3g} bytes: the file is damaged", name, total));
  return {extents.begin(), extents.end()};
}

void Hdf5Reader::Implementation::require_finite(const std::vector<double>& values, const std::string& name,
                                                const Shape& shape, const Shape& offset) const {
  const auto bad = std::find_if(values.begin(), values.end(), [](double v) { return !std::isfinite(v); });
  if (bad == values.end()) return;
  const std::string index = index_text(bad - values.begin(), shape, offset);
  fail(fmt::format("{}{} is {}: only finite numbers are allowed here", name.substr(name.rfind('/') + 1),
                   index, std::isnan(*bad) ? "NaN" : "infinite"));
}

Hdf5Reader::Hdf5Reader(std::string path) : implementation_(std::make_unique<Implementation>()) {
  prepare_hdf5();
  implementation_->path = std::move(path);
  const std::string& name = implementation_->path;
  struct stat status {};
  if (::stat(name.c_str(), &status) != 0)
    throw DataError(system_error("could not open the file", name).what());
  if (!S_ISREG(status.st_mode))
    throw DataError(fmt::format("{}: is {}, an HDF5 file is needed", name,
                                S_ISDIR(status.st_mode) ? "a folder" : "a pipe or device"));
  if (H5Fis_hdf5(name.c_str()) == 0) {
    throw DataError(fmt::format("{}: not an HDF5 file{}", name, status.st_size == 0 ? " (it is empty)" : ""));
  }
  implementation_->file = Hdf5Handle(H5Fopen(name.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT), H5Fclose);
  if (!implementation_->file) {
    const std::string cause = hdf5_cause();
    const bool truncated = cause.find("truncated") != std::string::npos;
    throw DataError(fmt::format(
        "{}: {} ({})", name,
        truncated ? "the file is truncated: copy or make it again" : "could not open the file", cause));
  }
}

Hdf5Reader::~Hdf5Reader() = default;
Hdf5Reader::Hdf5Reader(Hdf5Reader&&) noexcept = default;
Hdf5Reader& Hdf5Reader::operator=(Hdf5Reader&&) noexcept = default;

const std::string& Hdf5Reader::path() const {
  return implementation_->path;
}

bool Hdf5Reader::has(const std::string& name) const {
  return implementation_->exists(name);
}

std::vector<std::string> Hdf5Reader::members(const std::string& group) const {
  const Hdf5Handle owner = implementation_->object(group);
  if (H5Iget_type(owner.get()) != H5I_GROUP) implementation_->fail(fmt::format("{} is not a group", group));
  std::vector<std::string> names;
  const auto collect = [](hid_t, const char* name, const H5L_info_t*, void* data) -> herr_t {
    static_cast<std::vector<std::string>*>(data)->emplace_back(name);
    return 0;
  };
  if (H5Literate(owner.get(), H5_INDEX_NAME, H5_ITER_INC, nullptr, collect, &names) < 0) {
    implementation_->fail(fmt::format("could not list {}: {}", group, hdf5_cause()));
  }
  std::sort(names.begin(), names.end());
  return names;
}

Shape Hdf5Reader::shape(const std::string& name) const {
  const Hdf5Handle set = implementation_->data_set(name);
  const Hdf5Handle space(H5Dget_space(set.get()), H5Sclose);
  return implementation_->shape_of(space.get(), name);
}

namespace {

/// Missing values and packed numbers as the CF conventions have them (netCDF4, xarray): `_FillValue` and
/// `missing_value` become NaN, `scale_factor` and `add_offset` are applied.
void unpack(const Hdf5Reader& file, const std::string& name, std::vector<double>& values) {
  for (const char* attribute : {"_FillValue", "missing_value"}) {
    if (!file.has_attribute(name, attribute)) continue;
    const double missing = file.number_attribute(name, attribute);
    const float in_single = missing;
    for (double& value : values) {
      const float single = value;
      if (value == missing || single == in_single) value = std::numeric_limits<double>::quiet_NaN();
    }
  }
  const auto number = [&](const char* attribute, double otherwise) {
    return file.has_attribute(name, attribute) ? file.number_attribute(name, attribute) : otherwise;
  };
  const double factor = number("scale_factor", 1), offset = number("add_offset", 0);
  if (factor == 1 && offset == 0) return;
  for (double& value : values) value = factor * value + offset;
}

}  // namespace

std::vector<double> Hdf5Reader::read(const std::string& name, bool allow_nan) const {
  const Shape all = shape(name);
  const Hdf5Handle set = implementation_->data_set(name);
  const Hdf5Handle type(H5Dget_type(set.get()), H5Tclose);
  const H5T_class_t kind = H5Tget_class(type.get());
  if (kind != H5T_FLOAT && kind != H5T_INTEGER) {
    implementation_->fail(fmt::format("data set {} does not hold numbers", name));
  }
  auto values = allocate<double>(number_of_entries(all), path(), name);
  if (!values.empty() &&
      H5Dread(set.get(), H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()) < 0) {
    implementation_->fail(fmt::format("could not read data set {}: {}", name, hdf5_cause()));
  }
  unpack(*this, name, values);
  if (!allow_nan) implementation_->require_finite(values, name, all, {});
  return values;
}

std::vector<double> Hdf5Reader::read(const std::string& name, const Shape& expected, bool allow_nan) const {
  if (const Shape found = shape(name); found != expected) {
    implementation_->fail(
        fmt::format("data set {} has shape {}, expected {}", name, shape_text(found), shape_text(expected)));
  }
  return read(name, allow_nan);
}

std::vector<double> Hdf5Reader::read_slab(const std::string& name, const Shape& offset,
                                          const Shape& count) const {
  const Shape all = shape(name);
  bool inside = offset.size() == all.size() && count.size() == all.size();
  for (std::size_t k = 0; inside && k < all.size(); ++k) inside = offset[k] + count[k] <= all[k];
  if (!inside) {
    implementation_->fail(fmt::format("data set {} has shape {}: it has no slab of {} entries from {}", name,
                                      shape_text(all), shape_text(count), shape_text(offset)));
  }
  const Hdf5Handle set = implementation_->data_set(name);
  const std::vector<hsize_t> start(offset.begin(), offset.end());
  const std::vector<hsize_t> extent(count.begin(), count.end());
  const Hdf5Handle space(H5Dget_space(set.get()), H5Sclose);
  const Hdf5Handle memory(H5Screate_simple(extent.size(), extent.data(), nullptr), H5Sclose);
  auto values = allocate<double>(number_of_entries(count), path(), name);
  if (values.empty()) return values;
  if (!space || !memory ||
      H5Sselect_hyperslab(space.get(), H5S_SELECT_SET, start.data(), nullptr, extent.data(), nullptr) < 0 ||
      H5Dread(set.get(), H5T_NATIVE_DOUBLE, memory.get(), space.get(), H5P_DEFAULT, values.data()) < 0) {
    implementation_->fail(fmt::format("could not read data set {}: {}", name, hdf5_cause()));
  }
  unpack(*this, name, values);
  implementation_->require_finite(values, name, count, offset);
  return values;
}

std::vector<std::int64_t> Hdf5Reader::read_integers(const std::string& name) const {
  const Hdf5Handle set = implementation_->data_set(name);
  const Hdf5Handle type(H5Dget_type(set.get()), H5Tclose);
  if (H5Tget_class(type.get()) != H5T_INTEGER) {
    implementation_->fail(fmt::format("data set {} does not hold integers", name));
  }
  auto values = allocate<std::int64_t>(number_of_entries(shape(name)), path(), name);
  if (!values.empty() &&
      H5Dread(set.get(), H5T_NATIVE_INT64, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()) < 0) {
    implementation_->fail(fmt::format("could not read data set {}: {}", name, hdf5_cause()));
  }
  return values;
}

bool Hdf5Reader::has_attribute(const std::string& name, const std::string& attribute) const {
  const Hdf5Handle owner = implementation_->object(name);
  return H5Aexists(owner.get(), attribute.c_str()) > 0;
}

std::string Hdf5Reader::text_attribute(const std::string& name, const std::string& attribute) const {
  const auto all = texts_attribute(name, attribute);
  if (all.size() != 1) {
    implementation_->fail(
        fmt::format("attribute {} of {} must be one text, not {}", attribute, name, all.size()));
  }
  return all.front();
}

std::vector<std::string> Hdf5Reader::texts_attribute(const std::string& name,
                                                     const std::string& attribute) const {
  const Hdf5Handle handle = implementation_->attribute(name, attribute);
  const Hdf5Handle type(H5Aget_type(handle.get()), H5Tclose);
  const Hdf5Handle space(H5Aget_space(handle.get()), H5Sclose);
  if (H5Tget_class(type.get()) != H5T_STRING) {
    implementation_->fail(fmt::format("attribute {} of {} must be text", attribute, name));
  }
  const std::size_t n = number_of_entries(implementation_->shape_of(space.get(), attribute));
  if (H5Sget_simple_extent_type(space.get()) == H5S_NULL || n == 0) return {};
  return H5Tis_variable_str(type.get()) > 0
             ? implementation_->variable_texts(handle.get(), type.get(), space.get(), n)
             : implementation_->fixed_texts(handle.get(), type.get(), n);
}

std::vector<std::string> Hdf5Reader::Implementation::fixed_texts(hid_t attribute, hid_t type,
                                                                 std::size_t n) const {
  // One byte more than on disk, so that the terminating zero always has room.
  const std::size_t size = H5Tget_size(type) + 1;
  const Hdf5Handle memory(H5Tcopy(H5T_C_S1), H5Tclose);
  std::vector<char> buffer(n * size);
  if (H5Tset_size(memory.get(), size) < 0 || H5Tset_cset(memory.get(), H5Tget_cset(type)) < 0 ||
      H5Aread(attribute, memory.get(), buffer.data()) < 0) {
    fail(fmt::format("could not read an attribute: {}", hdf5_cause()));
  }
  std::vector<std::string> texts;
  for (std::size_t i = 0; i < n; ++i) {
    std::string text(buffer.data() + i * size);
    if (H5Tget_strpad(type) == H5T_STR_SPACEPAD) text.erase(text.find_last_not_of(' ') + 1);
    texts.push_back(std::move(text));
  }
  return texts;
}

std::vector<std::string> Hdf5Reader::Implementation::variable_texts(hid_t attribute, hid_t type, hid_t space,
                                                                    std::size_t n) const {
  const Hdf5Handle memory(H5Tcopy(H5T_C_S1), H5Tclose);
  std::vector<char*> pointers(n, nullptr);
  if (H5Tset_size(memory.get(), H5T_VARIABLE) < 0 || H5Tset_cset(memory.get(), H5Tget_cset(type)) < 0 ||
      H5Aread(attribute, memory.get(), pointers.data()) < 0) {
    fail(fmt::format("could not read an attribute: {}", hdf5_cause()));
  }
  std::vector<std::string> texts;
  for (const char* text : pointers) texts.emplace_back(text == nullptr ? "" : text);
  H5Dvlen_reclaim(memory.get(), space, H5P_DEFAULT, pointers.data());
  return texts;
}

double Hdf5Reader::number_attribute(const std::string& name, const std::string& attribute) const {
  const Hdf5Handle handle = implementation_->attribute(name, attribute);
  const Hdf5Handle type(H5Aget_type(handle.get()), H5Tclose);
  const Hdf5Handle space(H5Aget_space(handle.get()), H5Sclose);
  const H5T_class_t kind = H5Tget_class(type.get());
  if ((kind != H5T_FLOAT && kind != H5T_INTEGER) || H5Sget_simple_extent_npoints(space.get()) != 1) {
    implementation_->fail(fmt::format("attribute {} of {} must be one number", attribute, name));
  }
  double value = 0.0;
  if (H5Aread(handle.get(), H5T_NATIVE_DOUBLE, &value) < 0) {
    implementation_->fail(
        fmt::format("could not read attribute {} of {}: {}", attribute, name, hdf5_cause()));
  }
  return value;
}

Labels Hdf5Reader::labels(const std::string& name) const {
  Labels result;
  if (has_attribute(name, "units")) result.units = text_attribute(name, "units");
  if (has_attribute(name, "long_name")) result.long_name = text_attribute(name, "long_name");
  return result;
}

}  // namespace knothe::files
