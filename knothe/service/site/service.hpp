#pragma once
/// @file `knothe serve`: sites, routes and server together.
#include <functional>
#include <optional>
#include <string>

#include "knothe/project/project_file.hpp"

namespace knothe::service {

struct ServiceOptions {
  std::optional<int> port;  ///< overrides the project's
  std::string test;         ///< as of `Site`
  bool strict_deadline = false;
  std::function<void(const std::string& url)> listening;  ///< called once the address is there
};

/// Serves until the user stops it. Throws Interrupted (130) then, an Error of status 7 where a deadline was
/// missed under `strict_deadline`, and what `Site` and `HttpServer` throw.
[[noreturn]] void serve(const project::Project& project, const ServiceOptions& arguments);

}  // namespace knothe::service
