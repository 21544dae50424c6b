#include <fmt/format.h>
#include <hdf5_hl.h>

#include <cassert>

#include "knothe/base/error.hpp"
#include "knothe/files/hdf5_handle.hpp"

namespace knothe::files {

struct Hdf5Writer::Implementation {
  std::string path;
  Hdf5Handle file;

  [[noreturn]] void fail(const std::string& what) const {
    throw IoError(fmt::format("{}: could not write {}: {}", path, what, hdf5_cause()));
  }
  void write(const std::string& name, const void* values, hid_t memory_type, hid_t file_type,
             const Shape& shape, const Labels& labels);
  void attribute(const std::string& name, const std::string& attribute, hid_t type, hid_t space,
                 const void* value);
};

namespace {

Hdf5Handle text_type(std::size_t size) {
  Hdf5Handle type(H5Tcopy(H5T_C_S1), H5Tclose);
  H5Tset_size(type.get(), size == 0 ? 1 : size);
  H5Tset_cset(type.get(), H5T_CSET_UTF8);
  H5Tset_strpad(type.get(), H5T_STR_NULLPAD);
  return type;
}

/// Links are made with their parents, in an order that NetCDF-4 can follow.
Hdf5Handle link_properties() {
  Hdf5Handle list(H5Pcreate(H5P_LINK_CREATE), H5Pclose);
  H5Pset_create_intermediate_group(list.get(), 1);
  H5Pset_char_encoding(list.get(), H5T_CSET_UTF8);
  return list;
}

constexpr unsigned k_tracked_order = H5P_CRT_ORDER_TRACKED | H5P_CRT_ORDER_INDEXED;

}  // namespace

Hdf5Writer::Hdf5Writer(std::string path) : implementation_(std::make_unique<Implementation>()) {
  prepare_hdf5();
  implementation_->path = std::move(path);
  const Hdf5Handle creation(H5Pcreate(H5P_FILE_CREATE), H5Pclose);
  H5Pset_link_creation_order(creation.get(), k_tracked_order);
  H5Pset_attr_creation_order(creation.get(), k_tracked_order);
  H5Pset_obj_track_times(creation.get(), false);  // the same content gives the same bytes
  implementation_->file = Hdf5Handle(
      H5Fcreate(implementation_->path.c_str(), H5F_ACC_TRUNC, creation.get(), H5P_DEFAULT), H5Fclose);
  if (!implementation_->file) implementation_->fail("the file");
}

Hdf5Writer::~Hdf5Writer() = default;

void Hdf5Writer::Implementation::write(const std::string& name, const void* values, hid_t memory_type,
                                       hid_t file_type, const Shape& shape, const Labels& labels) {
  const std::vector<hsize_t> extents(shape.begin(), shape.end());
  const Hdf5Handle space(H5Screate_simple(extents.size(), extents.data(), nullptr), H5Sclose);
  const Hdf5Handle links = link_properties();
  const Hdf5Handle creation(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
  H5Pset_attr_creation_order(creation.get(), k_tracked_order);
  H5Pset_obj_track_times(creation.get(), false);
  Hdf5Handle set(
      H5Dcreate2(file.get(), name.c_str(), file_type, space.get(), links.get(), creation.get(), H5P_DEFAULT),
      H5Dclose);
  if (!set) fail("data set " + name);
  if (number_of_entries(shape) > 0 &&
      H5Dwrite(set.get(), memory_type, H5S_ALL, H5S_ALL, H5P_DEFAULT, values) < 0) {
    fail("data set " + name);
  }
  const Hdf5Handle scalar(H5Screate(H5S_SCALAR), H5Sclose);
  for (const auto& [key, text] :
       {std::pair{"units", &labels.units}, std::pair{"long_name", &labels.long_name}}) {
    if (text->empty()) continue;
    const Hdf5Handle type = text_type(text->size());
    attribute(name, key, type.get(), scalar.get(), text->c_str());
  }
  if (!set.reset()) fail("data set " + name);
}

void Hdf5Writer::Implementation::attribute(const std::string& name, const std::string& attribute, hid_t type,
                                           hid_t space, const void* value) {
  const std::string what = fmt::format("attribute {} of {}", attribute, name);
  const Hdf5Handle owner(H5Oopen(file.get(), name.c_str(), H5P_DEFAULT), H5Oclose);
  if (!owner) fail(what);
  if (H5Aexists(owner.get(), attribute.c_str()) > 0 && H5Adelete(owner.get(), attribute.c_str()) < 0)
    fail(what);
  const Hdf5Handle handle(H5Acreate2(owner.get(), attribute.c_str(), type, space, H5P_DEFAULT, H5P_DEFAULT),
                          H5Aclose);
  if (!handle || H5Awrite(handle.get(), type, value) < 0) fail(what);
}

void Hdf5Writer::write(const std::string& name, std::span<const double> values, const Shape& shape,
                       const Labels& labels) {
  assert(values.size() == number_of_entries(shape));
  implementation_->write(name, values.data(), H5T_NATIVE_DOUBLE, H5T_IEEE_F64LE, shape, labels);
}

void Hdf5Writer::write_single_precision(const std::string& name, std::span<const double> values,
                                        const Shape& shape, const Labels& labels) {
  assert(values.size() == number_of_entries(shape));
  implementation_->write(name, values.data(), H5T_NATIVE_DOUBLE, H5T_IEEE_F32LE, shape, labels);
}

void Hdf5Writer::write_integers(const std::string& name, std::span<const std::int64_t> values,
                                const Shape& shape, const Labels& labels) {
  assert(values.size() == number_of_entries(shape));
  implementation_->write(name, values.data(), H5T_NATIVE_INT64, H5T_STD_I64LE, shape, labels);
}

void Hdf5Writer::write_texts(const std::string& name, std::span<const std::string> values,
                             const Labels& labels) {
  const Hdf5Handle type = text_type(H5T_VARIABLE);
  std::vector<const char*> pointers;
  for (const std::string& value : values) pointers.push_back(value.c_str());
  implementation_->write(name, pointers.data(), type.get(), type.get(), {values.size()}, labels);
}

void Hdf5Writer::text_attribute(const std::string& name, const std::string& attribute,
                                const std::string& value) {
  // Small texts lie beside the object; HDF5 limits those to 64 KiB, so long ones have variable length.
  const Hdf5Handle scalar(H5Screate(H5S_SCALAR), H5Sclose);
  constexpr std::size_t k_small = 8192;
  const Hdf5Handle type = text_type(value.size() > k_small ? H5T_VARIABLE : value.size());
  const char* text = value.c_str();
  implementation_->attribute(name, attribute, type.get(), scalar.get(),
                             value.size() > k_small ? static_cast<const void*>(&text) : text);
}

void Hdf5Writer::texts_attribute(const std::string& name, const std::string& attribute,
                                 std::span<const std::string> values) {
  const hsize_t n = values.size();
  const Hdf5Handle space(H5Screate_simple(1, &n, nullptr), H5Sclose);
  const Hdf5Handle type = text_type(H5T_VARIABLE);
  std::vector<const char*> pointers;
  for (const std::string& value : values) pointers.push_back(value.c_str());
  implementation_->attribute(name, attribute, type.get(), space.get(), pointers.data());
}

void Hdf5Writer::number_attribute(const std::string& name, const std::string& attribute, double value) {
  const Hdf5Handle scalar(H5Screate(H5S_SCALAR), H5Sclose);
  implementation_->attribute(name, attribute, H5T_NATIVE_DOUBLE, scalar.get(), &value);
}

void Hdf5Writer::integer_attribute(const std::string& name, const std::string& attribute,
                                   std::int64_t value) {
  const Hdf5Handle scalar(H5Screate(H5S_SCALAR), H5Sclose);
  implementation_->attribute(name, attribute, H5T_NATIVE_INT64, scalar.get(), &value);
}

void Hdf5Writer::make_group(const std::string& name) {
  const Hdf5Handle links = link_properties();
  const Hdf5Handle creation(H5Pcreate(H5P_GROUP_CREATE), H5Pclose);
  H5Pset_link_creation_order(creation.get(), k_tracked_order);
  H5Pset_attr_creation_order(creation.get(), k_tracked_order);
  H5Pset_obj_track_times(creation.get(), false);
  const Hdf5Handle group(
      H5Gcreate2(implementation_->file.get(), name.c_str(), links.get(), creation.get(), H5P_DEFAULT),
      H5Gclose);
  if (!group) implementation_->fail("group " + name);
}

void Hdf5Writer::make_scale(const std::string& scale, const std::string& title) {
  const Hdf5Handle scale_set(H5Dopen2(implementation_->file.get(), scale.c_str(), H5P_DEFAULT), H5Dclose);
  if (!scale_set || H5DSset_scale(scale_set.get(), title.c_str()) < 0) {
    implementation_->fail("dimension scale " + scale);
  }
}

void Hdf5Writer::attach_scale(const std::string& name, unsigned axis, const std::string& scale) {
  const std::string what = fmt::format("dimension scale {} of axis {} of {}", scale, axis, name);
  const Hdf5Handle set(H5Dopen2(implementation_->file.get(), name.c_str(), H5P_DEFAULT), H5Dclose);
  const Hdf5Handle scale_set(H5Dopen2(implementation_->file.get(), scale.c_str(), H5P_DEFAULT), H5Dclose);
  if (!set || !scale_set) implementation_->fail(what);
  if (H5DSis_scale(scale_set.get()) <= 0) make_scale(scale, scale.substr(scale.rfind('/') + 1));
  if (H5DSattach_scale(set.get(), scale_set.get(), axis) < 0) implementation_->fail(what);
  if (H5DSis_attached(set.get(), scale_set.get(), axis) <= 0) implementation_->fail(what);
}

void Hdf5Writer::close() {
  if (!implementation_->file) return;
  if (H5Fflush(implementation_->file.get(), H5F_SCOPE_GLOBAL) < 0) implementation_->fail("the file");
  if (!implementation_->file.reset()) implementation_->fail("the file");
}

}  // namespace knothe::files
