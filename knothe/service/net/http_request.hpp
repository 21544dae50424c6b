#pragma once
/// @file The target of a request taken apart. Private to the room.
#include <string_view>

#include "knothe/service/net/http_server.hpp"

namespace knothe::service {

/// Path and query of `target`, percent-decoded.
void set_target(HttpRequest& request, std::string_view target);

}  // namespace knothe::service
