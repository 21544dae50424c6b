#pragma once
/// @file The attribute `units` of a data set: honoured or refused, never ignored.
#include <optional>
#include <string>
#include <string_view>

#include "knothe/files/hdf5.hpp"

namespace knothe::files {

/// A unit of length, force, stress, time, or 1/length², as SI has it.
struct Unit {
  std::string_view si;  ///< "m", "N", "Pa", "s", "1/m2"
  double factor;        ///< a value in this unit times this is in SI
};
/// The unit of that name ("mm", "kN", …); nothing for one that is not known.
[[nodiscard]] std::optional<Unit> unit_of(std::string_view name);

/// What the values of a data set are to be multiplied by to be in `si`: 1 where the attribute is not there.
/// DataError for a unit of another kind, or one that is not known.
[[nodiscard]] double factor_to_si(const Hdf5Reader& file, const std::string& name, std::string_view si);

/// What times are to be multiplied by to be in s; 1 for a unit that is none of time.
[[nodiscard]] double time_factor(const Hdf5Reader& file, const std::string& name);

}  // namespace knothe::files
