#pragma once
/// @file The tests of a structure as files. Each has a journal of its own, NAME.TEST.journal beside
/// NAME.journal, the journal of the unnamed test.
#include <string>
#include <string_view>
#include <vector>

namespace knothe::service {

/// Why a test cannot have this name, in words; empty: it can.
[[nodiscard]] std::string objection_to_test_name(std::string_view name);

/// The test "NAME", or the unnamed test.
[[nodiscard]] std::string test_in_words(const std::string& name);

/// In all that follows `journal` is that of the unnamed test, as [serve] journal has it.
[[nodiscard]] std::string journal_of_test(const std::string& journal, const std::string& test);

/// The tests whose journals are there, in the order of their names; the unnamed one is the first.
[[nodiscard]] std::vector<std::string> tests_beside(const std::string& journal);

/// The test to be served where `test` is asked for: it, or the last of those that have followed it in a
/// running service. A journal that cannot be read is followed by none: who opens it says why. DataError where
/// a journal is missing of those that the others tell of: a new, empty one must not take its name.
[[nodiscard]] std::string last_to_follow(const std::string& journal, const std::string& test);

}  // namespace knothe::service
