#pragma once
/// @file A validated project file as a flat list of values, in the order of the file. Private to this room:
/// keeps toml++ in one translation unit.
#include <array>
#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "knothe/project/option_table.hpp"

namespace knothe::project {

using Content = std::variant<std::string, double, std::int64_t, std::vector<double>, std::vector<std::string>,
                             std::vector<std::vector<double>>>;

/// The kind of an option, unless a rule says more.
[[nodiscard]] inline ValueKind kind_of(const Content& content) {
  using K = ValueKind;
  constexpr std::array k_kinds{K::text, K::number, K::integer, K::numbers, K::texts, K::matrix};
  return k_kinds[content.index()];
}

struct Value {
  Content content;
  int line = 0, column = 0;
};

struct Complaint {
  int line = 0, column = 0;
  std::string text;
};

/// Leaves of the file by dotted path, and the names of sub-tables in file order.
struct Values {
  std::string folder;  ///< of the project file
  std::map<std::string, Value> leaves;
  std::map<std::string, std::vector<std::string>> children;  ///< of each table, in the order of the file
  std::map<std::string, std::pair<int, int>> tables;         ///< where each table stands
  std::vector<Complaint> complaints;

  [[nodiscard]] bool has(const std::string& path) const { return leaves.contains(path); }
  [[nodiscard]] bool has_table(const std::string& path) const { return tables.contains(path); }
  /// The content of an option, whose kind has been checked; T() where it is not there.
  template <class T>
  [[nodiscard]] T get(const std::string& path) const {
    const auto it = leaves.find(path);
    return it == leaves.end() ? T() : std::get<T>(it->second.content);
  }
  [[nodiscard]] std::vector<std::string> children_of(const std::string& table) const;
  /// A path as seen from the project file; none stays none.
  [[nodiscard]] std::string resolved(const std::string& file) const;
  /// Adds a complaint at the value or table of that path (or its nearest existing parent).
  void complain(const std::string& path, const std::string& text);
  /// Whether a number holds what the option asks for beyond its kind; complains.
  bool passes(const Option& option, const std::string& path);
  /// Complains of an array that is not of the option's shape, or a number that is out of range.
  void complain_of_shape(const Option& option, const std::string& path);
};

/// Parses TOML and checks every key and value against the option table. `folder` is the project file's.
[[nodiscard]] Values parse_values(const std::string& text, const std::string& folder);

}  // namespace knothe::project
