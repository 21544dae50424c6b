#pragma once
/// @file The data of a test: the one place where measured values live.
#include <compare>
#include <cstddef>
#include <map>
#include <memory>
#include <optional>
#include <vector>

#include "knothe/likelihood/data/datum.hpp"

namespace knothe::likelihood {

/// A datum that several look at; nobody changes it.
using DatumPointer = std::shared_ptr<const Datum>;

/// Owns the data, by step and then by key, in whatever order they came. What is made of data looks at them
/// here.
class DataSet {
 public:
  using Step = std::map<DatumKey, DatumPointer>;

  /// False where one of its key is there at its step already: nothing changes then. UsageError where the
  /// step's data are of another model time.
  bool add(DatumPointer datum);
  /// False where it is not there.
  bool withdraw(std::size_t step, const DatumKey& key);

  [[nodiscard]] const std::map<std::size_t, Step>& steps() const { return steps_; }
  [[nodiscard]] std::vector<std::size_t> step_numbers() const;  ///< with data, increasing
  [[nodiscard]] bool contains(std::size_t step, const DatumKey& key) const;
  [[nodiscard]] std::size_t count(std::size_t step) const;
  [[nodiscard]] std::optional<std::size_t> last_step() const;
  /// The last datum of a step (by key); null without data.
  [[nodiscard]] DatumPointer last(std::size_t step) const;
  /// Those of steps in (`after`, `step`], in order; from the first where `after` is absent.
  [[nodiscard]] std::vector<DatumPointer> between(std::optional<std::size_t> after, std::size_t step) const;
  [[nodiscard]] std::vector<DatumPointer> all() const;

 private:
  std::map<std::size_t, Step> steps_;
};

}  // namespace knothe::likelihood
