/// @file Measurements as CSV.
#include "fuzz/support.hpp"
#include "knothe/likelihood/data/measurements_csv.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string& path = knothe::fuzz::write_scratch(data, size);
  knothe::fuzz::refuse_or_accept([&] {
    const auto measurements = knothe::likelihood::read_measurements_csv(path);
    if (measurements.values.rows() != static_cast<Eigen::Index>(measurements.sensors.displacement_count()))
      std::abort();
  });
  return 0;
}
