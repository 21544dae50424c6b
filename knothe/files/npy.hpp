#pragma once
/// @file Arrays of numpy (.npy), read.
#include <string>
#include <vector>

namespace knothe::files {

/// An array in C order.
struct NpyArray {
  std::vector<std::size_t> shape;
  std::vector<double> values;
};

/// Reads a file of numpy's format 1 to 3: float32, float64, int32 or int64, little-endian, C or Fortran order
/// (numpy.lib.format). Otherwise DataError, which says how to save it.
[[nodiscard]] NpyArray read_npy(const std::string& path);

}  // namespace knothe::files
