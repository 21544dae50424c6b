/// @file Model files. Damaged bytes are refused by the file's seal before HDF5 sees them (HDF5 1.10 does not
/// survive all of them), so what is fuzzed is the rest: well-formed files whose data sets and attributes are
/// missing, of another type or shape, or full of nonsense. What is read must be whole and finite.
#include <fuzzer/FuzzedDataProvider.h>
#include <hdf5.h>

#include <cmath>
#include <fstream>
#include <iterator>
#include <vector>

#include "fuzz/support.hpp"
#include "knothe/files/seal.hpp"
#include "knothe/model/reduced/model_file.hpp"

namespace {

struct Place {
  std::string object, attribute;  ///< attribute empty: the object itself
};

std::string read_seed() {
  std::ifstream file(KNOTHE_FUZZ_MODEL, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

herr_t visit(hid_t, const char* name, const H5O_info_t*, void* places) {
  static_cast<std::vector<Place>*>(places)->push_back({name, ""});
  return 0;
}

/// All objects and attributes of a file.
std::vector<Place> places_of(const std::string& bytes) {
  const std::string& path =
      knothe::fuzz::write_scratch(reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size());
  const hid_t file = H5Fopen(path.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT);
  std::vector<Place> places;
  H5Ovisit2(file, H5_INDEX_NAME, H5_ITER_INC, visit, &places, H5O_INFO_BASIC);
  for (std::size_t i = 0, objects = places.size(); i < objects; ++i) {
    H5O_info_t info;
    H5Oget_info_by_name2(file, places[i].object.c_str(), &info, H5O_INFO_NUM_ATTRS, H5P_DEFAULT);
    for (hsize_t a = 0; a < info.num_attrs; ++a) {
      char name[64];
      H5Aget_name_by_idx(file, places[i].object.c_str(), H5_INDEX_NAME, H5_ITER_INC, a, name, sizeof name,
                         H5P_DEFAULT);
      places.push_back({places[i].object, name});
    }
  }
  H5Fclose(file);
  return places;
}

struct Seed {
  std::string bytes = read_seed();
  std::vector<Place> places = places_of(bytes);
};

/// A data set or attribute of any type and shape in place of what is there.
void replace(hid_t file, const Place& place, FuzzedDataProvider& input) {
  if (place.attribute.empty()) {
    if (place.object != ".") H5Ldelete(file, place.object.c_str(), H5P_DEFAULT);
  } else {
    H5Adelete_by_name(file, place.object.c_str(), place.attribute.c_str(), H5P_DEFAULT);
  }
  if (input.ConsumeBool()) return;
  hsize_t size[4], count = 1;
  const int rank = input.ConsumeIntegralInRange(0, 4);
  for (int k = 0; k < rank; ++k) count *= size[k] = input.ConsumeIntegralInRange<hsize_t>(0, 9);
  const hid_t space = rank == 0 ? H5Screate(H5S_SCALAR) : H5Screate_simple(rank, size, nullptr);
  hid_t type = H5Tcopy(H5T_C_S1);
  switch (input.ConsumeIntegralInRange(0, 4)) {
    case 0:
      H5Tset_size(type, H5T_VARIABLE);
      break;
    case 1:
      H5Tset_size(type, 8);
      break;
    case 2:
      H5Tclose(type), type = H5Tcopy(H5T_IEEE_F32LE);
      break;
    case 3:
      H5Tclose(type), type = H5Tcopy(H5T_STD_I64BE);
      break;
    default:
      H5Tclose(type), type = H5Tcopy(H5T_IEEE_F64LE);
  }
  const bool variable = H5Tis_variable_str(type) > 0;
  std::vector<std::uint8_t> raw = input.ConsumeBytes<std::uint8_t>(variable ? 0 : count * H5Tget_size(type));
  raw.resize(variable ? 0 : count * H5Tget_size(type));
  const std::string text = input.ConsumeRandomLengthString(20);
  std::vector<const char*> texts(count, text.c_str());
  const void* content = variable ? static_cast<const void*>(texts.data()) : raw.data();
  if (place.attribute.empty()) {
    const hid_t set =
        H5Dcreate2(file, place.object.c_str(), type, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    if (set >= 0) H5Dwrite(set, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, content), H5Dclose(set);
  } else {
    const hid_t attribute = H5Acreate_by_name(file, place.object.c_str(), place.attribute.c_str(), type,
                                              space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    if (attribute >= 0) H5Awrite(attribute, type, content), H5Aclose(attribute);
  }
  H5Tclose(type);
  H5Sclose(space);
}

/// Changes a number of a data set where it is.
void spoil(hid_t file, const Place& place, FuzzedDataProvider& input) {
  const hid_t set = H5Dopen2(file, place.object.c_str(), H5P_DEFAULT);
  if (set < 0) return;
  const hid_t space = H5Dget_space(set);
  const auto count = static_cast<std::size_t>(H5Sget_simple_extent_npoints(space));
  std::vector<double> values(count);
  if (count > 0 && H5Dread(set, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()) >= 0) {
    values[input.ConsumeIntegralInRange<std::size_t>(0, count - 1)] =
        input.ConsumeBool() ? input.ConsumeFloatingPoint<double>() : NAN;
    H5Dwrite(set, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data());
  }
  H5Sclose(space);
  H5Dclose(set);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
  static const Seed k_seed;
  FuzzedDataProvider input(data, size);
  const std::string& path = knothe::fuzz::write_scratch(
      reinterpret_cast<const std::uint8_t*>(k_seed.bytes.data()), k_seed.bytes.size());
  const hid_t file = H5Fopen(path.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
  if (file < 0) std::abort();
  for (int edits = 0; edits < 6 && input.remaining_bytes() > 0; ++edits) {
    const Place& place =
        k_seed.places[input.ConsumeIntegralInRange<std::size_t>(0, k_seed.places.size() - 1)];
    input.ConsumeBool() && place.attribute.empty() ? spoil(file, place, input) : replace(file, place, input);
  }
  H5Fclose(file);
  knothe::files::seal(path);  // otherwise each file is read in a process of its own first
  knothe::fuzz::refuse_or_accept([&] {
    const auto model = knothe::model::read_model(path);
    for (const double value : model.space)
      if (!std::isfinite(value)) std::abort();
    if (model.lift.size() != model.time.size() * model.dof_count()) std::abort();
  });
  return 0;
}
