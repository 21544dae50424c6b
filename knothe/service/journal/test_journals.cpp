#include "knothe/service/journal/test_journals.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
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

std::string last_to_follow(const std::string& journal, std::string test) {
  std::set<std::string> seen;
  while (seen.insert(test).second) {
    const std::string path = journal_of_test(journal, test);
    std::error_code error;
    if (!fs::exists(path, error)) break;
    try {
      const auto next = glance_at_journal(path).followed_by;
      if (!next) break;
      test = *next;
    } catch (const Error&) {
      break;
    }
  }
  return test;
}

}  // namespace knothe::service
