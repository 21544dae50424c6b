#pragma once
/// @file What is remembered of a long sequence of steps, so that one can go back far without beginning anew.
#include <cstddef>
#include <iterator>
#include <map>
#include <utility>

namespace knothe::assimilation {

/// States before some of the steps: the older, the fewer. Of n steps some 10 log n are kept, and whoever goes
/// back by m steps finds one at most m / 3 + 2 `k_apart` before.
template <class State>
class Milestones {
 public:
  static constexpr std::size_t k_apart = 64;  ///< steps between two

  /// Whether the state before `step`, which comes after all that are kept, is to be kept.
  [[nodiscard]] bool wants(std::size_t step) const {
    return kept_.empty() || step >= kept_.rbegin()->first + k_apart;
  }
  void save(std::size_t step, State state) {
    kept_.insert_or_assign(step, std::move(state));
    thin(step);
  }
  /// The last step ≤ `step` and the state before it; null where there is none.
  [[nodiscard]] const std::pair<const std::size_t, State>* last_up_to(std::size_t step) const {
    const auto next = kept_.upper_bound(step);
    return next == kept_.begin() ? nullptr : &*std::prev(next);
  }
  /// The steps from `step` on have changed: the state before it holds, those before later ones do not.
  void forget_after(std::size_t step) { kept_.erase(kept_.upper_bound(step), kept_.end()); }
  void clear() { kept_.clear(); }
  [[nodiscard]] std::size_t size() const { return kept_.size(); }

 private:
  void thin(std::size_t now) {
    constexpr std::size_t k_share = 4;  // of a gap in the age of its beginning
    for (auto it = kept_.begin(); it != kept_.end();) {
      const auto next = std::next(it);
      const bool inner = it != kept_.begin() && next != kept_.end();
      const std::size_t before = inner ? std::prev(it)->first : 0;
      it = inner && next->first - before <= (now - before) / k_share ? kept_.erase(it) : next;
    }
  }

  std::map<std::size_t, State> kept_;
};

}  // namespace knothe::assimilation
