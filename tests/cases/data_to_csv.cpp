/// @file The same measurements as CSV: Python's standard library reads no HDF5.
///
/// usage: data_to_csv DATA.h5 DATA.csv
#include <cstdio>
#include <exception>

#include "knothe/likelihood/data/measurements.hpp"

int main(int argc, char** argv) {
  if (argc != 3) return std::fputs("usage: data_to_csv DATA.h5 DATA.csv\n", stderr), 2;
  try {
    const auto m = knothe::likelihood::read_measurements(argv[1]);
    const auto std = m.noise.measurement().standard_deviations();
    std::FILE* out = std::fopen(argv[2], "w");
    if (!out) return std::perror(argv[2]), 5;
    std::fputs("time,sensor,x,y,z,component,value,std\n", out);
    for (Eigen::Index t = 0; t < m.values.cols(); ++t) {
      for (Eigen::Index j = 0; j < m.values.rows(); ++j) {
        const auto at = m.sensors.point(static_cast<std::size_t>(j));
        std::fprintf(out, "%.17g,s%d,%.17g,%.17g,%.17g,%c,%.17g,%.17g\n", m.time[static_cast<std::size_t>(t)],
                     static_cast<int>(j), at[0], at[1], at[2],
                     "xyz"[m.sensors.components[static_cast<std::size_t>(j)]], m.values(j, t), std[j]);
      }
    }
    return std::fclose(out) == 0 ? 0 : 5;
  } catch (const std::exception& error) {
    return std::fprintf(stderr, "data_to_csv: %s\n", error.what()), 1;
  }
}
