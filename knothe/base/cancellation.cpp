#include "knothe/base/cancellation.hpp"

#include <atomic>
#include <csignal>

#include "knothe/base/error.hpp"

namespace knothe {
namespace {

// A signal handler has nothing but globals to speak through; a lock-free atomic is the one it may touch.
std::atomic<bool> g_requested{false};

void on_signal(int number) {
  if (g_requested.exchange(true)) {
    std::signal(number, SIG_DFL);
    std::raise(number);
  }
}

}  // namespace

bool cancellation_requested() noexcept {
  return g_requested.load(std::memory_order_relaxed);
}

void request_cancellation(bool stop) noexcept {
  g_requested.store(stop);
}

void install_signal_handlers() {
  struct sigaction action {};
  action.sa_handler = on_signal;
  sigemptyset(&action.sa_mask);
  action.sa_flags = SA_RESTART;
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
  // The terminal has gone; `nohup` has the program go on.
  struct sigaction before {};
  if (sigaction(SIGHUP, nullptr, &before) == 0 && before.sa_handler != SIG_IGN)
    sigaction(SIGHUP, &action, nullptr);
}

void check_cancellation(const std::string& saved) {
  if (cancellation_requested()) throw Interrupted("interrupted; " + saved);
}

}  // namespace knothe
