#include "knothe/numerics/functions/cubic_spline.hpp"

#include <fmt/format.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"

namespace knothe::numerics {

namespace {

void require_increasing(std::span<const double> nodes) {
  if (nodes.size() < 2)
    throw UsageError(fmt::format("cubic spline: {} node(s); at least 2 are needed", nodes.size()));
  for (Index i = 0; i < std::ssize(nodes); ++i) {
    if (!std::isfinite(nodes[i])) throw UsageError(fmt::format("cubic spline: node {} is not finite", i));
    if (i > 0 && !(nodes[i] > nodes[i - 1]))
      throw UsageError(
          fmt::format("cubic spline: node {} ({}) is not above node {} ({}); nodes must increase strictly", i,
                      nodes[i], i - 1, nodes[i - 1]));
  }
}

/// The B-splines of `degree` that live on [knots[j], knots[j+1]] as polynomials in s = x − knots[j]: the
/// recursion B_{i,p} = (x − t_i)/(t_{i+p} − t_i) B_{i,p−1} + (t_{i+p+1} − x)/(t_{i+p+1} − t_{i+1})
/// B_{i+1,p−1} (de Boor, ch. IX, Eq. 14) carried out on coefficients. Result: [power][function].
std::array<std::array<double, 4>, 4> pieces_on(const std::vector<double>& knots, std::size_t j, int degree) {
  const double left = knots[j];
  using Polynomial = std::array<double, 4>;
  std::array<Polynomial, 4> basis{};
  basis[0][0] = 1;
  for (int p = 1; p <= degree; ++p) {
    std::array<Polynomial, 4> next{};
    for (int m = 0; m < p; ++m) {  // basis[m] is B_{i,p-1} with i = j − p + 1 + m
      const std::size_t i = j + m + 1 - p;
      const double low = knots[i], high = knots[i + p], width = high - low;
      for (std::size_t k = 0; k < 4; ++k) {
        const double c = basis[m][k] / width;
        auto& rising = next[m + 1];
        auto& falling = next[m];
        rising[k] += (left - low) * c;
        falling[k] += (high - left) * c;
        if (k < 3) {
          rising[k + 1] += c;
          falling[k + 1] -= c;
        }
      }
    }
    basis = next;
  }
  std::array<std::array<double, 4>, 4> by_power{};
  for (std::size_t f = 0; f < 4; ++f)
    for (std::size_t k = 0; k < 4; ++k) by_power[k][f] = basis[f][k];
  return by_power;
}

}  // namespace

CubicSplineBasis::CubicSplineBasis(std::span<const double> nodes) : nodes_(nodes.begin(), nodes.end()) {
  require_increasing(nodes);
  const std::size_t n = nodes.size();
  degree_ = std::min<std::size_t>(3, n - 1);
  for (std::size_t i = 0; i < n; ++i) {
    const bool inside = i > 0 && i + 1 < n;
    const bool knot = !inside || (n >= 4 && i != 1 && i + 2 != n);
    if (knot) breaks_.push_back(nodes[i]);
  }
  inverse_mean_width_ = (breaks_.size() - 1) / (breaks_.back() - breaks_.front());

  std::vector<double> knots(degree_, breaks_.front());
  knots.insert(knots.end(), breaks_.begin(), breaks_.end());
  knots.insert(knots.end(), degree_, breaks_.back());
  for (Index j = 0; j + 1 < std::ssize(breaks_); ++j)
    pieces_.push_back(pieces_on(knots, j + degree_, degree_));

  Eigen::MatrixXd collocation = Eigen::MatrixXd::Zero(size(), size());
  for (std::size_t i = 0; i < n; ++i) {
    const Local local = evaluate(nodes[i]);
    for (int f = 0; f < active(); ++f) collocation(i, local.first + f) = local.value[f];
  }
  from_values_ = collocation.partialPivLu().inverse();
}

std::size_t CubicSplineBasis::interval_of(double x) const {
  const auto last = std::ssize(pieces_) - 1;
  // A guess that is exact on uniform nodes, corrected by a short walk elsewhere.
  const double guess = (x - breaks_.front()) * inverse_mean_width_;
  auto j = guess > 0 ? static_cast<std::ptrdiff_t>(std::min<double>(guess, last)) : std::ptrdiff_t{0};
  while (j > 0 && x < breaks_[j]) --j;
  while (j < last && x >= breaks_[j + 1]) ++j;
  return j;
}

CubicSplineBasis::Local CubicSplineBasis::evaluate(double x) const {
  const std::size_t j = interval_of(x);
  const double s = x - breaks_[j];
  const auto& c = pieces_[j];
  Local local{};
  local.first = j;
  for (std::size_t f = 0; f < 4; ++f) {
    local.value[f] = c[0][f] + s * (c[1][f] + s * (c[2][f] + s * c[3][f]));
    local.first_derivative[f] = c[1][f] + s * (2 * c[2][f] + s * 3 * c[3][f]);
    local.second_derivative[f] = 2 * c[2][f] + s * 6 * c[3][f];
  }
  return local;
}

Eigen::VectorXd CubicSplineBasis::cardinal_weights(double x, int derivative) const {
  const Local local = evaluate(x);
  const auto& b = derivative == 0   ? local.value
                  : derivative == 1 ? local.first_derivative
                                    : local.second_derivative;
  Eigen::VectorXd weights = Eigen::VectorXd::Zero(size());
  for (int f = 0; f < active(); ++f) weights += b[f] * from_values_.row(local.first + f).transpose();
  return weights;
}

CubicSpline::CubicSpline(std::span<const double> nodes, std::span<const double> values) {
  if (values.size() != nodes.size())
    throw UsageError(fmt::format("cubic spline: {} values for {} nodes", values.size(), nodes.size()));
  for (Index i = 0; i < std::ssize(values); ++i)
    if (!std::isfinite(values[i])) throw UsageError(fmt::format("cubic spline: value {} is not finite", i));
  const CubicSplineBasis basis(nodes);
  const Eigen::Map<const Eigen::VectorXd> y(values.data(), basis.size());
  const Eigen::VectorXd c = basis.coefficients_from_values() * y;
  const std::size_t n = nodes.size();
  const std::size_t count = n >= 4 ? n - 3 : 1;
  for (std::size_t j = 0; j < count; ++j) {
    Piece piece{j == 0 ? nodes[0] : nodes[j + 1], {}};
    // Taylor coefficients at the left end of the piece; the third from the change of s'' across it.
    const double right = j + 1 == count ? nodes[n - 1] : nodes[j + 2];
    const auto at_left = basis.evaluate(piece.left);
    const auto before_right = basis.evaluate(0.5 * (piece.left + right));
    double second_middle = 0;
    for (Index f = 0; f < basis.active(); ++f) {
      const double a = c[at_left.first + f];
      piece.coefficient[0] += a * at_left.value[f];
      piece.coefficient[1] += a * at_left.first_derivative[f];
      piece.coefficient[2] += a * at_left.second_derivative[f] / 2;
      second_middle += a * before_right.second_derivative[f];
    }
    if (n >= 4)
      piece.coefficient[3] = (second_middle - 2 * piece.coefficient[2]) / (3 * (right - piece.left));
    pieces_.push_back(piece);
  }
}

std::array<double, 3> CubicSpline::evaluate(double x) const {
  auto above = std::upper_bound(pieces_.begin() + 1, pieces_.end(), x,
                                [](double value, const Piece& piece) { return value < piece.left; });
  const Piece& piece = *(above - 1);
  const double s = x - piece.left;
  const auto& c = piece.coefficient;
  return {c[0] + s * (c[1] + s * (c[2] + s * c[3])), c[1] + s * (2 * c[2] + s * 3 * c[3]),
          2 * c[2] + s * 6 * c[3]};
}

}  // namespace knothe::numerics
