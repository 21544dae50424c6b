#pragma once
/// @file The data that a verdict is of.
#include <algorithm>
#include <functional>
#include <optional>
#include <span>

#include "knothe/likelihood/data/data_set.hpp"

namespace knothe::assimilation {

/// All data that are still to be explained, in the order of the steps; the last of them are at hand. Looks at
/// data of others.
class AssessedData {
 public:
  /// All are at hand.
  explicit AssessedData(std::span<const likelihood::DatumPointer> all) : recent_(all) {}
  /// Those of `all` of steps in [`from`, `to`], of which `recent` are the last.
  AssessedData(std::span<const likelihood::DatumPointer> recent, const likelihood::DataSet& all,
               std::size_t from, std::size_t to);

  [[nodiscard]] bool empty() const { return recent_.empty(); }
  [[nodiscard]] std::size_t last_step() const { return recent_.back()->step; }
  /// The last `count` that are at hand, or as many as are.
  [[nodiscard]] std::span<const likelihood::DatumPointer> last(std::size_t count) const {
    return recent_.last(std::min(count, recent_.size()));
  }
  /// Those of steps > `after`, or all.
  void for_each(std::optional<std::size_t> after,
                const std::function<void(const likelihood::DatumPointer&)>& visit) const;
  /// The step that is `places` after the first.
  [[nodiscard]] std::optional<std::size_t> step_after(std::size_t places) const;

 private:
  std::span<const likelihood::DatumPointer> recent_;
  const likelihood::DataSet* all_ = nullptr;  ///< null: all are at hand
  std::size_t from_ = 0;
};

}  // namespace knothe::assimilation
