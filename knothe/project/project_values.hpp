#pragma once
/// @file A validated project file as a flat list of values, in the order of the file. Private to this room:
/// keeps toml++ in one translation unit.
#include <cstdint>
#include <map>
#include <string>
#include <variant>
#include <vector>

namespace knothe::project {

struct Value {
  std::variant<std::string, double, std::int64_t, bool, std::vector<double>, std::vector<std::string>,
               std::vector<std::vector<double>>>
      content;
  int line = 0, column = 0;
};

struct Complaint {
  int line = 0, column = 0;
  std::string text;
};

/// Leaves of the file by dotted path, and the names of sub-tables in file order.
struct Values {
  std::map<std::string, Value> leaves;
  std::map<std::string, std::vector<std::string>> children;  ///< of each table, in the order of the file
  std::map<std::string, std::pair<int, int>> tables;         ///< where each table stands
  std::vector<Complaint> complaints;

  [[nodiscard]] bool has(const std::string& path) const { return leaves.contains(path); }
  [[nodiscard]] bool has_table(const std::string& path) const { return tables.contains(path); }
  [[nodiscard]] std::string text(const std::string& path, const std::string& otherwise) const;
  [[nodiscard]] double number(const std::string& path, double otherwise) const;
  [[nodiscard]] std::int64_t integer(const std::string& path, std::int64_t otherwise) const;
  [[nodiscard]] std::vector<double> numbers(const std::string& path) const;
  [[nodiscard]] std::vector<std::string> texts(const std::string& path) const;
  [[nodiscard]] std::vector<std::vector<double>> matrix(const std::string& path) const;
  /// Complains if the whole number is given and smaller than that.
  void at_least(const std::string& path, std::int64_t least);
  /// Adds a complaint at the value or table of that path (or its nearest existing parent).
  void complain(const std::string& path, const std::string& text);
};

/// Parses TOML and checks every key and value against the option table.
[[nodiscard]] Values parse_values(const std::string& text);

}  // namespace knothe::project
