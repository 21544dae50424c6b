#include "knothe/assimilation/update/structure_changes.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>

#include "knothe/assimilation/monitor/model_supervision.hpp"

namespace knothe::assimilation {

StructureChanges::StructureChanges(const UpdateOptions& options)
    : forgetting_(options.forgetting),
      retention_(options.change_retention),
      on_alarm_(options.restart_on_alarm),
      known_(options.change_points) {}

bool StructureChanges::possible() const {
  return forgetting_ < 1 || !known_.empty() || on_alarm_;
}

bool StructureChanges::before(std::size_t step) const {
  const auto is_in = [&](const std::vector<std::size_t>& steps) {
    return std::find(steps.begin(), steps.end(), step) != steps.end();
  };
  return is_in(known_) || is_in(found_);
}

double StructureChanges::power_before(std::size_t step) const {
  return before(step) ? retention_ : forgetting_;
}

std::size_t StructureChanges::count_forgotten(std::span<const std::size_t> steps) const {
  double weight = 1;
  std::size_t count = steps.size();
  while (count > 0 && weight >= 0.5) {
    --count;
    if (count > 0 && steps[count - 1] != steps[count]) weight *= power_before(steps[count]);
  }
  return count;
}

std::string StructureChanges::notice(const std::string& alarm, std::size_t onset,
                                     const std::string& more) const {
  return fmt::format("{}; treated as a change of the structure at step {}: the data before it count {}{}{}",
                     alarm, onset,
                     retention_ > 0 ? fmt::format("with the power {:g}", retention_)
                                    : "no longer, the posterior restarted from the prior",
                     more.empty() ? "" : "; ", more);
}

void StructureChanges::restart() {
  found_.clear();
  saved_.clear();
}

void StructureChanges::save(std::size_t step, const likelihood::FormSums& sums) {
  saved_.insert_or_assign(step, Saved{sums, found_});
  if (saved_.size() > ModelSupervision::k_remembered) saved_.erase(saved_.begin());
}

likelihood::FormSums StructureChanges::restore(std::size_t step) {
  const auto it = saved_.find(step);
  assert(it != saved_.end());
  likelihood::FormSums sums = std::move(it->second.sums);
  found_ = std::move(it->second.found);
  saved_.erase(it, saved_.end());
  return sums;
}

}  // namespace knothe::assimilation
