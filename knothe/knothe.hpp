#pragma once
/// @file All of the library: link `knothe::knothe` (CMake) or `pkg-config knothe`, include this, compile as
/// C++20 (docs/how-to/library.md).
///
/// The border is made of numbers in std::vector and std::span, std::function and plain structs. Arrays of
/// several indices are in C order: point after point, the last index contiguous. No type of another library
/// crosses it, and no compiler option of ours: the caller's program may be compiled for any instruction set.
/// A caller's mistake is an exception of class knothe::Error, whose text says what is wrong and what to do; a
/// numerical outcome is in the result.
#include "knothe/base/error.hpp"
#include "knothe/base/version.hpp"
#include "knothe/library/assimilation.hpp"
#include "knothe/library/correlation.hpp"
#include "knothe/library/posterior.hpp"
#include "knothe/library/transport_map.hpp"
