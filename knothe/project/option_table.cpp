#include "knothe/project/option_table.hpp"

#include <fmt/format.h>

namespace knothe::project {
namespace {

using K = ValueKind;

const std::vector<Option>& options() {
  static const std::vector<Option> k_all = [] {
    std::vector<Option> all;
    for (const auto& part :
         {project_option_table(), inference_option_table(), data_option_table(), method_option_table(),
          offline_option_table(), simulation_option_table(), forecast_option_table(), serve_option_table(),
          picture_option_table(), field_option_table()})
      all.insert(all.end(), part.begin(), part.end());
    return all;
  }();
  return k_all;
}

}  // namespace

std::span<const Option> option_table() {
  return options();
}

std::string describe(ValueKind kind) {
  switch (kind) {
    case K::text:
      return "string";
    case K::path:
      return "path";
    case K::integer:
      return "integer ≥ 0";
    case K::number:
      return "finite number";
    case K::positive:
      return "positive number";
    case K::non_negative:
      return "non-negative number";
    case K::choice:
      return "string";
    case K::numbers:
      return "array of numbers";
    case K::texts:
      return "array of strings";
    case K::matrix:
      return "array of rows of numbers";
    case K::table:
    case K::free_table:
      return "table";
  }
  return {};
}

std::string option_reference() {
  std::string out =
      "# Project file: all options\n\n"
      "Made by `knothe check --options` from the tables in `knothe/project/*_options.cpp`; do not edit. "
      "The format is TOML; paths are relative to the file; `*` stands for a name.\n\n"
      "| option | value | default | meaning |\n| --- | --- | --- | --- |\n";
  for (const Option& option : options()) {
    std::string value = describe(option.kind);
    if (option.kind == K::choice) {
      value.clear();
      for (const std::string& choice : option.choices)
        value += (value.empty() ? "`\"" : ", `\"") + choice + "\"`";
    }
    out += fmt::format("| `{}` | {} | {} | {} |\n", option.path, value,
                       option.default_value.empty() ? (option.required ? "required" : "–")
                                                    : "`" + option.default_value + "`",
                       option.meaning);
  }
  return out;
}

}  // namespace knothe::project
