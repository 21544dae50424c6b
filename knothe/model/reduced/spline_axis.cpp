#include "knothe/model/reduced/spline_axis.hpp"

#include "knothe/base/index.hpp"

namespace knothe::model {

SplineAxis::SplineAxis(const numerics::CubicSplineBasis& basis)
    : breaks_(basis.breaks().begin(), basis.breaks().end()), active_(basis.active()) {
  for (Index j = 0; j < std::ssize(basis.pieces()); ++j) {
    const auto& c = basis.pieces()[j];  // in x − left = half (1 + t)
    const double half = 0.5 * (breaks_[j + 1] - breaks_[j]);
    middle_.push_back(0.5 * (breaks_[j] + breaks_[j + 1]));
    scale_.push_back(1 / half);
    Piece& piece = pieces_.emplace_back();
    for (std::size_t f = 0; f < 4; ++f) {
      piece[0][f] = c[0][f] + half * (c[1][f] + half * (c[2][f] + half * c[3][f]));
      piece[1][f] = half * (c[1][f] + half * (2 * c[2][f] + half * 3 * c[3][f]));
      piece[2][f] = half * half * (c[2][f] + half * 3 * c[3][f]);
      piece[3][f] = half * half * half * c[3][f];
    }
  }
  // As many bins as equal nodes have intervals, where the second and the last but one node end no piece.
  const std::size_t bins = pieces_.size() + 2;
  bins_per_unit_ = bins / (breaks_.back() - breaks_.front());
  for (std::size_t bin = 0, j = 0; bin < bins; ++bin) {
    const double left = breaks_.front() + bin / bins_per_unit_;
    while (j + 1 < pieces_.size() && left >= breaks_[j + 1] - 1e-9 / bins_per_unit_) ++j;
    first_piece_.push_back(j);
  }
}

}  // namespace knothe::model
