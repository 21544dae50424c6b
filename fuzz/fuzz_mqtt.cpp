/// @file An MQTT message: its topic in the first line, then its payload.
#include "fuzz/support.hpp"
#include "knothe/service/journal/measurement.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace knothe::service;
  const std::string text = knothe::fuzz::text_of(data, size);
  const auto end = text.find('\n');
  try {
    const SiteMeasurement datum =
        parse_mqtt_measurement(text.substr(0, end), end == std::string::npos ? "" : text.substr(end + 1));
    if (datum.measurement.key.source.empty()) std::abort();
  } catch (const RequestError& error) {
    if (error.status() != 400) std::abort();
  }
  return 0;
}
