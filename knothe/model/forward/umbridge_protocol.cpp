#include "knothe/model/forward/umbridge_protocol.hpp"

#include <fmt/format.h>

#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/files/json_text.hpp"

namespace knothe::model::umbridge {
namespace {

/// The beginning of a text, on one line.
std::string beginning(const std::string& text, std::size_t length = 200) {
  std::string out;
  for (const char c : text.substr(0, length)) out += c == '\n' || c == '\r' ? ' ' : c;
  return text.size() > length ? out + "…" : out;
}

/// −Infinity and −inf, outside of strings, by the lowest number there is.
std::string without_infinities(const std::string& text) {
  std::string out;
  bool quoted = false;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] == '"' && (i == 0 || text[i - 1] != '\\')) quoted = !quoted;
    const std::size_t length = quoted                                 ? 0
                               : text.compare(i, 9, "-Infinity") == 0 ? 9
                               : text.compare(i, 4, "-inf") == 0      ? 4
                                                                      : 0;
    if (length == 0) {
      out += text[i];
    } else {
      out += "-1.7976931348623157e308";
      i += length - 1;
    }
  }
  return out;
}

}  // namespace

Json read_answer(const HttpAnswer& answer, const std::string& where, bool infinities) {
  Json json;
  std::string fault;
  try {
    json = files::parse_json(infinities ? without_infinities(answer.body) : answer.body);
  } catch (const DataError& error) {
    fault = error.what();
  }
  if (fault.empty() && json.is_object() && json.contains("error")) {
    const Json& error = json["error"];
    const auto text = [&](const char* key) {
      return error.is_object() && error.contains(key) && error[key].is_string()
                 ? error[key].get<std::string>()
                 : std::string();
    };
    const std::string type = text("type"), message = text("message");
    throw DataError(fmt::format("{}: the server says: {}", where,
                                type.empty() && message.empty() ? beginning(error.dump())
                                : type.empty()                  ? message
                                                                : type + ": " + message));
  }
  if (answer.status != 200)
    throw DataError(fmt::format("{}: the server answered with HTTP status {}: {}", where, answer.status,
                                answer.body.empty() ? "(no text)" : beginning(answer.body)));
  if (!fault.empty())
    throw DataError(fmt::format("{}: the answer is not JSON (which has no NaN and no infinity): {}", where,
                                answer.body.empty() ? "(empty)" : beginning(answer.body)));
  if (!json.is_object())
    throw DataError(fmt::format("{}: the answer is not a JSON object: {}", where, beginning(answer.body)));
  return json;
}

const Json& member(const Json& answer, const std::string& key, const std::string& where) {
  if (!answer.contains(key))
    throw DataError(fmt::format("{}: the answer has no \"{}\": {}", where, key, beginning(answer.dump())));
  return answer[key];
}

std::vector<std::size_t> read_sizes(const Json& answer, const std::string& key, const std::string& where) {
  std::vector<std::size_t> sizes;
  const Json& array = member(answer, key, where);
  for (const Json& size : array)
    if (size.is_number() && size.get<double>() >= 0 && size.get<double>() < 1e9 &&
        size.get<double>() == std::floor(size.get<double>()))
      sizes.push_back(size.get<double>());
  if (!array.is_array() || array.empty() || sizes.size() != array.size())
    throw DataError(
        fmt::format("{}: \"{}\" must be a list of sizes, not {}", where, key, beginning(array.dump())));
  return sizes;
}

void read_vector(const Json& array, Eigen::Ref<Eigen::VectorXd> out, const std::string& what,
                 const std::string& where) {
  if (!array.is_array())
    throw DataError(
        fmt::format("{}: {} must be a list of numbers, not {}", where, what, beginning(array.dump())));
  if (std::ssize(array) != out.size())
    throw DataError(fmt::format("{}: {} has {} entries; by the sizes that the server gives it must have {}",
                                where, what, array.size(), out.size()));
  for (Eigen::Index i = 0; i < out.size(); ++i) {
    const Json& entry = array[i];
    if (!entry.is_number())
      throw DataError(
          fmt::format("{}: {}[{}] is {}, not a finite number", where, what, i, beginning(entry.dump())));
    out[i] = entry.get<double>();
    if (!std::isfinite(out[i]))
      throw DataError(fmt::format("{}: {}[{}] is {}, not a finite number", where, what, i, out[i]));
  }
}

Json cut(const Eigen::Ref<const Eigen::VectorXd>& values, const std::vector<std::size_t>& sizes) {
  Json vectors = Json::array();
  Eigen::Index begin = 0;
  for (const std::size_t size : sizes) {
    Json vector = Json::array();
    for (std::size_t i = 0; i < size; ++i) vector.push_back(values[begin++]);
    vectors.push_back(std::move(vector));
  }
  return vectors;
}

}  // namespace knothe::model::umbridge
