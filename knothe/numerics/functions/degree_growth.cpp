#include "knothe/numerics/functions/degree_growth.hpp"

#include <algorithm>
#include <limits>
#include <numeric>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"

namespace knothe::numerics {

DegreeGrowth::DegreeGrowth(int dimension, int largest_degree) : largest_degree_(largest_degree) {
  if (dimension < 1 || largest_degree < 1)
    throw UsageError("growth of degrees: at least one variable, and degree 1 at least");
  indices_.emplace_back(dimension, 0);
  active_.push_back(true);
  known_.insert(indices_.front());
}

bool DegreeGrowth::is_complete() const {
  return std::find(active_.begin(), active_.end(), true) == active_.end();
}

std::vector<std::size_t> DegreeGrowth::chosen(std::span<const double> indicator, bool evenly) const {
  std::vector<std::size_t> result;
  double largest = 0;
  int smallest = std::numeric_limits<int>::max();
  const auto total = [&](std::size_t n) {
    return std::accumulate(indices_[n].begin(), indices_[n].end(), 0);
  };
  for (Index n = 0; n < std::ssize(indices_); ++n) {
    if (!active_[n]) continue;
    largest = std::max(largest, indicator[n]);
    smallest = std::min(smallest, total(n));
  }
  evenly = evenly || !(largest > 0);
  for (Index n = 0; n < std::ssize(indices_); ++n)
    if (active_[n] && (evenly ? total(n) == smallest : indicator[n] >= 0.5 * largest)) result.push_back(n);
  std::stable_sort(result.begin(), result.end(),
                   [&](std::size_t a, std::size_t b) { return indicator[a] > indicator[b]; });
  return result;
}

std::vector<MultiIndex> DegreeGrowth::admissible_above(std::size_t place) const {
  std::vector<MultiIndex> result;
  for (Index i = 0; i < std::ssize(indices_[place]); ++i) {
    MultiIndex above = indices_[place];
    if (++above[i] > largest_degree_ || known_.count(above) > 0) continue;
    bool complete = true;
    for (Index j = 0; j < std::ssize(above); ++j) {
      if (above[j] == 0) continue;
      MultiIndex below = above;
      --below[j];
      complete = complete && old_.count(below) > 0;
    }
    if (complete) result.push_back(std::move(above));
  }
  return result;
}

void DegreeGrowth::expand(std::span<const double> indicator, bool evenly, std::size_t room) {
  if (indicator.size() != indices_.size())
    throw UsageError("growth of degrees: an indicator for each index is needed");
  const std::size_t before = indices_.size();
  while (!is_complete() && indices_.size() == before && room > 0) {
    const std::vector<std::size_t> now = chosen(indicator, evenly);
    for (const std::size_t n : now) old_.insert(indices_[n]);
    for (const std::size_t n : now) {
      const std::vector<MultiIndex> above = admissible_above(n);
      if (indices_.size() - before + above.size() > room) {
        old_.erase(indices_[n]);
        continue;
      }
      active_[n] = false;
      for (const MultiIndex& index : above) {
        indices_.push_back(index);
        active_.push_back(true);
        known_.insert(index);
      }
    }
    // Nothing fits now: whoever asks for more room may go on from here.
    if (indices_.size() == before &&
        std::any_of(now.begin(), now.end(), [&](std::size_t n) { return active_[n]; }))
      return;
  }
}

void DegreeGrowth::leave_out(std::size_t place) {
  if (place >= indices_.size() || !active_[place])
    throw UsageError("growth of degrees: only an active index can be left out");
  indices_.erase(indices_.begin() + place);  // it stays known
  active_.erase(active_.begin() + place);
}

}  // namespace knothe::numerics
