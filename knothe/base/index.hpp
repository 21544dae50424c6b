#pragma once
/// @file The one type of indices and counts.
#include <cstddef>

namespace knothe {

/// Signed, as Eigen's and as `std::ssize` returns it: differences of indices are what they look like, and
/// neither comparisons nor subscripts need a cast.
using Index = std::ptrdiff_t;

}  // namespace knothe
