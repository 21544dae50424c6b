#include "knothe/files/netcdf.hpp"

#include <fmt/format.h>

#include "knothe/base/error.hpp"
#include "knothe/base/version.hpp"

namespace knothe::files {

namespace {

std::string join(const std::string& group, const std::string& name) {
  return group.empty() ? "/" + name : fmt::format("/{}/{}", group, name);
}

template <class... Functions>
struct Overloaded : Functions... {
  using Functions::operator()...;
};

std::size_t size_of(const NetcdfValues& values) {
  return std::visit(Overloaded{[](const SinglePrecision& v) { return v.values.size(); },
                               [](const auto& v) { return v.size(); }},
                    values);
}

}  // namespace

NetcdfWriter::NetcdfWriter(const std::string& path) : file_(path), path_(path) {
  file_.text_attribute("/", "_NCProperties", fmt::format("version=2,hdf5=1.10,knothe={}", k_version));
  file_.text_attribute("/", "Conventions", "CF-1.8");
}

void NetcdfWriter::ensure_group(const std::string& group) {
  if (groups_.try_emplace(group).second && !group.empty()) file_.make_group("/" + group);
}

void NetcdfWriter::make_dimension(const std::string& group, const std::string& name, std::size_t length,
                                  bool coordinates) {
  // The library tells a dimension without coordinates by this title of its scale.
  const std::string title =
      coordinates ? name : fmt::format("This is a netCDF dimension but not a netCDF variable.{:10d}", length);
  if (!groups_[group].try_emplace(name, Dimension{length, next_id_}).second) {
    throw UsageError(fmt::format("{}: dimension {} is there already", path_, join(group, name)));
  }
  file_.make_scale(join(group, name), title);
  file_.integer_attribute(join(group, name), "_Netcdf4Dimid", next_id_++);
}

void NetcdfWriter::add_dimension(const std::string& group, const std::string& name, std::size_t length) {
  ensure_group(group);
  const std::vector<double> zeros(length, 0.0);
  file_.write(join(group, name), zeros, {length}, {});
  make_dimension(group, name, length, false);
}

void NetcdfWriter::add_dimension(const std::string& group, const std::string& name,
                                 const NetcdfValues& coordinates, const Labels& labels) {
  ensure_group(group);
  write(join(group, name), coordinates, {size_of(coordinates)}, labels);
  make_dimension(group, name, size_of(coordinates), true);
}

void NetcdfWriter::write(const std::string& name, const NetcdfValues& values, const Shape& shape,
                         const Labels& labels) {
  std::visit(
      Overloaded{
          [&](std::span<const double> v) { file_.write(name, v, shape, labels); },
          [&](const SinglePrecision& v) { file_.write_single_precision(name, v.values, shape, labels); },
          [&](std::span<const std::int64_t> v) { file_.write_integers(name, v, shape, labels); },
          [&](std::span<const std::string> v) {
            if (shape.size() != 1)
              throw UsageError(fmt::format("{}: variable {}: texts have one dimension", path_, name));
            file_.write_texts(name, v, labels);
          }},
      values);
}

void NetcdfWriter::add_variable(const std::string& group, const std::string& name,
                                std::span<const std::string> dimensions, const NetcdfValues& values,
                                const Labels& labels) {
  ensure_group(group);
  const auto& known = groups_[group];
  Shape shape;
  for (const std::string& dimension : dimensions) {
    const auto found = known.find(dimension);
    if (found == known.end()) {
      throw UsageError(fmt::format("{}: variable {} needs dimension {}, which its group does not have", path_,
                                   join(group, name), dimension));
    }
    shape.push_back(found->second.length);
  }
  std::size_t entries = 1;
  for (const std::size_t extent : shape) entries *= extent;
  if (entries != size_of(values)) {
    throw UsageError(fmt::format("{}: variable {} has {} values, its dimensions ({}) need {}", path_,
                                 join(group, name), size_of(values), fmt::join(dimensions, ", "), entries));
  }
  write(join(group, name), values, shape, labels);
  for (unsigned axis = 0; axis < dimensions.size(); ++axis) {
    file_.attach_scale(join(group, name), axis, join(group, dimensions[axis]));
  }
}

void NetcdfWriter::add_attribute(const std::string& group, const std::string& name,
                                 const std::string& value) {
  ensure_group(group);
  file_.text_attribute("/" + group, name, value);
}

void NetcdfWriter::add_number(const std::string& group, const std::string& variable, const std::string& name,
                              double value) {
  file_.number_attribute(join(group, variable), name, value);
}

void NetcdfWriter::add_text(const std::string& group, const std::string& variable, const std::string& name,
                            const std::string& value) {
  file_.text_attribute(join(group, variable), name, value);
}

void NetcdfWriter::close() {
  file_.close();
}

}  // namespace knothe::files
