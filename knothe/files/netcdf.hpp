#pragma once
/// @file NetCDF-4 files, for ArviZ and xarray: HDF5 files with dimension scales.
///
/// Layout: "NetCDF-4 File Format", Unidata (appendix C of the NetCDF user's guide). Each ArviZ group
/// ("posterior", "observed_data", …) has dimensions of its own.
#include <cstdint>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "knothe/files/hdf5.hpp"

namespace knothe::files {

/// Writes a file. As with Hdf5Writer: inside `write_atomically`, `close` last. Errors: IoError; a variable
/// whose dimensions do not exist or do not fit: UsageError.
class NetcdfWriter {
 public:
  explicit NetcdfWriter(const std::string& path);

  /// A dimension without coordinates.
  void add_dimension(const std::string& group, const std::string& name, std::size_t length);
  /// A dimension with coordinates: also the variable of that name.
  void add_dimension(const std::string& group, const std::string& name, std::span<const double> coordinates,
                     const Labels& labels);
  /// A variable over dimensions of the same group, C order. NaN is NetCDF's missing value.
  void add_variable(const std::string& group, const std::string& name,
                    std::span<const std::string> dimensions, std::span<const double> values,
                    const Labels& labels);
  /// An attribute of a group ("" is the file).
  void add_attribute(const std::string& group, const std::string& name, const std::string& value);
  void close();

 private:
  struct Dimension {
    std::size_t length;
    std::int64_t id;
  };
  void make_dimension(const std::string& group, const std::string& name, std::size_t length,
                      bool coordinates);
  void ensure_group(const std::string& group);

  Hdf5Writer file_;
  std::string path_;
  std::map<std::string, std::map<std::string, Dimension>> groups_;
  std::int64_t next_id_ = 0;
};

}  // namespace knothe::files
