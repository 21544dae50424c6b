#pragma once
/// @file Parallel loops whose results do not depend on the number of threads.
#include <cstddef>
#include <functional>

namespace knothe {

/// Number of threads to use when the caller says 0: the machine's, or KNOTHE_THREADS.
[[nodiscard]] std::size_t default_threads();

/// Calls `body(i)` for i in [0, count), spread over `threads` threads (0: `default_threads()`). Each i is
/// done exactly once; which thread does it is open, so a body writes only to what belongs to its own i, and a
/// sum over i is taken afterwards, in order. If bodies throw, the exception of the smallest such i is
/// rethrown here, after all have ended; bodies after it may not have been called.
void parallel_for(std::size_t count, std::size_t threads, const std::function<void(std::size_t)>& body);

}  // namespace knothe
