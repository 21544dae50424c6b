#pragma once
/// @file What both the reader and the writer of HDF5 files need of the C library. Private to this room.
#include <hdf5.h>

#include <string>
#include <utility>

#include "knothe/files/hdf5.hpp"

namespace knothe::files {

/// Owns one identifier of the HDF5 library and closes it with the function for its kind.
class Hdf5Handle {
 public:
  using Closer = herr_t (*)(hid_t);
  Hdf5Handle() = default;
  Hdf5Handle(hid_t id, Closer closer) : id_(id), closer_(closer) {}
  ~Hdf5Handle() { reset(); }
  Hdf5Handle(Hdf5Handle&& other) noexcept : id_(std::exchange(other.id_, -1)), closer_(other.closer_) {}
  Hdf5Handle& operator=(Hdf5Handle&& other) noexcept {
    std::swap(id_, other.id_);
    std::swap(closer_, other.closer_);
    return *this;
  }
  [[nodiscard]] hid_t get() const { return id_; }
  explicit operator bool() const { return id_ >= 0; }
  /// Closes now; false if the library could not.
  bool reset() {
    const hid_t id = std::exchange(id_, -1);
    return id < 0 || closer_(id) >= 0;
  }

 private:
  hid_t id_ = -1;
  Closer closer_ = nullptr;
};

/// Before any other call of the library: no clean-up at exit, and no printing of its error stack, which goes
/// into our own messages instead.
void prepare_hdf5();

/// The innermost cause in the library's error stack, e.g. "No space left on device"; clears nothing. With a
/// remedy where the cause is a full disk.
[[nodiscard]] std::string hdf5_cause();

/// "(7, 7, 100)".
[[nodiscard]] std::string shape_text(const Shape& shape);

/// The index of entry `position` of a C-ordered array, "[1,2,3,4]".
[[nodiscard]] std::string index_text(std::size_t position, const Shape& shape, const Shape& offset = {});

/// Number of entries; 1 for a scalar.
[[nodiscard]] std::size_t number_of_entries(const Shape& shape);

}  // namespace knothe::files
