#include "knothe/assimilation/verdict/verdict.hpp"

#include <fmt/format.h>

#include <algorithm>

namespace knothe::assimilation {

const VerdictReason* Verdict::misfit() const {
  const auto found = std::find_if(reasons.begin(), reasons.end(), [](const VerdictReason& reason) {
    return reason.part == VerdictPart::fit && !reason.is_about_noise;
  });
  return found == reasons.end() ? nullptr : &*found;
}

void Verdict::add(VerdictReason reason) {
  level = std::max(level, reason.level);
  reasons.push_back(std::move(reason));
}

Verdict RunVerdict::verdict() const {
  if (verdicts_.empty()) return {};
  Verdict run = verdicts_.back();
  run.reasons.clear();
  const std::size_t last = std::max<std::size_t>(1, verdicts_.size() / 10);
  for (std::size_t k = 0; k < last; ++k) {
    const auto of_later_steps = std::ssize(run.reasons);
    for (const VerdictReason& reason : verdicts_[verdicts_.size() - 1 - k].reasons) {
      const auto end = run.reasons.begin() + of_later_steps;
      const bool known = std::any_of(run.reasons.begin(), end, [&](const VerdictReason& other) {
        return other.part == reason.part && other.cause == reason.cause && other.level >= reason.level;
      });
      if (!known) run.add(reason);
    }
  }
  return run;
}

void RunVerdict::forget_model() {
  for (Verdict& verdict : verdicts_) {
    std::erase_if(verdict.reasons,
                  [](const VerdictReason& reason) { return reason.part != VerdictPart::outlier; });
    verdict.level = VerdictLevel::ok;
    for (const VerdictReason& reason : verdict.reasons) verdict.level = std::max(verdict.level, reason.level);
  }
}

std::string verdict_text(const Verdict& verdict) {
  std::string text = verdict.level == VerdictLevel::ok ? "Result: usable (verdict: ok)"
                     : verdict.level == VerdictLevel::caution
                         ? "Result: usable with caveats (verdict: caution)"
                         : "Result: do not use (verdict: reject)";
  for (const VerdictReason& reason : verdict.reasons)
    text += fmt::format("\n  {} ({}): {}", to_text(reason.part), to_text(reason.level), reason.message);
  return text;
}

}  // namespace knothe::assimilation
