#include "knothe/likelihood/data/data_set.hpp"

#include <fmt/format.h>

#include <utility>

#include "knothe/base/error.hpp"

namespace knothe::likelihood {

bool DataSet::add(DatumPointer datum) {
  if (contains(datum->step, datum->key)) return false;
  if (const DatumPointer other = last(datum->step); other && other->time_index != datum->time_index)
    throw UsageError(fmt::format("step {}: its data are of model time {}, not {}", datum->step,
                                 other->time_index, datum->time_index));
  Step& step = steps_[datum->step];
  const DatumKey& key = datum->key;
  step.emplace(key, std::move(datum));
  return true;
}

bool DataSet::withdraw(std::size_t step, const DatumKey& key) {
  const auto found = steps_.find(step);
  if (found == steps_.end() || found->second.erase(key) == 0) return false;
  if (found->second.empty()) steps_.erase(found);
  return true;
}

std::vector<std::size_t> DataSet::step_numbers() const {
  std::vector<std::size_t> numbers;
  for (const auto& [number, step] : steps_) numbers.push_back(number);
  return numbers;
}

bool DataSet::contains(std::size_t step, const DatumKey& key) const {
  const auto found = steps_.find(step);
  return found != steps_.end() && found->second.contains(key);
}

std::size_t DataSet::count(std::size_t step) const {
  const auto found = steps_.find(step);
  return found == steps_.end() ? 0 : found->second.size();
}

std::optional<std::size_t> DataSet::last_step() const {
  if (steps_.empty()) return std::nullopt;
  return steps_.rbegin()->first;
}

DatumPointer DataSet::last(std::size_t step) const {
  const auto found = steps_.find(step);
  return found == steps_.end() ? nullptr : found->second.rbegin()->second;
}

std::vector<DatumPointer> DataSet::between(std::optional<std::size_t> after, std::size_t step) const {
  std::vector<DatumPointer> data;
  for (auto it = after ? steps_.upper_bound(*after) : steps_.begin(); it != steps_.end() && it->first <= step;
       ++it)
    for (const auto& [key, datum] : it->second) data.push_back(datum);
  return data;
}

std::vector<DatumPointer> DataSet::all() const {
  return steps_.empty() ? std::vector<DatumPointer>() : between(std::nullopt, steps_.rbegin()->first);
}

}  // namespace knothe::likelihood
