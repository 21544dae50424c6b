#pragma once
/// @file The one table of all options of a project file: it validates, suggests the near miss, fills the
/// structs of options, and makes the reference `docs/reference/project-file.md`.
#include <functional>
#include <span>
#include <string>
#include <vector>

namespace knothe::project {

/// What a value may be.
enum class ValueKind {
  text,
  path,
  integer,
  number,
  positive,
  non_negative,
  choice,
  numbers,
  texts,
  matrix,
  table,
  free_table  ///< any content, handed on as JSON
};

/// One option. What it is bound to, and how it is read, is known to its section (option_section.hpp).
struct Option {
  /// What a number must be beyond its kind. The complaint may name the option's path as `{}`.
  struct Check {
    std::function<bool(double)> holds;
    std::string complaint;
  };

  std::string path;  ///< dotted, with `*` for a name that the user chooses: "parameters.*.mean"
  ValueKind kind;
  std::string meaning;               ///< one sentence, with the unit
  std::string default_value;         ///< what the struct begins with, as written in the file; empty: none
  std::vector<std::string> choices;  ///< for ValueKind::choice
  bool required = false;             ///< must be there if its table is
  bool is_file = false;              ///< relative to the project file
  std::string shape;                 ///< what an array must be: "two numbers, [x, y]"
  std::vector<Check> checks;
};

// The parts of the table.
[[nodiscard]] std::vector<Option> project_option_table();
[[nodiscard]] std::vector<Option> inference_option_table();
[[nodiscard]] std::vector<Option> data_option_table();
[[nodiscard]] std::vector<Option> method_option_table();
[[nodiscard]] std::vector<Option> offline_option_table();
[[nodiscard]] std::vector<Option> simulation_option_table();
[[nodiscard]] std::vector<Option> forecast_option_table();
[[nodiscard]] std::vector<Option> serve_option_table();
[[nodiscard]] std::vector<Option> picture_option_table();
[[nodiscard]] std::vector<Option> field_option_table();

/// All options, in the order of the reference.
[[nodiscard]] std::span<const Option> option_table();

/// The reference of all options as Markdown: the content of docs/reference/project-file.md.
[[nodiscard]] std::string option_reference();

/// How a kind is called: "positive number".
[[nodiscard]] std::string describe(ValueKind kind);

}  // namespace knothe::project
