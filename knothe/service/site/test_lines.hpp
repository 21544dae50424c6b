#pragma once
/// @file The lines of tests that do not run now: their journals, seen by the model of the one that does.
#include <atomic>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "knothe/service/site/served_site.hpp"

namespace knothe::service {

/// For one thread.
class TestLines {
 public:
  /// From any thread: what is being computed ends soon.
  void stop() { stopping_ = true; }
  /// The lines of the steps ≥ `from` (docs/reference/formats.md, without densities) as a JSON array. Computed
  /// once, until its journal or the model changes. RequestError 404 where there is no such test, 409 where
  /// its data are of other sensors or times, or its journal is damaged.
  std::string lines_of(const ServedSite& served, const std::string& test, std::size_t from);

 private:
  struct Kept {
    std::string of;                                          ///< what they were computed from
    std::vector<std::pair<std::size_t, std::string>> lines;  ///< by step
  };
  std::atomic<bool> stopping_{false};
  static constexpr std::size_t k_max_tests = 8;               ///< tests kept
  std::map<std::pair<std::string, std::string>, Kept> kept_;  ///< by site and test
};

}  // namespace knothe::service
