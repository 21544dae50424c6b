#include "knothe/likelihood/data/data_set.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <string_view>
#include <utility>

#include "knothe/base/error.hpp"

namespace knothe::likelihood {
namespace {

template <class T>
void put(std::string& bytes, const T& value) {
  bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
}

void put_text(std::string& bytes, const std::string& text) {
  put(bytes, text.size());
  bytes += text;
}

/// Of bytes that this process wrote.
struct Reading {
  std::string_view bytes;

  template <class T>
  T get() {
    T value;
    std::memcpy(&value, bytes.data(), sizeof value);
    bytes.remove_prefix(sizeof value);
    return value;
  }
  std::string get_text() {
    const auto size = get<std::size_t>();
    std::string text(bytes.substr(0, size));
    bytes.remove_prefix(size);
    return text;
  }
};

std::string bytes_of(const std::map<DatumKey, DatumPointer>& data) {
  std::string bytes;
  for (const auto& [key, datum] : data) {
    put_text(bytes, key.source);
    put_text(bytes, key.session);
    put(bytes, key.seq);
    put(bytes, datum->time_index);
    put(bytes, datum->values.size());
    bytes.append(reinterpret_cast<const char*>(datum->values.data()), datum->values.size() * sizeof(double));
  }
  return bytes;
}

bool has_own_noise(const std::map<DatumKey, DatumPointer>& data) {
  return std::any_of(data.begin(), data.end(),
                     [](const auto& datum) { return datum.second->noise.has_value(); });
}

Datum datum_of(Reading& reading, std::size_t step) {
  Datum datum;
  datum.key.source = reading.get_text();
  datum.key.session = reading.get_text();
  datum.key.seq = reading.get<std::int64_t>();
  datum.step = step;
  datum.time_index = reading.get<std::size_t>();
  datum.values.resize(reading.get<Eigen::Index>());
  const std::size_t size = datum.values.size() * sizeof(double);
  std::memcpy(datum.values.data(), reading.bytes.data(), size);
  reading.bytes.remove_prefix(size);
  return datum;
}

}  // namespace

DataSet::Entries::const_iterator DataSet::first_from(std::size_t step) const {
  return std::lower_bound(entries_.begin(), entries_.end(), step,
                          [](const Entry& entry, std::size_t s) { return entry.step < s; });
}

const DataSet::Entry* DataSet::find(std::size_t step) const {
  const auto it = first_from(step);
  return it == entries_.end() || it->step != step ? nullptr : &*it;
}

/// Those in memory, or those of the file.
DataSet::Step DataSet::data_of(const Entry& entry) const {
  if (const auto it = resident_.find(entry.step); it != resident_.end()) return it->second;
  const auto bytes = archive_->file.read(entry.offset, entry.size);
  if (!bytes)
    throw IoError(fmt::format("{}: the data of step {} cannot be read again: {}", archive_->file.folder(),
                              entry.step, std::strerror(errno)));
  Step data;
  for (Reading reading{*bytes}; !reading.bytes.empty();) {
    auto datum = std::make_shared<const Datum>(datum_of(reading, entry.step));
    data.emplace(datum->key, std::move(datum));
  }
  return data;
}

/// To be changed: what is in the file is no longer the step's.
DataSet::Step& DataSet::make_resident(std::size_t step) {
  auto it = entries_.begin() + (first_from(step) - entries_.cbegin());
  if (it == entries_.end() || it->step != step) {
    it = entries_.emplace(it);
    it->step = step;
  } else if (!resident_.contains(step)) {
    resident_.emplace(step, data_of(*it));
  }
  it->offset = -1;
  return resident_[step];
}

bool DataSet::add(DatumPointer datum) {
  const std::size_t number = datum->step;
  if (contains(number, datum->key)) return false;
  if (const DatumPointer other = last(number); other && other->time_index != datum->time_index)
    throw UsageError(fmt::format("step {}: its data are of model time {}, not {}", number, other->time_index,
                                 datum->time_index));
  Step& step = make_resident(number);
  const DatumKey& key = datum->key;
  step.emplace(key, std::move(datum));
  entries_[first_from(number) - entries_.cbegin()].count = step.size();
  return true;
}

bool DataSet::withdraw(std::size_t number, const DatumKey& key) {
  if (!contains(number, key)) return false;
  Step& step = make_resident(number);
  step.erase(key);
  const auto entry = first_from(number);
  if (!step.empty()) {
    entries_[entry - entries_.cbegin()].count = step.size();
    return true;
  }
  resident_.erase(number);
  entries_.erase(entry);
  return true;
}

std::vector<std::size_t> DataSet::step_numbers() const {
  std::vector<std::size_t> numbers;
  for (const Entry& entry : entries_) numbers.push_back(entry.step);
  return numbers;
}

bool DataSet::contains(std::size_t step, const DatumKey& key) const {
  const Entry* entry = find(step);
  return entry != nullptr && data_of(*entry).contains(key);
}

std::size_t DataSet::count(std::size_t step) const {
  const Entry* entry = find(step);
  return entry == nullptr ? 0 : entry->count;
}

std::optional<std::size_t> DataSet::last_step() const {
  if (entries_.empty()) return std::nullopt;
  return entries_.back().step;
}

std::optional<std::size_t> DataSet::step_from(std::size_t step) const {
  return step_after(step, 0);
}

std::optional<std::size_t> DataSet::step_after(std::size_t from, std::size_t places) const {
  const auto first = first_from(from);
  if (std::cmp_greater_equal(places, entries_.end() - first)) return std::nullopt;
  return (first + places)->step;
}

std::size_t DataSet::step_of_last(std::size_t count, std::size_t step) const {
  auto it = first_from(step + 1);
  for (std::size_t found = 0; it != entries_.begin() && found < count;) found += (--it)->count;
  return it == entries_.end() ? step : it->step;
}

DatumPointer DataSet::last(std::size_t step) const {
  const Entry* entry = find(step);
  return entry == nullptr ? nullptr : data_of(*entry).rbegin()->second;
}

std::vector<DatumPointer> DataSet::at(std::size_t step) const {
  std::vector<DatumPointer> data;
  if (const Entry* entry = find(step))
    for (const auto& [key, datum] : data_of(*entry)) data.push_back(datum);
  return data;
}

void DataSet::for_each(std::optional<std::size_t> after, std::size_t step,
                       const std::function<void(const DatumPointer&)>& visit) const {
  for (auto it = after ? first_from(*after + 1) : entries_.begin(); it != entries_.end() && it->step <= step;
       ++it)
    for (const auto& [key, datum] : data_of(*it)) visit(datum);
}

std::vector<DatumPointer> DataSet::between(std::optional<std::size_t> after, std::size_t step) const {
  std::vector<DatumPointer> data;
  for_each(after, step, [&](const DatumPointer& datum) { data.push_back(datum); });
  return data;
}

std::vector<DatumPointer> DataSet::all() const {
  return entries_.empty() ? std::vector<DatumPointer>() : between(std::nullopt, entries_.back().step);
}

bool DataSet::put_away(Entry& entry, const Step& data) {
  if (entry.offset >= 0) return true;
  const std::string bytes = bytes_of(data);
  if (!archive_->file.write(bytes, archive_->end)) return false;
  entry.offset = archive_->end;
  entry.size = bytes.size();
  archive_->end += entry.size;
  return true;
}

void DataSet::keep_in_memory(std::size_t from, std::size_t to) {
  bool writable = archive_ != nullptr;
  std::erase_if(resident_, [&](const auto& step) {
    if (!writable || (step.first >= from && step.first <= to) || has_own_noise(step.second)) return false;
    return writable = put_away(entries_[first_from(step.first) - entries_.cbegin()], step.second);
  });
}

}  // namespace knothe::likelihood
