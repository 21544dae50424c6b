#pragma once
/// @file HDF5 files, every return value checked; a message names the file, the data set and the index.
#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace knothe::files {

using Shape = std::vector<std::size_t>;

/// What every data set says of itself.
struct Labels {
  std::string units;      ///< SI unit, "1" for a pure number
  std::string long_name;  ///< one line for a person
};

/// Reads a file. All errors (missing, truncated, not HDF5, wrong type or shape) are DataError.
class Hdf5Reader {
 public:
  explicit Hdf5Reader(std::string path);
  ~Hdf5Reader();
  Hdf5Reader(Hdf5Reader&&) noexcept;
  Hdf5Reader& operator=(Hdf5Reader&&) noexcept;

  [[nodiscard]] const std::string& path() const;
  /// Whether a group or data set of that absolute name ("/modes/space") exists.
  [[nodiscard]] bool has(const std::string& name) const;
  /// Names of the members of a group, sorted.
  [[nodiscard]] std::vector<std::string> members(const std::string& group) const;
  [[nodiscard]] Shape shape(const std::string& name) const;

  /// The whole data set as doubles, C order. NaN and infinity are refused by full index
  /// ("snapshots[1,2,3,4]") unless `allow_nan`.
  [[nodiscard]] std::vector<double> read(const std::string& name, bool allow_nan = false) const;
  /// The same, and the shape must be `expected`.
  [[nodiscard]] std::vector<double> read(const std::string& name, const Shape& expected,
                                         bool allow_nan = false) const;
  /// A slab: `count` entries from `offset` in every direction (for data sets that do not fit in memory).
  [[nodiscard]] std::vector<double> read_slab(const std::string& name, const Shape& offset,
                                              const Shape& count) const;
  [[nodiscard]] std::vector<std::int64_t> read_integers(const std::string& name) const;

  /// Attributes of the object `name` ("/" for the root). Missing or of another type: DataError.
  [[nodiscard]] bool has_attribute(const std::string& name, const std::string& attribute) const;
  [[nodiscard]] std::string text_attribute(const std::string& name, const std::string& attribute) const;
  /// Fixed- or variable-length strings, UTF-8 or ASCII.
  [[nodiscard]] std::vector<std::string> texts_attribute(const std::string& name,
                                                         const std::string& attribute) const;
  [[nodiscard]] double number_attribute(const std::string& name, const std::string& attribute) const;
  [[nodiscard]] Labels labels(const std::string& name) const;  ///< empty where absent

 private:
  struct Implementation;
  std::unique_ptr<Implementation> implementation_;
};

/// Writes a file. Use inside `write_atomically`, and call `close` last: that is where a full disk shows.
/// Groups in names are made as needed. All errors are IoError.
class Hdf5Writer {
 public:
  explicit Hdf5Writer(std::string path);
  ~Hdf5Writer();
  Hdf5Writer(const Hdf5Writer&) = delete;
  Hdf5Writer& operator=(const Hdf5Writer&) = delete;

  void write(const std::string& name, std::span<const double> values, const Shape& shape,
             const Labels& labels);
  /// The same with 32-bit floats on disk: half the size, 7 digits.
  void write_single_precision(const std::string& name, std::span<const double> values, const Shape& shape,
                              const Labels& labels);
  void write_integers(const std::string& name, std::span<const std::int64_t> values, const Shape& shape,
                      const Labels& labels);
  /// One text for each entry, UTF-8 of variable length.
  void write_texts(const std::string& name, std::span<const std::string> values, const Labels& labels);
  void text_attribute(const std::string& name, const std::string& attribute, const std::string& value);
  void texts_attribute(const std::string& name, const std::string& attribute,
                       std::span<const std::string> values);
  void number_attribute(const std::string& name, const std::string& attribute, double value);
  void integer_attribute(const std::string& name, const std::string& attribute, std::int64_t value);
  void make_group(const std::string& name);
  /// Turns the one-dimensional data set `scale` into a dimension scale whose NAME attribute is `title`.
  void make_scale(const std::string& scale, const std::string& title);
  /// Turns the one-dimensional data set `scale` into a dimension scale and attaches it to axis `axis` of
  /// `name` (NetCDF-4 layout). Attached scales are read back and checked.
  void attach_scale(const std::string& name, unsigned axis, const std::string& scale);
  /// Flushes and closes; throws IoError if anything could not be written.
  void close();

 private:
  struct Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace knothe::files
