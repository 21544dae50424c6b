/// @file The body of POST /v1/measurements, and of an entry for the logbook. What is accepted must come
/// through the journal's form unchanged.
#include "fuzz/support.hpp"
#include "knothe/service/journal/logbook.hpp"
#include "knothe/service/journal/measurement.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace knothe::service;
  try {
    const Measurement datum = parse_json_measurement(knothe::fuzz::text_of(data, size)).measurement;
    const std::string payload = datum.payload();
    Measurement back;
    if (!back.set_payload(payload) || back.payload() != payload ||
        back.effective_values().size() != datum.values.size())
      std::abort();
  } catch (const RequestError& error) {
    if (error.status() != 400) std::abort();
  }
  try {
    if (parse_json_entry(knothe::fuzz::text_of(data, size)).author.empty()) std::abort();
  } catch (const RequestError& error) {
    if (error.status() != 400) std::abort();
  }
  return 0;
}
