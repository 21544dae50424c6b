#pragma once
/// @file How well a fitted outline lies on the picture (PNG).
#include <string>

#include "knothe/files/picture.hpp"
#include "knothe/imaging/mesh/outline_registration.hpp"

namespace knothe::report {

/// Writes PATH: the picture, the fitted outline as a line, the edges that were found as dots (used) and
/// crosses (not in agreement with the others). Errors: IoError.
void write_registration_map(const std::string& path, const files::Picture& picture,
                            const imaging::OutlineFit& fit);

}  // namespace knothe::report
