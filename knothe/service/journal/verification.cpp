#include "knothe/service/journal/verification.hpp"

#include <fmt/format.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "knothe/base/error.hpp"
#include "knothe/files/atomic_file.hpp"

namespace knothe::service {
namespace fs = std::filesystem;

namespace {

fs::path refinement_of(const std::string& journal) {
  return fs::path(journal).replace_extension(".refinement");
}

}  // namespace

LogbookEntry entry_of(const Verification& v) {
  const nlohmann::json text = {{"version", v.version},     {"base", v.base},   {"runs", v.runs},
                               {"moved_std", v.moved_std}, {"model", v.model}, {"thorough", v.thorough},
                               {"trouble", v.trouble}};
  return {0,
          EntryKind::verification,
          static_cast<std::int64_t>(v.version),
          v.time,
          "knothe",
          text.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace),
          0};
}

std::optional<Verification> verification_of(const LogbookEntry& entry) {
  if (entry.kind != EntryKind::verification) return std::nullopt;
  const nlohmann::json text = nlohmann::json::parse(entry.text, nullptr, false);
  if (!text.is_object()) return std::nullopt;
  try {
    Verification v;
    text.at("version").get_to(v.version);
    text.at("base").get_to(v.base);
    text.at("model").get_to(v.model);
    text.at("runs").get_to(v.runs);
    text.at("moved_std").get_to(v.moved_std);
    text.at("thorough").get_to(v.thorough);
    text.at("trouble").get_to(v.trouble);
    v.time = entry.time;
    return v;
  } catch (const nlohmann::json::exception&) {  // not written by a knothe that this one knows
    return std::nullopt;
  }
}

std::string text_of(const Verification& v) {
  if (!v.trouble.empty()) return v.trouble;
  const std::string runs = fmt::format("{} full-order run{}", v.runs, v.runs == 1 ? "" : "s");
  if (v.version == 0) return "the full-order model had nothing to add";
  return fmt::format("{}: model version {}; this moved the means by at most {:.2g} standard deviations", runs,
                     v.version, v.moved_std);
}

Verification last_verification(std::span<const LogbookEntry> entries, const std::string& base) {
  Verification last;
  last.base = base;
  for (const LogbookEntry& entry : entries)
    if (auto found = verification_of(entry); found && found->base == base) last = std::move(*found);
  return last;
}

bool awaits_verification(std::span<const LogbookEntry> entries) {
  bool awaits = false;
  for (const LogbookEntry& entry : entries) {
    const auto found = verification_of(entry);
    if (entry.kind == EntryKind::test_finished || entry.kind == EntryKind::verification_asked) awaits = true;
    if (entry.kind == EntryKind::test_resumed || (found && found->thorough)) awaits = false;
  }
  return awaits;
}

std::string refinement_folder(const std::string& journal, const std::string& base) {
  return (refinement_of(journal) / base.substr(0, 16)).string();
}

void require_no_refinement(const std::string& from, const std::string& to) {
  const fs::path target = refinement_of(to);
  if (fs::exists(refinement_of(from)) && fs::exists(target) && !fs::equivalent(refinement_of(from), target))
    throw UsageError(
        fmt::format("{}: is there already, of another journal; give a new name", target.string()));
}

void copy_refinement(const std::string& from, const std::string& to) {
  const fs::path source = refinement_of(from), target = refinement_of(to);
  if (!fs::exists(source) || (fs::exists(target) && fs::equivalent(source, target))) return;
  for (const auto& file : fs::recursive_directory_iterator(source)) {
    if (!file.is_regular_file() || file.path().extension() == ".part") continue;  // still being written
    files::write_atomically(target / file.path().lexically_relative(source),
                            [&](const std::string& temporary) { fs::copy_file(file, temporary); });
  }
}

}  // namespace knothe::service
