#pragma once
/// @file Which degrees of a sparse interpolation come next.
#include <set>
#include <span>

#include "knothe/numerics/functions/sparse_interpolation.hpp"

namespace knothe::numerics {

/// Grows the index set of a SparseInterpolation in the directions that matter (T. Gerstner, M. Griebel,
/// Computing 71, 2003). Its indices are *active* at the border of the set, where it may be continued, and
/// *old* behind that. To expand an active index makes it old, and adds those of the d indices above it that
/// have only old ones below them.
class DegreeGrowth {
 public:
  /// Begins with the constant, active. No degree becomes larger than `largest_degree`.
  DegreeGrowth(int dimension, int largest_degree);

  [[nodiscard]] const std::vector<MultiIndex>& indices() const { return indices_; }  ///< as added
  [[nodiscard]] bool is_active(std::size_t place) const { return active_[place]; }
  /// Whether nothing is left to expand.
  [[nodiscard]] bool is_complete() const;
  /// Expands the active indices whose `indicator` [of all indices] is at least half of the largest one; where
  /// all are zero or `evenly` is asked for, those of smallest total degree. The smallest step of which there
  /// is something new: indices with nothing above them become old on the way. Adds at most `room` indices,
  /// of the largest indicators first; an index that had no room above it stays active.
  void expand(std::span<const double> indicator, bool evenly, std::size_t room);
  /// Takes out an active index for good, and with it all above it. UsageError if it is not active.
  void leave_out(std::size_t place);

 private:
  [[nodiscard]] std::vector<std::size_t> chosen(std::span<const double> indicator, bool evenly) const;
  [[nodiscard]] std::vector<MultiIndex> admissible_above(std::size_t place) const;

  int largest_degree_;
  std::vector<MultiIndex> indices_;
  std::vector<bool> active_;
  std::set<MultiIndex> known_, old_;
};

}  // namespace knothe::numerics
