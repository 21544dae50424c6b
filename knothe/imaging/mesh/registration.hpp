#pragma once
/// @file Where the picture is in the model: pixels to metres, and displacements with them.
#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <array>
#include <complex>
#include <optional>
#include <vector>

#include "knothe/imaging/camera/camera.hpp"
#include "knothe/imaging/mesh/image_mesh.hpp"

namespace knothe::imaging {

/// Which face of the body the camera sees. Side: picture right is model x, picture up is y, the face is a
/// plane of constant z. Bottom: right is x, up is z, the face a plane of constant y.
enum class View { side, bottom };

/// A camera that looks straight at a plane face: model = slope · (x − i y) + offset in complex numbers, that
/// is, turning, scaling and moving, with the picture's y turned upwards.
struct PictureFrame {
  std::complex<double> slope{1, 0};   ///< m per px, times e^{iθ} for a camera turned by θ
  std::complex<double> offset{0, 0};  ///< m: model place of pixel (0, 0)
  double relative_scale_std = 0;      ///< standard deviation of the scale over the scale
  View view = View::side;
  double plane = 0;  ///< m: the constant coordinate of the face
  /// Of the camera, where it distorts; its pose does not count. `slope` and `offset` are then of the picture
  /// that it would take without distortion, with square pixels (`without_lens`).
  std::optional<Camera> lens;

  [[nodiscard]] double scale() const { return std::abs(slope); }  ///< m per px
  /// Model coordinates (m) of a place in the picture (px).
  [[nodiscard]] std::array<double, 3> model_point(double x, double y) const;
  /// Place in the picture (px) of a model point; the coordinate across the face does not count.
  [[nodiscard]] std::array<double, 2> picture_point(const std::array<double, 3>& point) const;
  /// Model components (0 x, 1 y, 2 z) that a displacement in the picture has.
  [[nodiscard]] std::array<int, 2> components() const;
  /// T with (model displacement, m) = T (u, v), px, without a lens; symmetric, T² = scale² I.
  [[nodiscard]] Eigen::Matrix2d displacement_matrix() const;
  /// Displacements of the nodes of a mesh, interleaved, from px to m.
  [[nodiscard]] Eigen::VectorXd to_model(const ImageMesh& mesh, const Eigen::VectorXd& displacement) const;
  /// Their precision from 1/px² to 1/m²: T⁻ᵀ P T⁻¹ for each pair of nodes; with a lens T is another at each
  /// node, ∂(model place)/∂(x, y).
  [[nodiscard]] Eigen::SparseMatrix<double> to_model(const ImageMesh& mesh,
                                                     const Eigen::SparseMatrix<double>& precision) const;
  /// Displacements of the nodes from m to px; with a lens to first order.
  [[nodiscard]] Eigen::VectorXd to_picture(const ImageMesh& mesh, const Eigen::VectorXd& displacement) const;
  /// Where the picture's place (x, y) would be without the lens; px.
  [[nodiscard]] std::array<double, 2> without_lens(double x, double y) const;

 private:
  [[nodiscard]] Eigen::Matrix2d displacement_matrix(double x, double y) const;
};

/// A frame from its scale (m per px) and the pixel in which the model's origin lies, the camera not turned.
[[nodiscard]] PictureFrame picture_frame(double scale, const std::array<double, 2>& origin_px);

/// The frame that fits points found in the picture (n × 2, px) to their places on the model's face (n × 2, m:
/// right, up), by least squares (two points: exactly). The scale's relative standard deviation is
/// σ/√Σ|w − w̄|², with `point_std` (px) for how accurately a point was found, or what the fit says where that
/// is more and there are at least three points. Errors: UsageError for fewer than two points, or all in one
/// place.
[[nodiscard]] PictureFrame fit_picture_frame(const std::vector<std::array<double, 2>>& pixels,
                                             const std::vector<std::array<double, 2>>& points,
                                             double point_std = 0.5);

}  // namespace knothe::imaging
