/// @file An MQTT message: its topic in the first line, then its payload.
#include "fuzz/support.hpp"
#include "knothe/service/journal/measurement.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace knothe::service;
  const std::string text = knothe::fuzz::text_of(data, size);
  const auto end = text.find('\n');
  const std::string topic = text.substr(0, end),
                    payload = end == std::string::npos ? "" : text.substr(end + 1);
  try {
    const bool withdraws = topic.ends_with("/withdraw");
    const auto key = withdraws ? parse_mqtt_key(topic, payload).datum.key
                               : parse_mqtt_measurement(topic, payload).measurement.key;
    if (key.source.empty()) std::abort();
  } catch (const RequestError& error) {
    if (error.status() != 400) std::abort();
  }
  return 0;
}
