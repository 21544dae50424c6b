#pragma once
/// @file Lines as bytes, for a file of this process alone.
#include <memory>
#include <string>
#include <string_view>

#include "knothe/service/site/line.hpp"

namespace knothe::service {

/// All of a line but its model.
[[nodiscard]] std::string bytes_of(const Line& line);
/// The line of such bytes.
[[nodiscard]] std::shared_ptr<Line> line_of_bytes(std::string_view bytes);

}  // namespace knothe::service
