#include "knothe/base/progress.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>

namespace knothe {

Progress::Progress(std::string label, std::size_t total, bool quiet)
    : label_(std::move(label)),
      total_(std::max<std::size_t>(total, 1)),
      quiet_(quiet),
      terminal_(isatty(STDERR_FILENO) == 1),
      start_(Clock::now()),
      last_shown_(start_) {}

Progress::~Progress() {
  if (!quiet_ && shown_) show({}, true);
}

void Progress::advance_to(std::size_t done, const std::string& detail) {
  done_ = std::min(done, total_);
  if (quiet_) return;
  const auto interval = terminal_ ? std::chrono::milliseconds(100) : std::chrono::milliseconds(10'000);
  const auto now = Clock::now();
  if (now - last_shown_ < interval && !(terminal_ && shown_ && done_ == total_)) return;
  last_shown_ = now;
  show(detail, false);
}

void Progress::show(const std::string& detail, bool last) {
  const double elapsed = std::chrono::duration<double>(Clock::now() - start_).count();
  const double fraction = 1.0 * done_ / total_;
  const double left = fraction > 0 ? elapsed * (1 - fraction) / fraction : 0;
  const std::string time = last ? fmt::format("{:.1f} s", elapsed) : fmt::format("{:.0f} s left", left);
  std::string line;
  if (terminal_) {
    constexpr int k_width = 30;
    const int filled = fraction * k_width;
    line = fmt::format("\r\033[K{} [{}{}] {}/{}  {}  {}{}", label_, std::string(filled, '#'),
                       std::string(k_width - filled, ' '), done_, total_, time, detail, last ? "\n" : "");
  } else {
    line =
        fmt::format("{}: {}/{}, {}{}{}\n", label_, done_, total_, time, detail.empty() ? "" : ", ", detail);
  }
  std::fputs(line.c_str(), stderr);
  std::fflush(stderr);
  shown_ = true;
}

}  // namespace knothe
