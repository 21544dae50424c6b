#pragma once
/// @file One axis of a spline grid, prepared so that a point is found, and its local basis computed, quickly.
#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <vector>

#include "knothe/numerics/functions/cubic_spline.hpp"

namespace knothe::model {

/// The polynomial pieces of a basis, each in its own variable t ∈ [−1, 1].
class SplineAxis {
 public:
  using Piece = std::array<std::array<double, 4>, 4>;  ///< coefficient of t^power, at [power][function]
  struct Place {
    std::size_t piece;
    double t;
  };

  explicit SplineAxis(const numerics::CubicSplineBasis& basis);

  [[nodiscard]] std::size_t size() const { return pieces_.size(); }  ///< number of pieces
  [[nodiscard]] int active() const { return active_; }               ///< functions that act on a piece
  [[nodiscard]] const Piece& piece(std::size_t j) const { return pieces_[j]; }
  [[nodiscard]] double scale(std::size_t j) const { return scale_[j]; }  ///< dt/dx

  /// The piece where x is; x outside the axis counts as its end.
  [[nodiscard]] Place locate(double x) const {
    const double inside = std::clamp(x, breaks_.front(), breaks_.back());
    const double bin = (inside - breaks_.front()) * bins_per_unit_;
    // Not a number stays one: it is found in the first piece.
    std::size_t j = first_piece_[bin > 0 ? std::min<std::size_t>(bin, first_piece_.size() - 1) : 0];
    while (j > 0 && inside < breaks_[j]) --j;
    while (j + 1 < pieces_.size() && inside >= breaks_[j + 1]) ++j;
    return {j, (inside - middle_[j]) * scale_[j]};
  }

  /// The local basis at a place, with derivatives in x up to the order `derivatives`.
  template <int Derivatives>
  void evaluate(const Place& place, numerics::CubicSplineBasis::Local& local) const {
    const Piece& c = pieces_[place.piece];
    const double t = place.t, scale = scale_[place.piece];
    local.first = place.piece;
    // The four functions side by side.
    typedef double Four __attribute__((vector_size(4 * sizeof(double))));
    const auto row = [&](std::size_t power) { return std::bit_cast<Four>(c[power]); };
    const Four c0 = row(0), c1 = row(1), c2 = row(2), c3 = row(3);
    using Functions = std::array<double, 4>;
    local.value = std::bit_cast<Functions>(c0 + t * (c1 + t * (c2 + t * c3)));
    if constexpr (Derivatives >= 1)
      local.first_derivative = std::bit_cast<Functions>(scale * (c1 + t * (2 * c2 + t * (3 * c3))));
    if constexpr (Derivatives >= 2)
      local.second_derivative = std::bit_cast<Functions>(scale * scale * (2 * c2 + t * (6 * c3)));
  }

 private:
  std::vector<double> breaks_, middle_, scale_;
  std::vector<Piece> pieces_;
  int active_;
  double bins_per_unit_;
  std::vector<std::size_t>
      first_piece_;  ///< at the left end of each of equal bins: exact guess where uniform
};

}  // namespace knothe::model
