#include "knothe/service/journal/measurement.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstring>
#include <initializer_list>
#include <nlohmann/json.hpp>

#include "knothe/base/error.hpp"
#include "knothe/base/text.hpp"
#include "knothe/files/json_text.hpp"
#include "knothe/files/npy.hpp"
#include "knothe/files/numbers.hpp"
#include "knothe/service/journal/logbook.hpp"
#include "knothe/service/journal/noise_bytes.hpp"

namespace knothe::service {
namespace {

using Received = nlohmann::json;

constexpr std::int64_t k_largest_seq = std::int64_t{1} << 53;  // what JSON numbers hold exactly
constexpr std::size_t k_longest_name = 128;
constexpr std::size_t k_longest_text = 4000;

[[noreturn]] void malformed(const std::string& message) {
  throw RequestError(400, "Malformed", message);
}

bool is_utf8(const std::string& text) {
  try {
    (void)Received(text).dump();
    return true;
  } catch (const Received::type_error&) {
    return false;
  }
}

/// What is a name in HTTP, MQTT and JSON alike.
void check_name(const std::string& text, const char* what, bool may_be_empty) {
  if (text.empty() && !may_be_empty) malformed(fmt::format("\"{}\" must not be empty", what));
  if (text.size() > k_longest_name)
    malformed(fmt::format("\"{}\" is longer than {} bytes", what, k_longest_name));
  for (const char c : text)
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f)
      malformed(fmt::format("\"{}\" has a control character", what));
  if (!is_utf8(text)) malformed(fmt::format("\"{}\" is not UTF-8", what));
}

const Received& member(const Received& object, const char* name) {
  const auto it = object.find(name);
  if (it == object.end()) malformed(fmt::format("\"{}\" is missing", name));
  return *it;
}

std::string text_member(const Received& object, const char* name, bool required) {
  if (!required && !object.contains(name)) return "";
  const Received& value = member(object, name);
  if (!value.is_string()) malformed(fmt::format("\"{}\" must be a string", name));
  auto text = value.get<std::string>();
  check_name(text, name, !required);
  return text;
}

std::int64_t checked_index(const Received& value, const char* name) {
  const bool fits = value.is_number_unsigned() ? value.get<std::uint64_t>() <= k_largest_seq
                                               : value.is_number_integer() && value.get<std::int64_t>() >= 0;
  if (!fits) malformed(fmt::format("\"{}\" must be an integer from 0 to 2^53", name));
  return value.get<std::int64_t>();
}

Received parse_object(std::string_view body) {
  Received object;
  try {
    object = files::parse_json(body);
  } catch (const DataError& error) {
    malformed(fmt::format("the body is not JSON that can be taken: {}", error.what()));
  }
  if (!object.is_object()) malformed("the body must be one JSON object");
  return object;
}

likelihood::DatumKey key_of(const Received& object) {
  return {text_member(object, "source", true), text_member(object, "session", true),
          checked_index(member(object, "seq"), "seq")};
}

/// Other keys are the sender's own, but not one that looks like a slip in a key that may be left out: a value
/// said to be bad would count as good.
void refuse_slips(const Received& object, std::initializer_list<std::string> optional) {
  const std::vector<std::string> names(optional);
  for (const auto& [key, value] : object.items())
    if (const std::string near = near_miss(key, names); !near.empty() && near != key)
      malformed(
          fmt::format("\"{}\" is no key of this request: write \"{}\", or give it another name", key, near));
}

std::uint8_t status_code(const std::string& word) {
  return word == "good" ? 0 : word == "missing" ? 1 : word == "bad" ? 2 : 3;
}

void read_values(const Received& array, Measurement& datum) {
  if (!array.is_array()) malformed("\"values\" must be an array of numbers");
  datum.values.reserve(array.size());
  for (std::size_t i = 0; i < array.size(); ++i) {
    const Received& value = array[i];
    if (!value.is_null() && !value.is_number())
      malformed(fmt::format("values[{}] is neither a number nor null", i));
    datum.values.push_back(value.is_null() ? std::numeric_limits<double>::quiet_NaN() : value.get<double>());
  }
  datum.status.assign(datum.values.size(), 0);
}

void read_status(const Received& array, Measurement& datum) {
  if (!array.is_array()) malformed("\"status\" must be an array of words");
  if (array.size() != datum.values.size())
    malformed(fmt::format("\"status\" has {} entries for {} values", array.size(), datum.values.size()));
  for (std::size_t i = 0; i < array.size(); ++i) {
    if (!array[i].is_string()) malformed(fmt::format("status[{}] is not a word", i));
    datum.status[i] = status_code(array[i].get_ref<const std::string&>());
  }
}

void read_series(const Received& object, Measurement& datum) {
  if (!object.is_object() || object.empty()) malformed("\"series\" must be an object of numbers by name");
  for (const auto& [name, value] : object.items()) {
    if (!value.is_null() && !value.is_number())
      malformed(fmt::format("series \"{}\" is neither a number nor null", name));
    datum.series[name] = value.is_null() ? std::numeric_limits<double>::quiet_NaN() : value.get<double>();
  }
}

}  // namespace

void Measurement::set_values_of_series(const model::Sensors& sensors) {
  values.assign(sensors.size(), std::numeric_limits<double>::quiet_NaN());
  status.assign(sensors.size(), 1);
  for (const auto& [name, value] : series) {
    const auto found = std::find(sensors.scalars.begin(), sensors.scalars.end(), name);
    if (found == sensors.scalars.end())
      malformed(fmt::format("this site does not take the series \"{}\"{}", name,
                            did_you_mean(name, sensors.scalars)));
    const std::size_t at = sensors.displacement_count() + (found - sensors.scalars.begin());
    values[at] = value;
    status[at] = std::isnan(value) ? 1 : 0;
  }
  series.clear();
}

std::vector<double> Measurement::effective_values() const {
  std::vector<double> effective = values;
  for (std::size_t i = 0; i < status.size(); ++i)
    if (status[i] != 0) effective[i] = std::numeric_limits<double>::quiet_NaN();
  return effective;
}

likelihood::Datum Measurement::datum() const {
  const std::vector<double> effective = effective_values();
  const std::size_t index = step;
  likelihood::Datum datum{
      key, index, index, Eigen::Map<const Eigen::VectorXd>(effective.data(), std::ssize(effective)), {}};
  if (!noise.empty()) datum.noise = noise_of_bytes(noise);
  return datum;
}

std::string Measurement::payload() const {
  const auto n = values.size();
  std::string bytes(sizeof n + 9 * values.size(), '\0');
  std::memcpy(bytes.data(), &n, sizeof n);
  for (std::size_t i = 0; i < values.size(); ++i) {
    // One NaN for all: the payload of a duplicate must be the same to the bit.
    const double value = std::isnan(values[i]) ? std::numeric_limits<double>::quiet_NaN() : values[i];
    std::memcpy(bytes.data() + sizeof n + 8 * i, &value, 8);
  }
  if (!status.empty()) std::memcpy(bytes.data() + sizeof n + 8 * values.size(), status.data(), status.size());
  return bytes;
}

bool Measurement::set_payload(std::string_view bytes) {
  std::uint64_t n = 0;
  if (bytes.size() < sizeof n) return false;
  std::memcpy(&n, bytes.data(), sizeof n);
  if (n > bytes.size() || bytes.size() != sizeof n + 9 * n) return false;
  values.resize(n);
  status.resize(n);
  if (n > 0) std::memcpy(values.data(), bytes.data() + sizeof n, 8 * n);
  if (n > 0) std::memcpy(status.data(), bytes.data() + sizeof n + 8 * n, n);
  return true;
}

SiteMeasurement parse_json_measurement(std::string_view body) {
  const Received object = parse_object(body);
  refuse_slips(object, {"status", "series"});
  SiteMeasurement result;
  Measurement& datum = result.measurement;
  result.site = text_member(object, "site", false);
  if (object.contains("test")) result.test = text_member(object, "test", false);
  datum.key = key_of(object);
  const Received& time = member(object, "time");
  if (!time.is_number() || !std::isfinite(time.get<double>())) malformed("\"time\" must be a finite number");
  datum.time = time.get<double>();
  if (object.contains("series")) {
    if (object.contains("values") || object.contains("status"))
      malformed("\"series\" stands in place of \"values\" and \"status\"");
    read_series(object["series"], datum);
  } else {
    read_values(member(object, "values"), datum);
    if (object.contains("status")) read_status(object["status"], datum);
  }
  return result;
}

namespace {

/// Who has a token of his own signs by it.
std::string author_of(const Received& object, const std::string& holder, bool required) {
  std::string given = text_member(object, "by", required && holder.empty());
  if (!holder.empty() && !given.empty() && given != holder)
    throw RequestError(
        403, "OtherName",
        fmt::format("the token is that of \"{0}\": \"by\" must be \"{0}\", or left out", holder));
  return holder.empty() ? given : holder;
}

/// `text` or `comment`.
std::string long_text_of(const Received& object) {
  std::string text;
  for (const char* name : {"text", "comment"}) {
    const auto it = object.find(name);
    if (it == object.end()) continue;
    if (!it->is_string()) malformed(fmt::format("\"{}\" must be a string", name));
    text = it->get<std::string>();
    if (text.size() > k_longest_text)
      malformed(fmt::format("\"{}\" is longer than {} bytes", name, k_longest_text));
  }
  return text;
}

}  // namespace

EntryRequest parse_json_entry(std::string_view body, const std::string& holder) {
  const Received object = parse_object(body);
  EntryRequest request;
  request.site = text_member(object, "site", false);
  request.author = author_of(object, holder, true);
  if (const auto it = object.find("step"); it != object.end()) request.step = checked_index(*it, "step");
  if (const auto it = object.find("sensor"); it != object.end() && it->is_string())
    request.sensor_name = text_member(object, "sensor", true);
  else if (it != object.end())
    request.sensor_index = checked_index(*it, "sensor");
  if (const auto it = object.find("active"); it != object.end()) {
    if (!it->is_boolean()) malformed("\"active\" must be true or false");
    request.active = it->get<bool>();
  }
  if (object.contains("name")) request.test = text_member(object, "name", false);
  request.text = long_text_of(object);
  return request;
}

SiteKey parse_json_key(std::string_view body, const std::string& holder) {
  const Received object = parse_object(body);
  refuse_slips(object, {"record"});
  SiteKey named{text_member(object, "site", false), {key_of(object)}};
  if (const auto it = object.find("record"); it != object.end())
    named.datum.which = RecordName::Which::numbered, named.datum.number = checked_index(*it, "record");
  named.signature = {author_of(object, holder, false), long_text_of(object)};
  return named;
}

namespace {

/// Site and source of knothe/v1/SITE/SOURCE/`last`.
std::pair<std::string_view, std::string_view> read_topic(std::string_view topic, std::string_view last) {
  const std::string_view head = "knothe/v1/";
  const bool framed = topic.size() > head.size() + last.size() && topic.starts_with(head) &&
                      topic.ends_with(last) && topic[topic.size() - last.size() - 1] == '/';
  const std::string_view middle =
      framed ? topic.substr(head.size(), topic.size() - head.size() - last.size() - 1) : std::string_view();
  const auto slash = middle.find('/');
  if (slash == std::string_view::npos)
    malformed(fmt::format("the topic must be knothe/v1/SITE/SOURCE/{}", last));
  return {middle.substr(0, slash), middle.substr(slash + 1)};
}

/// What the payload says, if anything, is what the topic says.
void set_site(std::string& site, const std::string& source,
              std::pair<std::string_view, std::string_view> topic) {
  if ((!site.empty() && site != topic.first) || source != topic.second)
    malformed("\"site\" or \"source\" is not that of the topic");
  site = topic.first;
}

}  // namespace

SiteMeasurement parse_mqtt_measurement(std::string_view topic, std::string_view payload) {
  const auto names = read_topic(topic, "data");
  SiteMeasurement datum = parse_json_measurement(payload);
  set_site(datum.site, datum.measurement.key.source, names);
  return datum;
}

SiteKey parse_mqtt_key(std::string_view topic, std::string_view payload) {
  const auto names = read_topic(topic, "withdraw");
  SiteKey datum = parse_json_key(payload);
  set_site(datum.site, datum.datum.key.source, names);
  return datum;
}

std::vector<double> parse_npy(std::string_view bytes) try {
  files::NpyArray array = files::parse_npy(bytes, "the body");
  if (!array.is_float) malformed("the .npy array must be of type float32 or float64");
  if (array.shape.size() != 1) malformed("the .npy array must have one dimension");
  if (array.unused_bytes > 0)
    malformed(
        fmt::format("{} bytes follow the .npy array of {} numbers", array.unused_bytes, array.shape[0]));
  for (std::size_t i = 0; i < array.values.size(); ++i)
    if (std::isinf(array.values[i])) malformed(fmt::format("values[{}] is infinite", i));
  return std::move(array.values);
} catch (const DataError& error) {
  malformed(error.what());
}

SiteMeasurement parse_npy_measurement(std::string_view body, const NpyHeaders& headers) {
  SiteMeasurement result;
  Measurement& datum = result.measurement;
  const auto checked = [](const std::string& text, const char* name, bool may_be_empty) {
    check_name(text, name, may_be_empty);
    return text;
  };
  result.site = checked(headers.site, "site", true);
  if (!headers.test.empty()) result.test = checked(headers.test, "test", true);
  datum.key.source = checked(headers.source, "source", false);
  datum.key.session = checked(headers.session, "session", false);
  const char* end = headers.seq.data() + headers.seq.size();
  const auto seq = std::from_chars(headers.seq.data(), end, datum.key.seq);
  if (headers.seq.empty() || seq.ec != std::errc() || seq.ptr != end || datum.key.seq < 0 ||
      datum.key.seq > k_largest_seq)
    malformed("the header \"seq\" must be an integer from 0 to 2^53");
  const auto time = files::parse_number(headers.time);
  if (!time || !std::isfinite(*time)) malformed("the header \"time\" must be a finite number");
  datum.time = *time;
  datum.values = parse_npy(body);
  datum.status.assign(datum.values.size(), 0);
  if (headers.status.empty()) return result;
  std::size_t count = 0;
  for (std::size_t from = 0; from <= headers.status.size(); ++count) {
    const std::size_t comma = std::min(headers.status.find(',', from), headers.status.size());
    std::string word = headers.status.substr(from, comma - from);
    std::erase(word, ' ');
    if (count < datum.status.size()) datum.status[count] = status_code(word);
    from = comma + 1;
  }
  if (count != datum.values.size())
    malformed(fmt::format("the header \"status\" has {} words for {} values", count, datum.values.size()));
  return result;
}

}  // namespace knothe::service
