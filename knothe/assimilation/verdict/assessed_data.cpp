#include "knothe/assimilation/verdict/assessed_data.hpp"

#include <algorithm>

namespace knothe::assimilation {

using likelihood::DatumPointer;

AssessedData::AssessedData(std::span<const DatumPointer> recent, const likelihood::DataSet& all,
                           std::size_t from, std::size_t to)
    : recent_(recent), all_(&all), from_(from) {
  while (!recent_.empty() && recent_.front()->step < from) recent_ = recent_.subspan(1);
  while (!recent_.empty() && recent_.back()->step > to) recent_ = recent_.first(recent_.size() - 1);
}

void AssessedData::for_each(std::optional<std::size_t> after,
                            const std::function<void(const DatumPointer&)>& visit) const {
  if (empty()) return;
  if (all_ != nullptr) {
    if (from_ > 0) after = std::max(from_ - 1, after.value_or(0));
    return all_->for_each(after, last_step(), visit);
  }
  for (const DatumPointer& datum : recent_)
    if (!after || datum->step > *after) visit(datum);
}

std::optional<std::size_t> AssessedData::step_after(std::size_t places) const {
  if (all_ != nullptr) {
    const auto step = all_->step_after(from_, places);
    return !empty() && step && *step <= last_step() ? step : std::nullopt;
  }
  for (std::size_t k = 0; k < recent_.size(); ++k) {
    const bool is_new = k == 0 || recent_[k]->step != recent_[k - 1]->step;
    if (is_new && places-- == 0) return recent_[k]->step;
  }
  return std::nullopt;
}

}  // namespace knothe::assimilation
