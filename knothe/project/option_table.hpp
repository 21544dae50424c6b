#pragma once
/// @file The one table of all options of a project file: it validates, suggests the near miss, and makes the
/// reference `docs/project-file.md`.
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
  boolean,
  choice,
  numbers,
  texts,
  matrix,
  table,
  free_table  ///< any content, handed on as JSON
};

/// One option. `path` is dotted, with `*` for a name that the user chooses: "parameters.*.mean".
struct Option {
  std::string path;
  ValueKind kind;
  std::string default_value;         ///< as written in the file; empty: none
  std::string meaning;               ///< one sentence, with the unit
  std::vector<std::string> choices;  ///< for ValueKind::choice
  bool required = false;             ///< must be there if its table is
};

// The parts of the table, in the order of the reference.
/// [model], [data], [observations], [parameters].
[[nodiscard]] std::vector<Option> data_option_table();
/// [method].
[[nodiscard]] std::vector<Option> method_option_table();
/// [offline], [simulate], [select], [forecast].
[[nodiscard]] std::vector<Option> offline_option_table();
/// [serve].
[[nodiscard]] std::vector<Option> serve_option_table();
/// [dic], [simulate.camera].
[[nodiscard]] std::vector<Option> picture_option_table();

/// All options, in the order of the reference.
[[nodiscard]] std::span<const Option> option_table();

/// The reference of all options as Markdown: the content of docs/project-file.md.
[[nodiscard]] std::string option_reference();

/// How a kind is called in a message: "a positive number".
[[nodiscard]] std::string describe(ValueKind kind);

}  // namespace knothe::project
