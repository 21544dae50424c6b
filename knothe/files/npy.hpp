#pragma once
/// @file Arrays of numpy (.npy), read.
#include <string>
#include <string_view>
#include <vector>

namespace knothe::files {

/// An array in C order.
struct NpyArray {
  std::vector<std::size_t> shape;
  std::vector<double> values;
  bool is_float = true;          ///< not whole numbers
  std::size_t unused_bytes = 0;  ///< behind the array
};

/// An array in numpy's format 1 to 3: float32, float64, int32 or int64, of either byte order, in C or Fortran
/// order (numpy.lib.format). Otherwise DataError, which begins with `name` and says how to save it.
[[nodiscard]] NpyArray parse_npy(std::string_view text, const std::string& name);
/// The same of a file.
[[nodiscard]] NpyArray read_npy(const std::string& path);

}  // namespace knothe::files
