#pragma once

#include <cstdlib>

namespace knothe::test {

/// A long test has two forms of one body: the short one in `make test`, and `<name>.slow`, which sets
/// KNOTHE_SLOW (SLOW in cmake/KnotheRoom.cmake).
inline bool long_form() {
  return std::getenv("KNOTHE_SLOW") != nullptr;
}

/// How many draws, seeds, steps, … of either form.
template <class T>
T by_form(T in_short, T in_long) {
  return long_form() ? in_long : in_short;
}

}  // namespace knothe::test
