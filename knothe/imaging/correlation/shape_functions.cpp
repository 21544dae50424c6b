#include "knothe/imaging/correlation/shape_functions.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace knothe::imaging {

namespace {

constexpr double k_upright = 1e-6;  // px: a side is along an axis
constexpr double k_flat = 1e-9;     // of the longest side squared: no area at a corner
constexpr int k_newton_steps = 30;  // a handful is enough inside
constexpr double k_newton_far = 4;  // natural coordinates beyond are of no interest
constexpr double k_converged = 1e-11;
constexpr std::array<double, 4> k_xi{-1, 1, 1, -1}, k_eta{-1, -1, 1, 1};

}  // namespace

ShapeFunctions::ShapeFunctions(std::span<const double> x, std::span<const double> y, double x0, double y0)
    : x0_(x0), y0_(y0), nodes_(x.size()) {
  const std::size_t n = x.size();
  double longest = 0, smallest = 0, largest = 0;
  bool upright = n == 4;
  for (std::size_t a = 0; a < n; ++a) {
    const std::size_t next = (a + 1) % n, before = (a + n - 1) % n;
    const double dx = x[next] - x[a], dy = y[next] - y[a];
    const double corner = dx * (y[before] - y[a]) - dy * (x[before] - x[a]);  // Jacobian at this corner
    longest = std::max(longest, dx * dx + dy * dy);
    smallest = a == 0 ? corner : std::min(smallest, corner);
    largest = a == 0 ? corner : std::max(largest, corner);
    area_ += 0.5 * (x[a] * y[next] - x[next] * y[a]);
    upright = upright && std::min(std::abs(dx), std::abs(dy)) <= k_upright;
  }
  area_ = std::abs(area_);
  is_valid_ = smallest > k_flat * longest || largest < -k_flat * longest;
  if (!is_valid_) {
    for (auto& c : coefficients_) c = {-1, 0, 0, 0};
  } else if (n == 3) {
    set_triangle(x, y);
  } else if (upright) {
    set_rectangle(x, y);
  } else {
    set_natural(x, y);
  }
}

void ShapeFunctions::set_triangle(std::span<const double> x, std::span<const double> y) {
  const double twice = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0]);
  for (std::size_t a = 0; a < 3; ++a) {
    const std::size_t b = (a + 1) % 3, c = (a + 2) % 3;
    const double xb = x[b] - x0_, yb = y[b] - y0_, xc = x[c] - x0_, yc = y[c] - y0_;
    coefficients_[a] = {(xb * yc - xc * yb) / twice, (yb - yc) / twice, (xc - xb) / twice, 0};
  }
}

void ShapeFunctions::set_rectangle(std::span<const double> x, std::span<const double> y) {
  for (std::size_t a = 0; a < 4; ++a) {
    const std::size_t opposite = (a + 2) % 4;
    const double xc = x[opposite] - x0_, yc = y[opposite] - y0_;
    const double product = (x[opposite] - x[a]) * (y[opposite] - y[a]);
    coefficients_[a] = {xc * yc / product, -yc / product, -xc / product, 1 / product};
  }
  const auto [x_low, x_high] = std::minmax_element(x.begin(), x.end());
  const auto [y_low, y_high] = std::minmax_element(y.begin(), y.end());
  extent_ = {*x_low - x0_, *x_high - x0_, *y_low - y0_, *y_high - y0_};
}

void ShapeFunctions::set_natural(std::span<const double> x, std::span<const double> y) {
  is_natural_ = true;
  for (std::size_t a = 0; a < 4; ++a) {
    coefficients_[a] = {0.25, 0.25 * k_xi[a], 0.25 * k_eta[a], 0.25 * k_xi[a] * k_eta[a]};
    for (std::size_t m = 0; m < 4; ++m) {
      map_x_[m] += coefficients_[a][m] * (x[a] - x0_);
      map_y_[m] += coefficients_[a][m] * (y[a] - y0_);
    }
  }
}

std::array<double, 4> ShapeFunctions::jacobian(double along, double across) const {
  if (!is_natural_) return {1, 0, 0, 1};
  return {map_x_[1] + map_x_[3] * across, map_x_[2] + map_x_[3] * along, map_y_[1] + map_y_[3] * across,
          map_y_[2] + map_y_[3] * along};
}

std::array<double, 2> ShapeFunctions::coordinates(double x, double y) const {
  if (!is_natural_) return {x - x0_, y - y0_};
  double xi = 0, eta = 0;
  for (int k = 0; k < k_newton_steps; ++k) {
    const double rx = x - x0_ - map_x_[0] - map_x_[1] * xi - map_x_[2] * eta - map_x_[3] * xi * eta;
    const double ry = y - y0_ - map_y_[0] - map_y_[1] * xi - map_y_[2] * eta - map_y_[3] * xi * eta;
    const auto j = jacobian(xi, eta);
    const double determinant = j[0] * j[3] - j[1] * j[2];
    if (determinant == 0) return {k_newton_far, k_newton_far};
    const double dxi = (j[3] * rx - j[1] * ry) / determinant, deta = (j[0] * ry - j[2] * rx) / determinant;
    xi = std::clamp(xi + dxi, -k_newton_far, k_newton_far);
    eta = std::clamp(eta + deta, -k_newton_far, k_newton_far);
    if (std::abs(dxi) + std::abs(deta) < k_converged) return {xi, eta};
  }
  return {k_newton_far, k_newton_far};  // outside: inside a convex element the method converges
}

std::array<double, 4> ShapeFunctions::values(double x, double y) const {
  const auto [along, across] = coordinates(x, y);
  std::array<double, 4> n{};
  for (std::size_t a = 0; a < 4; ++a) {
    const auto& c = coefficients_[a];
    n[a] = c[0] + c[1] * along + c[2] * across + c[3] * along * across;
  }
  return n;
}

ShapeFunctions::Gradients ShapeFunctions::gradients_at(double along, double across,
                                                       double& determinant) const {
  const auto j = jacobian(along, across);
  determinant = j[0] * j[3] - j[1] * j[2];
  Gradients result{};
  for (std::size_t a = 0; a < 4; ++a) {
    const auto& c = coefficients_[a];
    const double d_along = c[1] + c[3] * across, d_across = c[2] + c[3] * along;
    result[a] = {(d_along * j[3] - d_across * j[2]) / determinant,
                 (d_across * j[0] - d_along * j[1]) / determinant};
  }
  return result;
}

ShapeFunctions::Gradients ShapeFunctions::gradients(double x, double y) const {
  const auto [along, across] = coordinates(x, y);
  double determinant = 1;
  return gradients_at(along, across, determinant);
}

std::vector<ShapeFunctions::IntegrationPoint> ShapeFunctions::integration_points() const {
  std::vector<IntegrationPoint> points;
  double determinant = 1;
  if (!is_valid_) return points;
  if (nodes_ == 3) {
    points.push_back({gradients_at(0, 0, determinant), area_});
    return points;
  }
  for (const double s : {-1.0, 1.0})
    for (const double t : {-1.0, 1.0}) {
      double along = s / std::numbers::sqrt3, across = t / std::numbers::sqrt3;
      if (!is_natural_) {
        along = 0.5 * (extent_[0] + extent_[1]) + 0.5 * along * (extent_[1] - extent_[0]);
        across = 0.5 * (extent_[2] + extent_[3]) + 0.5 * across * (extent_[3] - extent_[2]);
      }
      const Gradients g = gradients_at(along, across, determinant);
      points.push_back({g, is_natural_ ? std::abs(determinant) : area_ / 4});
    }
  return points;
}

}  // namespace knothe::imaging
