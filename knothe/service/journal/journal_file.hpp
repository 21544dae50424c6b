#pragma once
/// @file A file of a watched folder, as the journal knows it.
#include <array>
#include <cstdint>
#include <string>

#include "knothe/base/enum_names.hpp"

namespace knothe::service {

enum class FileOutcome {
  taken,     ///< its data are in the journal
  refused,   ///< none, or not all of them: an alarm says why
  elsewhere  ///< it was there before the test was begun: of another specimen
};
constexpr auto names_of(FileOutcome) {
  return std::to_array<Named<FileOutcome>>({{FileOutcome::taken, "taken"},
                                            {FileOutcome::refused, "refused"},
                                            {FileOutcome::elsewhere, "elsewhere"}});
}

struct JournalFile {
  std::string source, name;  ///< source of its data; name in its folder
  std::string digest;        ///< SHA-256 of its content, in hex
  FileOutcome outcome = FileOutcome::taken;
  std::int64_t seq = -1;  ///< of its datum, where it has one
};

}  // namespace knothe::service
