#pragma once
/// @file NetCDF-4 files, for ArviZ and xarray: HDF5 files with dimension scales.
///
/// Layout: "NetCDF-4 File Format", Unidata (appendix C of the NetCDF user's guide). Each ArviZ group
/// ("posterior", "observed_data", …) has dimensions of its own.
#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <variant>

#include "knothe/files/hdf5.hpp"

namespace knothe::files {

/// Numbers that 32 bits are enough for on disk: half the size, 7 digits.
struct SinglePrecision {
  std::span<const double> values;
};

/// What a variable holds. Texts are UTF-8, and have one dimension.
using NetcdfValues = std::variant<std::span<const double>, SinglePrecision, std::span<const std::int64_t>,
                                  std::span<const std::string>>;

/// Writes a file. As with Hdf5Writer: inside `write_atomically`, `close` last. Errors: IoError; a variable
/// whose dimensions do not exist or do not fit: UsageError.
class NetcdfWriter {
 public:
  explicit NetcdfWriter(const std::string& path);

  /// A dimension without coordinates.
  void add_dimension(const std::string& group, const std::string& name, std::size_t length);
  /// A dimension with coordinates: also the variable of that name.
  void add_dimension(const std::string& group, const std::string& name, const NetcdfValues& coordinates,
                     const Labels& labels);
  /// A variable over dimensions of the same group, C order. NaN is NetCDF's missing value.
  void add_variable(const std::string& group, const std::string& name,
                    std::span<const std::string> dimensions, const NetcdfValues& values,
                    const Labels& labels);
  /// An attribute of a group ("" is the file).
  void add_attribute(const std::string& group, const std::string& name, const std::string& value);
  /// An attribute of a variable.
  void add_number(const std::string& group, const std::string& variable, const std::string& name,
                  double value);
  void add_text(const std::string& group, const std::string& variable, const std::string& name,
                const std::string& value);
  void close();

 private:
  struct Dimension {
    std::size_t length;
    std::int64_t id;
  };
  void make_dimension(const std::string& group, const std::string& name, std::size_t length,
                      bool coordinates);
  void write(const std::string& name, const NetcdfValues& values, const Shape& shape, const Labels& labels);
  void ensure_group(const std::string& group);

  Hdf5Writer file_;
  std::string path_;
  std::map<std::string, std::map<std::string, Dimension>> groups_;
  std::int64_t next_id_ = 0;
};

}  // namespace knothe::files
