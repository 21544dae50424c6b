#include "knothe/base/threads.hpp"

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>

namespace knothe {

std::size_t default_threads() {
  if (const char* text = std::getenv("KNOTHE_THREADS")) {
    const long wanted = std::strtol(text, nullptr, 10);
    if (wanted > 0) return wanted;
  }
  return std::max<std::size_t>(1, std::thread::hardware_concurrency());
}

void parallel_for(std::size_t count, std::size_t threads, const std::function<void(std::size_t)>& body) {
  if (threads == 0) threads = default_threads();
  threads = std::min(threads, count);
  if (threads <= 1) {
    for (std::size_t i = 0; i < count; ++i) body(i);
    return;
  }
  std::atomic<std::size_t> next{0};
  // Of several errors the one of the smallest i, whichever came first: indices are handed out in order, so
  // all before a failing one are done too, and what is told does not depend on the threads.
  std::exception_ptr error;
  std::size_t error_at = count;
  std::mutex error_mutex;
  const auto work = [&] {
    for (std::size_t i = next++; i < count; i = next++) {
      try {
        body(i);
      } catch (...) {
        const std::lock_guard lock(error_mutex);
        if (i < error_at) {
          error_at = i;
          error = std::current_exception();
        }
        next = count;
      }
    }
  };
  {
    std::vector<std::jthread> team;
    team.reserve(threads - 1);
    for (std::size_t k = 1; k < threads; ++k) team.emplace_back(work);
    work();
  }
  if (error) std::rethrow_exception(error);
}

}  // namespace knothe
