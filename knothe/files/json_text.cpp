#include "knothe/files/json_text.hpp"

#include <fmt/format.h>

#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "knothe/base/error.hpp"

namespace knothe::files {
namespace {

using Json = nlohmann::json;

/// Builds the value from the parser's events, and refuses what JSON allows and we do not. The library's own
/// filter (`parser_callback_t`) looks at all members of an object or array each time that one of them ends.
class Builder final : public nlohmann::json_sax<Json> {
 public:
  explicit Builder(Json& root) : root_(root) {}

  bool null() override { return add(nullptr), true; }
  bool boolean(bool value) override { return add(value), true; }
  bool number_integer(number_integer_t value) override { return add(value), true; }
  bool number_unsigned(number_unsigned_t value) override { return add(value), true; }
  bool number_float(number_float_t value, const string_t& /*text*/) override { return add(value), true; }
  bool string(string_t& value) override { return add(std::move(value)), true; }
  bool binary(binary_t& value) override { return add(std::move(value)), true; }
  bool start_object(std::size_t /*members*/) override { return open(Json::object()); }
  bool start_array(std::size_t /*elements*/) override { return open(Json::array()); }
  bool end_object() override { return open_.pop_back(), true; }
  bool end_array() override { return open_.pop_back(), true; }
  bool key(string_t& key) override {
    const auto [place, is_new] = open_.back()->get_ref<Json::object_t&>().emplace(std::move(key), nullptr);
    if (!is_new)
      throw DataError(fmt::format("\"{}\" comes twice in one object", place->first.substr(0, 100)));
    member_ = &place->second;
    return true;
  }
  bool parse_error(std::size_t /*position*/, const std::string& /*token*/,
                   const nlohmann::detail::exception& error) override {
    throw DataError(error.what());
  }

 private:
  template <typename Value>
  Json& add(Value&& value) {
    if (open_.empty()) return root_ = std::forward<Value>(value);
    if (open_.back()->is_object()) return *member_ = std::forward<Value>(value);
    return open_.back()->get_ref<Json::array_t&>().emplace_back(std::forward<Value>(value));
  }
  bool open(Json&& value) {
    if (std::ssize(open_) >= k_deepest_json)
      throw DataError(fmt::format("it is nested deeper than {} levels", k_deepest_json));
    open_.push_back(&add(std::move(value)));
    return true;
  }

  Json& root_;
  std::vector<Json*> open_;  ///< objects and arrays that have not ended, from the outermost on
  Json* member_ = nullptr;   ///< of the innermost object, whose value comes next
};

}  // namespace

nlohmann::json parse_json(std::string_view text) {
  Json value;
  Builder builder(value);
  try {
    Json::sax_parse(text, &builder);
  } catch (const Json::exception& error) {
    throw DataError(error.what());
  }
  return value;
}

nlohmann::json read_json(const std::string& path) {
  std::ifstream in(path);
  if (!in) throw DataError(path + ": cannot be read");
  try {
    return parse_json(std::string(std::istreambuf_iterator<char>(in), {}));
  } catch (const DataError& error) {
    throw DataError(fmt::format("{}: not JSON: {}", path, error.what()));
  }
}

}  // namespace knothe::files
