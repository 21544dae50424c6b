#include "knothe/files/json_text.hpp"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <string>
#include <unordered_set>
#include <vector>

#include "knothe/base/error.hpp"

namespace knothe::files {
namespace {

using Json = nlohmann::json;
using Event = Json::parse_event_t;

/// Sees each event of the parser, and refuses what JSON allows and we do not.
class Bounds {
 public:
  bool operator()(int depth, Event event, const Json& value) {
    const bool begins = event == Event::object_start || event == Event::array_start;
    if (begins && depth >= k_deepest_json)
      throw DataError(fmt::format("it is nested deeper than {} levels", k_deepest_json));
    if (event == Event::object_start) keys_.emplace_back();
    if (event == Event::object_end) keys_.pop_back();
    if (event != Event::key) return true;
    const auto& key = value.get_ref<const std::string&>();
    if (!keys_.back().insert(key).second)
      throw DataError(fmt::format("\"{}\" comes twice in one object", key.substr(0, 100)));
    return true;
  }

 private:
  std::vector<std::unordered_set<std::string>> keys_;  ///< of the objects that are open
};

}  // namespace

nlohmann::json parse_json(std::string_view text) {
  Bounds bounds;
  try {
    return Json::parse(text,
                       [&](int depth, Event event, Json& value) { return bounds(depth, event, value); });
  } catch (const Json::exception& error) {
    throw DataError(error.what());
  }
}

}  // namespace knothe::files
