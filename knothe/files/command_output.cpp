#include "knothe/files/command_output.hpp"

#include <cstdio>
#include <nlohmann/json.hpp>

#include "knothe/base/console.hpp"
#include "knothe/files/json_line.hpp"

namespace knothe::files {
namespace {

void print(std::string_view line) {
  std::fwrite(line.data(), 1, line.size(), stdout);
  std::fputc('\n', stdout);
  std::fflush(stdout);
}

}  // namespace

void CommandOutput::line(const nlohmann::ordered_json& record, std::string_view text) const {
  this->record(record);
  if (!text.empty()) this->text(text);
}

void CommandOutput::record(const nlohmann::ordered_json& record) const {
  if (json_) print(json_line(record));
}

void CommandOutput::text(std::string_view text) const {
  if (!json_) print(for_people(std::string(text), stdout, 4));
}

}  // namespace knothe::files
