#include "knothe/imaging/mesh/registration.hpp"

#include <fmt/format.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"

namespace knothe::imaging {

namespace {
using Complex = std::complex<double>;
}  // namespace

std::array<double, 2> PictureFrame::without_lens(double x, double y) const {
  if (!lens) return {x, y};
  const Eigen::Vector3d sight = lens->ray({x, y}).direction;
  return {lens->fx * sight.x() + lens->cx, lens->fx * sight.y() + lens->cy};
}

std::array<double, 3> PictureFrame::model_point(double x, double y) const {
  const auto [right, down] = without_lens(x, y);
  const Complex at = slope * Complex(right, -down) + offset;
  return view == View::side ? std::array<double, 3>{at.real(), at.imag(), plane}
                            : std::array<double, 3>{at.real(), plane, at.imag()};
}

std::array<double, 2> PictureFrame::picture_point(const std::array<double, 3>& point) const {
  const Complex at(point[0], view == View::side ? point[1] : point[2]);
  const Complex w = (at - offset) / slope;
  if (!lens) return {w.real(), -w.imag()};
  const Eigen::Vector2d pixel =
      lens->project({(w.real() - lens->cx) / lens->fx, (-w.imag() - lens->cy) / lens->fx, 1}).pixel;
  return {pixel.x(), pixel.y()};
}

std::array<int, 2> PictureFrame::components() const {
  return view == View::side ? std::array<int, 2>{0, 1} : std::array<int, 2>{0, 2};
}

Eigen::Matrix2d PictureFrame::displacement_matrix() const {
  Eigen::Matrix2d t;
  t << slope.real(), slope.imag(), slope.imag(), -slope.real();
  return t;
}

Eigen::Matrix2d PictureFrame::displacement_matrix(double x, double y) const {
  if (!lens) return displacement_matrix();
  constexpr double k_step = 0.5;  // px; a lens is smooth
  const auto right = without_lens(x + k_step, y), left = without_lens(x - k_step, y),
             below = without_lens(x, y + k_step), above = without_lens(x, y - k_step);
  Eigen::Matrix2d straight;
  straight << right[0] - left[0], below[0] - above[0], right[1] - left[1], below[1] - above[1];
  return displacement_matrix() * straight / (2 * k_step);
}

Eigen::VectorXd PictureFrame::to_model(const ImageMesh& mesh, const Eigen::VectorXd& displacement) const {
  const Eigen::Matrix2d t = displacement_matrix();
  Eigen::VectorXd result(displacement.size());
  for (Index a = 0; a + 1 < displacement.size(); a += 2) {
    Eigen::Vector2d d = displacement.segment<2>(a);
    if (lens && d.allFinite()) {
      const double x = mesh.x[a / 2], y = mesh.y[a / 2];
      const auto moved = without_lens(x + d.x(), y + d.y()), at = without_lens(x, y);
      d << moved[0] - at[0], moved[1] - at[1];
    }
    result.segment<2>(a) = t * d;
  }
  return result;
}

Eigen::VectorXd PictureFrame::to_picture(const ImageMesh& mesh, const Eigen::VectorXd& displacement) const {
  const Eigen::Matrix2d t = displacement_matrix();
  Eigen::VectorXd result(displacement.size());
  for (Index a = 0; a + 1 < displacement.size(); a += 2)
    if (lens)
      result.segment<2>(a) =
          displacement_matrix(mesh.x[a / 2], mesh.y[a / 2]).inverse() * displacement.segment<2>(a);
    else
      result.segment<2>(a) = t * displacement.segment<2>(a) / std::norm(slope);
  return result;
}

Eigen::SparseMatrix<double> PictureFrame::to_model(const ImageMesh& mesh,
                                                   const Eigen::SparseMatrix<double>& precision) const {
  Eigen::Matrix2d inverse = displacement_matrix() / std::norm(slope);
  std::vector<Eigen::Triplet<double>> entries;
  entries.reserve(2 * precision.rows());
  for (int a = 0; a < precision.rows(); a += 2) {
    if (lens) inverse = displacement_matrix(mesh.x[a / 2], mesh.y[a / 2]).inverse();
    for (int i = 0; i < 2; ++i)
      for (int j = 0; j < 2; ++j) entries.emplace_back(a + i, a + j, inverse(i, j));
  }
  Eigen::SparseMatrix<double> turn(precision.rows(), precision.cols());
  turn.setFromTriplets(entries.begin(), entries.end());
  const Eigen::SparseMatrix<double> half = precision * turn;
  Eigen::SparseMatrix<double> result = Eigen::SparseMatrix<double>(turn.transpose()) * half;
  const Eigen::SparseMatrix<double> other = result.transpose();
  result = 0.5 * (result + other);
  return result;
}

PictureFrame picture_frame(double scale, const std::array<double, 2>& origin_px) {
  PictureFrame frame;
  frame.slope = scale;
  frame.offset = -scale * Complex(origin_px[0], -origin_px[1]);
  return frame;
}

PictureFrame fit_picture_frame(const std::vector<std::array<double, 2>>& pixels,
                               const std::vector<std::array<double, 2>>& points, double point_std) {
  const std::size_t n = pixels.size();
  if (n < 2 || points.size() != n)
    throw UsageError(fmt::format(
        "registration of the picture: {} pixels and {} points; at least two of each, as many, are needed", n,
        points.size()));
  const double count = n;
  Complex pixel_mean, point_mean;
  for (std::size_t i = 0; i < n; ++i)
    pixel_mean += Complex(pixels[i][0], -pixels[i][1]) / count,
        point_mean += Complex(points[i][0], points[i][1]) / count;
  Complex product;
  double squares = 0;
  for (std::size_t i = 0; i < n; ++i) {
    const Complex w = Complex(pixels[i][0], -pixels[i][1]) - pixel_mean;
    product += std::conj(w) * (Complex(points[i][0], points[i][1]) - point_mean), squares += std::norm(w);
  }
  if (!(squares > 1) || !(std::abs(product) > 0))
    throw UsageError(
        "registration of the picture: the points lie in one place; take points far from each other");
  PictureFrame frame;
  frame.slope = product / squares;
  frame.offset = point_mean - frame.slope * pixel_mean;
  double misfit = 0;  // px²
  for (std::size_t i = 0; i < n; ++i)
    misfit += std::norm((Complex(points[i][0], points[i][1]) - frame.offset) / frame.slope -
                        Complex(pixels[i][0], -pixels[i][1]));
  // 2n numbers less the four fitted.
  const double fitted_std = n > 2 ? std::sqrt(misfit / (2 * n - 4)) : 0;
  frame.relative_scale_std = std::max(point_std, fitted_std) / std::sqrt(squares);
  return frame;
}

}  // namespace knothe::imaging
