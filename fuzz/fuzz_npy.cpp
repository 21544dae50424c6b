/// @file The npy body of POST /v1/measurements, with its headers: six lines of text before it.
#include <array>

#include "fuzz/support.hpp"
#include "knothe/service/journal/measurement.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace knothe::service;
  std::string rest = knothe::fuzz::text_of(data, size);
  std::array<std::string, 6> lines;
  for (std::string& line : lines) {
    const auto end = rest.find('\n');
    line = rest.substr(0, end);
    rest = end == std::string::npos ? "" : rest.substr(end + 1);
  }
  try {
    const Measurement datum =
        parse_npy_measurement(rest, {lines[0], lines[1], lines[2], lines[3], lines[4], lines[5]}).measurement;
    if (datum.status.size() != datum.values.size()) std::abort();
  } catch (const RequestError& error) {
    if (error.status() != 400) std::abort();
  }
  return 0;
}
