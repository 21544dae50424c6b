#include "knothe/files/units.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <utility>

#include "knothe/base/error.hpp"

namespace knothe::files {
namespace {

using Row = std::pair<std::string_view, Unit>;

constexpr auto k_units = std::to_array<Row>({
    {"m", {"m", 1}},           {"km", {"m", 1e3}},       {"cm", {"m", 1e-2}},       {"mm", {"m", 1e-3}},
    {"um", {"m", 1e-6}},       {"µm", {"m", 1e-6}},      {"μm", {"m", 1e-6}},       {"nm", {"m", 1e-9}},
    {"meter", {"m", 1}},       {"metre", {"m", 1}},      {"N", {"N", 1}},           {"kN", {"N", 1e3}},
    {"MN", {"N", 1e6}},        {"Pa", {"Pa", 1}},        {"kPa", {"Pa", 1e3}},      {"MPa", {"Pa", 1e6}},
    {"GPa", {"Pa", 1e9}},      {"s", {"s", 1}},          {"ms", {"s", 1e-3}},       {"min", {"s", 60}},
    {"us", {"s", 1e-6}},       {"µs", {"s", 1e-6}},      {"μs", {"s", 1e-6}},       {"ns", {"s", 1e-9}},
    {"usec", {"s", 1e-6}},     {"msec", {"s", 1e-3}},    {"sec", {"s", 1}},         {"second", {"s", 1}},
    {"seconds", {"s", 1}},     {"minute", {"s", 60}},    {"minutes", {"s", 60}},    {"h", {"s", 3600}},
    {"hr", {"s", 3600}},       {"hour", {"s", 3600}},    {"hours", {"s", 3600}},    {"d", {"s", 86400}},
    {"day", {"s", 86400}},     {"days", {"s", 86400}},   {"1/m2", {"1/m2", 1}},     {"m-2", {"1/m2", 1}},
    {"1/m^2", {"1/m2", 1}},    {"m^-2", {"1/m2", 1}},    {"1/mm2", {"1/m2", 1e6}},  {"mm-2", {"1/m2", 1e6}},
    {"1/mm^2", {"1/m2", 1e6}}, {"mm^-2", {"1/m2", 1e6}}, {"1/um2", {"1/m2", 1e12}}, {"um-2", {"1/m2", 1e12}},
    {"1/µm2", {"1/m2", 1e12}},
});

}  // namespace

std::optional<Unit> unit_of(std::string_view name) {
  const auto it =
      std::find_if(k_units.begin(), k_units.end(), [&](const Row& row) { return row.first == name; });
  if (it == k_units.end()) return std::nullopt;
  return it->second;
}

double time_factor(const Hdf5Reader& file, const std::string& name) {
  const std::string stated = file.labels(name).units;
  const auto unit = unit_of(stated);
  if (!unit && !stated.empty() && stated != "1")
    throw DataError(
        fmt::format("{}: the attribute units of {} is \"{}\", which is not known: give s, ms, us, "
                    "min, h or d; or 1 where the time is only a number",
                    file.path(), name.substr(1), stated));
  return unit && unit->si == "s" ? unit->factor : 1;
}

double factor_to_si(const Hdf5Reader& file, const std::string& name, std::string_view si) {
  const std::string stated = file.labels(name).units;
  if (stated.empty()) return 1;
  const auto unit = unit_of(stated);
  if (unit && unit->si == si) return unit->factor;
  std::string known;
  for (const auto& [word, other] : k_units)
    if (other.si == si) known += (known.empty() ? "" : ", ") + std::string(word);
  throw DataError(fmt::format("{}: the attribute units of {} is \"{}\": {} is needed (understood are {})",
                              file.path(), name.substr(1), stated, si, known));
}

}  // namespace knothe::files
