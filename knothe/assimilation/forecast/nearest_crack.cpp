#include "knothe/assimilation/forecast/nearest_crack.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "knothe/base/index.hpp"

namespace knothe::assimilation {
namespace {

constexpr double k_accuracy = 1e-10;  // m
constexpr Index k_places = 2;         // of the first pass in one piece

/// Slope of ½|F b(s) − t|² on one piece and its derivative.
struct Slope {
  Eigen::Matrix<double, 6, 1> c;

  [[nodiscard]] double at(double s) const {
    return c[0] + s * (c[1] + s * (c[2] + s * (c[3] + s * (c[4] + s * c[5]))));
  }
  [[nodiscard]] double derivative_at(double s) const {
    return c[1] + s * (2 * c[2] + s * (3 * c[3] + s * (4 * c[4] + s * 5 * c[5])));
  }
  /// Where it crosses zero between `low`, where it is negative, and `high`: Newton's steps, halving where one
  /// leads out.
  [[nodiscard]] double root(double low, double high) const {
    double s = 0.5 * (low + high);
    for (int k = 0; k < 60 && high - low > k_accuracy; ++k) {
      const double here = at(s);
      (here < 0 ? low : high) = s;
      double next = s - here / derivative_at(s);
      if (!(next > low && next < high)) next = 0.5 * (low + high);
      if (std::abs(next - s) < 0.1 * k_accuracy) return next;
      s = next;
    }
    return s;
  }
};

/// One place of the first pass for n targets: ½|R v|² − bᵀ(Fᵀt), and its number where that is the least yet.
/// Plain loops over neighbours in memory, which the compiler turns into SIMD lanes.
void update_least(double half_square, const Eigen::RowVector4d& b, const double* __restrict products,
                  Index stride, double number, Index n, double* __restrict least, double* __restrict best) {
  const double b0 = b[0], b1 = b[1], b2 = b[2], b3 = b[3];
  for (Index i = 0; i < n; ++i) {
    const double here = half_square - b0 * products[i] - b1 * products[i + stride] -
                        b2 * products[i + 2 * stride] - b3 * products[i + 3 * stride];
    best[i] = here < least[i] ? number : best[i];
    least[i] = here < least[i] ? here : least[i];
  }
}

}  // namespace

NearestCrack::NearestCrack(const CrackMetaModel& meta_model, const Eigen::Ref<const Eigen::MatrixXd>& factor)
    : fields_(factor * meta_model.coefficients()) {
  const numerics::CubicSplineBasis& basis = meta_model.basis();
  const auto breaks = basis.breaks();
  for (Index j = 0; j + 1 < std::ssize(breaks); ++j) {
    const auto& by_power = basis.pieces()[j];
    const auto fields = fields_.middleCols<4>(j);
    Piece piece{breaks[j], breaks[j + 1] - breaks[j], {}, {}, {}, {}, {}};
    Eigen::Matrix4d powers;  // of s, a column for each
    for (Index k = 0; k < 4; ++k) {
      powers.col(k) = Eigen::Map<const Eigen::Vector4d>(by_power[k].data());
      if (k > 0) piece.slope.row(k - 1) = k * powers.col(k).transpose();
    }
    const Eigen::Matrix4d gram = powers.transpose() * (fields.transpose() * fields) * powers;
    piece.own_slope.setZero();
    for (Index a = 0; a < 4; ++a)
      for (Index b = 1; b < 4; ++b) piece.own_slope[a + b - 1] += b * gram(a, b);
    for (Index k = 0; k < k_places; ++k) {
      const double s = (k + 0.5) / k_places * piece.width;
      piece.places[k] = s;
      piece.basis.row(k) = (powers * Eigen::Vector4d(1, s, s * s, s * s * s)).transpose();
      piece.half_square[k] = 0.5 * (fields * piece.basis.row(k).transpose()).squaredNorm();
    }
    pieces_.push_back(piece);
  }
}

Eigen::VectorXd NearestCrack::lengths(const Eigen::Ref<const Eigen::MatrixXd>& targets) const {
  constexpr Index k_block = 128;  // of targets side by side, so that what is read stays near
  const Eigen::MatrixXd products = targets.transpose() * fields_;
  Eigen::VectorXd lengths(targets.cols());
  const Index stride = products.rows();
  std::array<double, k_block> least, best;
  for (Index begin = 0; begin < lengths.size(); begin += k_block) {
    const Index n = std::min(k_block, lengths.size() - begin);
    least.fill(std::numeric_limits<double>::infinity());
    best.fill(0);
    double number = 0;
    for (Index j = 0; j < std::ssize(pieces_); ++j) {
      const double* p = products.data() + j * stride + begin;
      for (Index k = 0; k < k_places; ++k, ++number)
        update_least(pieces_[j].half_square[k], pieces_[j].basis.row(k), p, stride, number, n, least.data(),
                     best.data());
    }
    for (Index i = 0; i < n; ++i) lengths[begin + i] = minimum_near(best[i], products.row(begin + i));
  }
  return lengths;
}

double NearestCrack::minimum_near(Index best, const Products& products) const {
  const auto slope_on = [&](std::size_t j) {
    Slope slope{pieces_[j].own_slope};
    slope.c.head<3>() -= pieces_[j].slope * products.segment<4>(j).transpose();
    return slope;
  };
  std::size_t j = best / k_places;
  const Index place = best % k_places;
  Slope slope = slope_on(j);
  const double here = pieces_[j].places[place];
  double low = here, high = here;
  if (slope.at(here) > 0) {  // downhill to the left, where the piece before may begin
    low = place > 0 ? pieces_[j].places[place - 1] : 0;
    if (place == 0 && j > 0 && slope.at(0) > 0) {
      slope = slope_on(--j);
      low = pieces_[j].places[k_places - 1], high = pieces_[j].width;
    }
    if (slope.at(low) >= 0) return pieces_[j].left + low;
  } else {
    high = place + 1 < k_places ? pieces_[j].places[place + 1] : pieces_[j].width;
    if (place + 1 == k_places && j + 1 < pieces_.size() && slope.at(high) < 0) {
      slope = slope_on(++j);
      low = 0, high = pieces_[j].places[0];
    }
    if (slope.at(high) <= 0) return pieces_[j].left + high;
  }
  return pieces_[j].left + slope.root(low, high);
}

}  // namespace knothe::assimilation
