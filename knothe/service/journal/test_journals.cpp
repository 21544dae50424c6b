#include "knothe/service/journal/test_journals.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <optional>
#include <set>

#include "knothe/base/error.hpp"
#include "knothe/service/journal/journal.hpp"

namespace knothe::service {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t k_longest_name = 64;
constexpr std::string_view k_letters = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-_";

}  // namespace

std::string objection_to_test_name(std::string_view name) {
  if (name.empty()) return "a test's name must not be empty";
  if (name.size() > k_longest_name)
    return fmt::format("a test's name has at most {} characters, not {}", k_longest_name, name.size());
  if (name.find_first_not_of(k_letters) != std::string_view::npos)
    return fmt::format("\"{}\": a test's name has letters, digits, '-' and '_' only", name);
  return "";
}

std::string test_in_words(const std::string& name) {
  return name.empty() ? "the unnamed test" : fmt::format("the test \"{}\"", name);
}

std::string journal_of_test(const std::string& journal, const std::string& test) {
  if (test.empty()) return journal;
  fs::path path(journal);
  const std::string extension = path.extension().string();
  return path.replace_extension(fmt::format(".{}{}", test, extension)).string();
}

std::vector<std::string> tests_beside(const std::string& journal) {
  const fs::path first(journal);
  const std::string name = first.stem().string() + ".", extension = first.extension().string();
  std::vector<std::string> tests;
  std::error_code error;
  if (fs::exists(first, error)) tests.emplace_back();
  for (const auto& entry : fs::directory_iterator(fs::absolute(first).parent_path(), error)) {
    const std::string file = entry.path().filename().string();
    if (file.size() <= name.size() + extension.size() || !file.starts_with(name) ||
        !file.ends_with(extension))
      continue;
    std::string test = file.substr(name.size(), file.size() - name.size() - extension.size());
    if (objection_to_test_name(test).empty()) tests.push_back(std::move(test));
  }
  std::sort(tests.begin(), tests.end());
  return tests;
}

namespace {

/// What a journal that cannot be read says of its course: nothing. Who opens it says why.
JournalGlance glance_if_readable(const std::string& path) {
  try {
    return glance_at_journal(path);
  } catch (const Error&) {
    return {};
  }
}

/// The last of those that have followed `test`. DataError where one of them has lost its journal.
std::string end_of_chain(const std::string& journal, std::string test) {
  std::set<std::string> seen;
  while (seen.insert(test).second) {
    const std::string path = journal_of_test(journal, test);
    const auto next = glance_if_readable(path).followed_by;
    if (!next) break;
    if (!fs::exists(journal_of_test(journal, *next)))
      throw DataError(
          fmt::format("{}: is missing, the journal of {}, which took the place of {} ({}): put it back, or "
                      "say which test "
                      "is served (knothe serve --test NAME)",
                      journal_of_test(journal, *next), test_in_words(*next), test_in_words(test), path));
    test = *next;
  }
  return test;
}

/// A test that goes on, was begun in a running service, and of which no journal tells what came before: the
/// journal that did is gone.
std::optional<std::string> test_without_its_past(const std::string& journal) {
  std::map<std::string, JournalGlance> known;
  std::set<std::string> followers;
  for (const std::string& test : tests_beside(journal)) {
    const JournalGlance& glance = known[test] = glance_if_readable(journal_of_test(journal, test));
    if (glance.followed_by) followers.insert(*glance.followed_by);
  }
  for (const auto& [test, glance] : known) {
    if (glance.begun_ms == 0 || !glance.is_used || followers.contains(test)) continue;
    const std::string last = end_of_chain(journal, test);
    if (!known[last].finished) return last;
  }
  return std::nullopt;
}

}  // namespace

std::string last_to_follow(const std::string& journal, const std::string& test) {
  const std::string path = journal_of_test(journal, test);
  if (fs::exists(path)) return end_of_chain(journal, test);
  if (const auto other = test_without_its_past(journal))
    throw DataError(
        fmt::format("{}: is missing, and {} goes on, which was begun after it: put it back, or "
                    "serve that one (knothe serve --test {})",
                    path, test_in_words(*other), other->empty() ? "\"\"" : *other));
  return test;
}

}  // namespace knothe::service
