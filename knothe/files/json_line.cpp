#include "knothe/files/json_line.hpp"

#include <cmath>
#include <nlohmann/json.hpp>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"

namespace knothe::files {
namespace {

void check_finite(const nlohmann::ordered_json& value, const std::string& path) {
  if (value.is_number_float() && !std::isfinite(value.get<double>())) {
    throw NumericalError("the result \"" + path + "\" is not finite; it is not printed");
  }
  if (value.is_object()) {
    for (const auto& [key, member] : value.items())
      check_finite(member, path.empty() ? key : path + "." + key);
  } else if (value.is_array()) {
    for (Index i = 0; i < std::ssize(value); ++i)
      check_finite(value[i], path + "[" + std::to_string(i) + "]");
  }
}

}  // namespace

std::string json_line(const nlohmann::ordered_json& value) {
  check_finite(value, "");
  // What is not UTF-8 (a name that an older journal holds, a file's) must not keep all the rest from leaving.
  return value.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

}  // namespace knothe::files
