#pragma once
/// @file Long calls from Python: without the interpreter's lock, and ended by Ctrl-C.
#include <pybind11/pybind11.h>

#include <mutex>
#include <utility>

namespace knothe::python {

/// As long as one lives on the main thread, Ctrl-C asks the library to stop (base/cancellation.hpp) besides
/// telling Python, which would hear it only after the call.
class InterruptibleCall {
 public:
  InterruptibleCall();
  ~InterruptibleCall();
  InterruptibleCall(const InterruptibleCall&) = delete;
  InterruptibleCall& operator=(const InterruptibleCall&) = delete;

 private:
  bool active_ = false;
};

/// Makes the call while other threads of Python go on.
template <class Call>
auto long_call(Call&& call) {
  const InterruptibleCall interruptible;
  const pybind11::gil_scoped_release others_go_on;
  return std::forward<Call>(call)();
}

/// The same for a call that changes an object, or reads what others change: one at a time.
template <class Call>
auto long_call(std::mutex& mutex, Call&& call) {
  return long_call([&] {
    const std::lock_guard alone(mutex);
    return call();
  });
}

}  // namespace knothe::python
