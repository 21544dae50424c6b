#include "knothe/files/hdf5_handle.hpp"

#include <fmt/format.h>

namespace knothe::files {

namespace {

/// Stores the description of the innermost entry: HDF5 walks upwards from where the error arose.
herr_t store_innermost(unsigned level, const H5E_error2_t* entry, void* data) {
  if (level == 0 && entry->desc != nullptr) *static_cast<std::string*>(data) = entry->desc;
  return 0;
}

}  // namespace

void prepare_hdf5() {
  // A file that could not be closed (disk full) stays in the library's tables, and its clean-up at exit would
  // close it a second time and crash: seen with 1.10.8. Files that matter are closed by their owners. This
  // must be the first call.
  H5dont_atexit();
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
}

std::string hdf5_cause() {
  std::string description;
  H5Ewalk2(H5E_DEFAULT, H5E_WALK_UPWARD, store_innermost, &description);
  // The file driver writes "…, errno = 28, error message = 'No space left on device', …": keep the system's
  // words.
  const std::string key = "error message = '";
  if (const auto begin = description.find(key); begin != std::string::npos) {
    const auto start = begin + key.size();
    const std::string words = description.substr(start, description.find('\'', start) - start);
    const bool full = description.find("errno = 28,") != std::string::npos;
    return words + (full ? " (disk full: free some space, or write elsewhere with -o)" : "");
  }
  return description.empty() ? "no reason given by the HDF5 library" : description;
}

std::string shape_text(const Shape& shape) {
  return fmt::format("({})", fmt::join(shape, ", "));
}

std::string index_text(std::size_t position, const Shape& shape, const Shape& offset) {
  Shape index(shape.size());
  for (std::size_t k = shape.size(); k-- > 0;) {
    index[k] = position % shape[k] + (offset.empty() ? 0 : offset[k]);
    position /= shape[k];
  }
  return fmt::format("[{}]", fmt::join(index, ","));
}

std::size_t number_of_entries(const Shape& shape) {
  std::size_t n = 1;
  for (const std::size_t extent : shape) n *= extent;
  return n;
}

}  // namespace knothe::files
