#include "knothe/numerics/statistics/weighted_statistics.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "knothe/base/error.hpp"
#include "knothe/numerics/integrate/sobol.hpp"

namespace knothe::numerics {

void WeightedQuantiles::compute(std::span<const double> values, std::span<const double> weights,
                                std::span<const double> levels, std::span<double> quantiles) {
  constexpr int k_bins = 512;
  if (values.empty() || values.size() != weights.size() || levels.size() != quantiles.size())
    throw UsageError(
        fmt::format("weighted quantiles: {} values, {} weights, {} levels, room for {} quantiles",
                    values.size(), weights.size(), levels.size(), quantiles.size()));
  double low = 0, high = 0, total = 0;
  for (std::size_t i = 0; i < values.size(); ++i) {  // points without weight do not count
    if (!(weights[i] > 0)) continue;
    low = total == 0 ? values[i] : std::min(low, values[i]);
    high = total == 0 ? values[i] : std::max(high, values[i]);
    total += weights[i];
  }
  if (!(total > 0)) throw UsageError("weighted quantiles: no weight is positive");
  bins_.assign(k_bins, Bin{});
  const double scale = high > low ? k_bins / (high - low) : 0;
  const auto bin_of = [&](double x) { return std::min(k_bins - 1, static_cast<int>((x - low) * scale)); };
  for (std::size_t i = 0; i < values.size(); ++i)
    if (weights[i] > 0) {
      Bin& bin = bins_[static_cast<std::size_t>(bin_of(values[i]))];
      bin.weight += weights[i];
      ++bin.count;
    }
  int begin = 0;
  for (Bin& bin : bins_) bin.begin = bin.fill = begin, begin += bin.count;
  entries_.resize(static_cast<std::size_t>(begin));
  for (std::size_t i = 0; i < values.size(); ++i)
    if (weights[i] > 0)
      entries_[static_cast<std::size_t>(bins_[static_cast<std::size_t>(bin_of(values[i]))].fill++)] = {
          values[i], weights[i] / total};

  const auto sort_bin = [&](Bin& bin) {
    if (bin.sorted) return;
    std::sort(entries_.begin() + bin.begin, entries_.begin() + bin.begin + bin.count);
    bin.sorted = true;
  };
  for (std::size_t q = 0; q < levels.size(); ++q) {
    double before = 0;  // weight of the bins below
    std::size_t at = 0;
    for (; at + 1 < bins_.size(); ++at) {
      if (before + bins_[at].weight / total >= levels[q]) break;
      before += bins_[at].weight / total;
    }
    // Walk over the entries from the last nonempty bin below to the first beyond the level; remember the
    // point before.
    std::size_t first = at;
    while (first > 0) {
      --first;
      if (bins_[first].count > 0) {
        before -= bins_[first].weight / total;
        break;
      }
    }
    double cumulative = before, previous_c = 0, previous_value = 0, result = high;
    bool have_previous = false, found = false;
    for (std::size_t k = first; k < bins_.size() && !found; ++k) {
      sort_bin(bins_[k]);
      for (int e = bins_[k].begin; e < bins_[k].begin + bins_[k].count; ++e) {
        const Entry& entry = entries_[static_cast<std::size_t>(e)];
        const double c = cumulative + 0.5 * entry.weight;
        if (c >= levels[q]) {
          result = !have_previous ? entry.value
                                  : previous_value +
                                        (entry.value - previous_value) *
                                            std::clamp((levels[q] - previous_c) / (c - previous_c), 0.0, 1.0);
          found = true;
          break;
        }
        cumulative += entry.weight;
        previous_c = c;
        previous_value = entry.value;
        have_previous = true;
      }
    }
    quantiles[q] = result;
  }
}

std::vector<Eigen::Index> equal_draws(const Eigen::Ref<const Eigen::VectorXd>& weights, Eigen::Index count) {
  const std::vector<Eigen::Index> order = reversed_bits(weights.size());
  const double share = weights.sum() / static_cast<double>(count);
  std::vector<Eigen::Index> chosen;
  chosen.reserve(static_cast<std::size_t>(count));
  std::size_t i = 0;
  double passed = weights[order[0]];
  for (Eigen::Index k = 0; k < count; ++k) {
    while (passed < (static_cast<double>(k) + 0.5) * share && i + 1 < order.size())
      passed += weights[order[++i]];
    chosen.push_back(order[i]);
  }
  return chosen;
}

}  // namespace knothe::numerics
