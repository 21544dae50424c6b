#pragma once
/// @file Reading of [method]. Private to this room.
#include "knothe/project/project_file.hpp"

namespace knothe::project {

struct Values;

/// The table [method]; complains of what is out of range.
[[nodiscard]] MethodOptions read_method(Values& values);

}  // namespace knothe::project
