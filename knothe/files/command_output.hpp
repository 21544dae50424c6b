#pragma once
/// @file What a command prints on stdout: JSON lines for other programs, or text for people.
#include <nlohmann/json_fwd.hpp>
#include <string_view>

namespace knothe::files {

class CommandOutput {
 public:
  explicit CommandOutput(bool json) : json_(json) {}

  [[nodiscard]] bool json() const { return json_; }
  /// One line: `record` (as json_line, NumericalError if it is not finite) or `text`, whichever is asked for.
  /// Without text people see nothing. Flushed: it may be read while the command goes on.
  void line(const nlohmann::ordered_json& record, std::string_view text) const;
  /// Printed only for other programs, or only for people.
  void record(const nlohmann::ordered_json& record) const;
  void text(std::string_view text) const;

 private:
  bool json_;
};

}  // namespace knothe::files
