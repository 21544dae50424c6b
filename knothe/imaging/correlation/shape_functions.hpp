#pragma once
/// @file Shape functions of one linear element of a mesh over a picture.
#include <array>
#include <span>
#include <vector>

namespace knothe::imaging {

/// N_a = Σ_m c_am (1, X, Y, XY)_m. In triangles and upright rectangles X = x − x₀, Y = y − y₀ (px), so that
/// they are straight lines along a row of pixels. Other quadrilaterals are isoparametric: X, Y are the
/// natural coordinates (ξ, η) ∈ [−1, 1]² with x = Σ N_a x_a, found from x by Newton's method.
class ShapeFunctions {
 public:
  using Coefficients = std::array<std::array<double, 4>, 4>;  ///< of node a: in 1, X, Y, XY
  using Gradients = std::array<std::array<double, 2>, 4>;     ///< ∂N_a/∂x, ∂N_a/∂y; 1/px

  /// Three or four corners, px, one after the other round the element; `x0`, `y0` the origin of X and Y.
  ShapeFunctions(std::span<const double> x, std::span<const double> y, double x0, double y0);

  /// False without area, and for quadrilaterals that are not convex: N is then −1 everywhere, so that no
  /// point is inside.
  [[nodiscard]] bool is_valid() const { return is_valid_; }
  [[nodiscard]] bool is_natural() const { return is_natural_; }
  [[nodiscard]] const Coefficients& coefficients() const { return coefficients_; }
  /// X and Y of a place in the picture; for exterior points only guaranteed to lie outside.
  [[nodiscard]] std::array<double, 2> coordinates(double x, double y) const;
  [[nodiscard]] std::array<double, 4> values(double x, double y) const;
  [[nodiscard]] Gradients gradients(double x, double y) const;
  [[nodiscard]] double area() const { return area_; }  ///< px²

  struct IntegrationPoint {
    Gradients gradients;
    double weight;  ///< px²
  };
  /// The 2 × 2 Gauss rule, or one point in a triangle.
  [[nodiscard]] std::vector<IntegrationPoint> integration_points() const;

 private:
  void set_triangle(std::span<const double> x, std::span<const double> y);
  void set_rectangle(std::span<const double> x, std::span<const double> y);
  void set_natural(std::span<const double> x, std::span<const double> y);
  /// ∂(x, y)/∂(X, Y), row by row; the identity but for natural coordinates.
  [[nodiscard]] std::array<double, 4> jacobian(double along, double across) const;
  [[nodiscard]] Gradients gradients_at(double along, double across, double& determinant) const;

  Coefficients coefficients_{};
  double x0_, y0_, area_ = 0;
  std::array<double, 4> map_x_{}, map_y_{};  ///< x − x₀ and y − y₀ in 1, ξ, η, ξη
  std::array<double, 4> extent_{};           ///< of a rectangle: least and largest X, Y
  int nodes_;
  bool is_valid_ = true, is_natural_ = false;
};

}  // namespace knothe::imaging
