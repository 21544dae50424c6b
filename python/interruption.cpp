#include "python/interruption.hpp"

#include <unistd.h>

#include <csignal>

#include "knothe/base/cancellation.hpp"

namespace knothe::python {
namespace {

// A signal handler has nothing but globals to speak through; the main thread alone writes them.
int g_depth = 0;  // of calls from callbacks of calls
struct sigaction g_before {};

void on_interrupt(int number) {
  request_cancellation();
  if (g_before.sa_handler != SIG_DFL) g_before.sa_handler(number);
}

}  // namespace

InterruptibleCall::InterruptibleCall() {
  if (getpid() != gettid()) return;
  active_ = true;
  if (g_depth++ > 0) return;
  sigaction(SIGINT, nullptr, &g_before);
  // Ignored, as in a job of the background, or another's own way of telling: left as it is.
  if (g_before.sa_handler == SIG_IGN || (g_before.sa_flags & SA_SIGINFO) != 0) return;
  struct sigaction action {};
  action.sa_handler = on_interrupt;
  sigemptyset(&action.sa_mask);
  action.sa_flags = g_before.sa_flags;
  sigaction(SIGINT, &action, nullptr);
}

InterruptibleCall::~InterruptibleCall() {
  if (!active_ || --g_depth > 0) return;
  sigaction(SIGINT, &g_before, nullptr);
  request_cancellation(false);
}

}  // namespace knothe::python
