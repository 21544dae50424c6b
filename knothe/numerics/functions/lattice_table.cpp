#include "knothe/numerics/functions/lattice_table.hpp"

#include <algorithm>
#include <cmath>

namespace knothe::numerics {
namespace {

constexpr Index k_min_points = 256;      // fewer are as well evaluated
constexpr Index k_max_window = 1 << 14;  // nodes
constexpr Index k_tile = 4;              // nodes along a side, evaluated together
constexpr Index k_max_tiles = 4096;
constexpr double k_min_level = 2, k_max_level = 40;
constexpr double k_intervals_per_std = 3;
constexpr double k_tolerance = 0.01, k_mean_tolerance = 1e-5;  // standard deviations of a function
// Of the third difference: what quadratic interpolation leaves, and cubic adds, between nodes; 1/(9√3).
constexpr double k_error_per_difference = 0.06415;

/// Lagrange's polynomials of the nodes 0, 1, 2, 3 at t.
Eigen::Vector4d lagrange(double t) {
  const double a = t, b = t - 1, c = t - 2, d = t - 3;
  return {-b * c * d / 6, a * c * d / 2, -a * b * d / 2, a * b * c / 6};
}

}  // namespace

/// Nodes of the last tile that are beyond the box are at its border.
double LatticeTable::Axis::node(Index i) const {
  return lower + width * (1.0 * std::min(i, intervals()) / intervals());
}

Index LatticeTable::Axis::stencil_at(double place) const {
  return std::clamp<Index>(place - 1, 0, intervals() - 3);
}

LatticeTable::LatticeTable(const Eigen::VectorXd& lower, const Eigen::VectorXd& upper, Index count)
    : possible_(lower.size() == 2 && lower.allFinite() && upper.allFinite()), count_(count) {
  for (Index k = 0; possible_ && k < 2; ++k) axes_[k] = {lower[k], upper[k] - lower[k]};
}

Eigen::MatrixXd LatticeTable::evaluate(const Eigen::MatrixXd& points, const Eigen::VectorXd& weights,
                                       const Functions& functions) {
  if (!possible_ || points.rows() < k_min_points || !points.allFinite() || !set_levels(points, weights) ||
      !locate(points))
    return functions(points);
  fill_window(functions);
  Eigen::MatrixXd values = interpolate();
  const Eigen::RowVectorXd mean = weights.transpose() * values / weights.sum();
  const Eigen::VectorXd variance =
      (values.rowwise() - mean).cwiseAbs2().transpose() * weights / weights.sum();
  const std::vector<Index> rough = find_rough(variance.cwiseSqrt(), weights / weights.sum());
  if (!rough.empty()) values(rough, Eigen::all) = functions(points(rough, Eigen::all));
  return values;
}

/// False where the points have no width, or one below rounding.
bool LatticeTable::set_levels(const Eigen::MatrixXd& points, const Eigen::VectorXd& weights) {
  const double total = weights.sum();
  std::array<int, 2> levels{};
  for (Index k = 0; k < 2; ++k) {
    const double mean = weights.dot(points.col(k)) / total;
    const double std = std::sqrt(weights.dot((points.col(k).array() - mean).square().matrix()) / total);
    const double level = std::ceil(std::log2(k_intervals_per_std * axes_[k].width / std));
    if (!(level <= k_max_level)) return false;
    levels[k] = std::max(level, k_min_level);
  }
  if (levels[0] != axes_[0].level || levels[1] != axes_[1].level) tiles_.clear();
  for (Index k = 0; k < 2; ++k) axes_[k].level = levels[k];
  return true;
}

/// False where the window would be too large.
bool LatticeTable::locate(const Eigen::MatrixXd& points) {
  for (Index k = 0; k < 2; ++k) {
    Axis& axis = axes_[k];
    axis.first = axis.stencil_at(axis.place_of(points.col(k).minCoeff()));
    axis.size = axis.stencil_at(axis.place_of(points.col(k).maxCoeff())) + 4 - axis.first;
  }
  if (axes_[0].size > k_max_window / axes_[1].size) return false;
  used_.assign(axes_[0].size * axes_[1].size, 0);
  places_.resize(points.rows());
  for (Index i = 0; i < points.rows(); ++i) {
    std::array<Index, 2> first{};
    for (Index k = 0; k < 2; ++k) {
      const double place = axes_[k].place_of(points(i, k));
      const Index stencil = axes_[k].stencil_at(place);
      places_[i].beyond[k] = place - stencil;
      first[k] = stencil - axes_[k].first;
    }
    places_[i].stencil = first[0] * axes_[1].size + first[1];
    used_[places_[i].stencil] = 1;
  }
  return true;
}

void LatticeTable::fill_window(const Functions& functions) {
  const Index rows = axes_[0].size, columns = axes_[1].size;
  if (std::ssize(tiles_) > k_max_tiles) tiles_.clear();
  window_.resize(rows * columns, count_);
  // Where the window begins in its first tile, and how many tiles it touches.
  const Index i0 = axes_[0].first % k_tile, j0 = axes_[1].first % k_tile;
  const Index n = (i0 + rows - 1) / k_tile + 1, m = (j0 + columns - 1) / k_tile + 1;
  std::vector<char> needed(n * m, 0);
  for (Index i = 0; i < rows; ++i)
    for (Index j = 0; j < columns; ++j)
      if (used_[i * columns + j])
        for (const Index to_i : {0, 3})
          for (const Index to_j : {0, 3}) needed[(i0 + i + to_i) / k_tile * m + (j0 + j + to_j) / k_tile] = 1;
  for (Index t = 0; t < n * m; ++t) {
    if (!needed[t]) continue;
    const Index i = t / m * k_tile - i0, j = t % m * k_tile - j0;  // of the tile's first node, in the window
    const Eigen::MatrixXd& values =
        values_of({(axes_[0].first + i) / k_tile, (axes_[1].first + j) / k_tile}, functions);
    for (Index a = std::max<Index>(i, 0); a < std::min(i + k_tile, rows); ++a)
      for (Index b = std::max<Index>(j, 0); b < std::min(j + k_tile, columns); ++b)
        window_.row(a * columns + b) = values.row((a - i) * k_tile + b - j);
  }
}

/// Always of the same points together, so that they are the same to the bit.
const Eigen::MatrixXd& LatticeTable::values_of(const Tile& tile, const Functions& functions) {
  const auto [it, is_new] = tiles_.try_emplace(tile);
  if (!is_new) return it->second;
  Eigen::MatrixXd nodes(k_tile * k_tile, 2);
  for (Index a = 0; a < k_tile; ++a)
    for (Index b = 0; b < k_tile; ++b)
      nodes.row(a * k_tile + b) << axes_[0].node(tile[0] * k_tile + a), axes_[1].node(tile[1] * k_tile + b);
  it->second = functions(nodes);
  return it->second;
}

Eigen::MatrixXd LatticeTable::interpolate() const {
  Eigen::MatrixXd values(std::ssize(places_), count_);
  const Index columns = axes_[1].size;
  for (Index i = 0; i < values.rows(); ++i) {
    const Place& place = places_[i];
    const Eigen::Vector4d across = lagrange(place.beyond[0]), along = lagrange(place.beyond[1]);
    for (Index k = 0; k < count_; ++k) {
      const double* at = window_.col(k).data() + place.stencil;
      Eigen::Vector4d sum = across[0] * Eigen::Map<const Eigen::Vector4d>(at);
      for (Index a = 1; a < 4; ++a) sum += across[a] * Eigen::Map<const Eigen::Vector4d>(at + a * columns);
      values(i, k) = sum.dot(along);
    }
  }
  return values;
}

/// The points in whose stencil, or a neighbouring one, a third difference leaves a function an error that
/// matters. (That of a kink in the middle of a stencil is zero.)
std::vector<Index> LatticeTable::find_rough(const Eigen::VectorXd& std, const Eigen::VectorXd& shares) const {
  const Index rows = axes_[0].size, columns = axes_[1].size;
  Eigen::ArrayXXd share = Eigen::ArrayXXd::Zero(columns, rows);  // of the weight, by stencil
  for (Index i = 0; i < shares.size(); ++i) share(places_[i].stencil) += shares[i];
  std::vector<char> is_rough(used_.size(), 0);
  for (Index s = 0; s < std::ssize(used_); ++s) {
    double error = 0;  // in standard deviations
    for (Index k = 0; used_[s] && k < count_; ++k)
      error = std::max(error, k_error_per_difference * third_difference(k, s) / std[k]);
    if (error <= k_tolerance) continue;
    const Index i = std::max<Index>(s / columns - 1, 0), j = std::max<Index>(s % columns - 1, 0);
    const Index n = std::min(s / columns + 2, rows) - i, m = std::min(s % columns + 2, columns) - j;
    if (share.block(j, i, m, n).sum() * error <= k_mean_tolerance) continue;
    for (Index a = i; a < i + n; ++a)
      for (Index b = j; b < j + m; ++b) is_rough[a * columns + b] = 1;
  }
  std::vector<Index> rough;
  for (Index i = 0; i < std::ssize(places_); ++i)
    if (is_rough[places_[i].stencil]) rough.push_back(i);
  return rough;
}

/// The largest along both axes.
double LatticeTable::third_difference(Index function, Index stencil) const {
  const double* at = window_.col(function).data() + stencil;
  const auto along = [](const double* v, Index by) {
    return std::abs(v[3 * by] - v[0] + 3 * (v[by] - v[2 * by]));
  };
  double largest = 0;
  const Index columns = axes_[1].size;
  for (Index a = 0; a < 4; ++a)
    largest = std::max({largest, along(at + a * columns, 1), along(at + a, columns)});
  return largest;
}

}  // namespace knothe::numerics
