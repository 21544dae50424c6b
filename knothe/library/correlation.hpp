#pragma once
/// @file Global finite-element image correlation: motion between two pictures (docs/explanation/imaging.md).
#include <array>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "knothe/library/assimilation.hpp"
#include "knothe/library/export.hpp"

namespace knothe {

/// A grey picture, row after row from the top. Pixel centres are at integer coordinates, x to the right, y
/// down.
struct GreyPicture {
  int width = 0, height = 0;
  std::vector<float> pixels;  ///< height × width, 0 (black) … maximum
  float maximum = 255;        ///< grey level of a saturated pixel
};

/// A TIFF, PNG, BMP or PGM of 8 or 16 bits. Errors: DataError naming the file and the reason.
[[nodiscard]] KNOTHE_EXPORT GreyPicture read_grey_picture(const std::string& path);

/// Finite elements over the reference picture.
struct PictureMesh {
  std::vector<double> x, y;  ///< m nodes, px
  /// Nodes of each element, from 0: four that go round it, or the three of a triangle and −1.
  std::vector<std::array<int, 4>> elements;
};

/// The triangles and quadrilaterals of a file of Gmsh (.msh) or VTK (.vtu), whose x and y are pixels. Errors:
/// DataError naming the file and what to save differently.
[[nodiscard]] KNOTHE_EXPORT PictureMesh read_picture_mesh(const std::string& path);

struct CorrelationSettings {
  double element_size = 32;  ///< px, adjusted to divide the region evenly
  std::array<double, 4> region =
      {};  ///< x0, y0, x1, y1: opposite corners, inclusive, px; all 0: the picture less a margin
  double prefilter_sigma = 0;  ///< Gaussian on both pictures, px; 1 for sharp, aliased speckle
  int max_iterations = 50;
  double tolerance = 1e-3;  ///< on the largest change of a displacement, px
  int threads = 1;
  PictureMesh mesh =
      {};  ///< if it has elements, in place of the rectangles of `element_size` over the region
};

/// Displacements of the mesh's m nodes, px, positive right and down.
struct Displacements {
  std::vector<double> u, v;          ///< m; NaN at nodes where nothing could be measured
  std::vector<double> std_u, std_v;  ///< m, px: from the noise of the pictures; 0 at those nodes
  /// Of (u_0, v_0, u_1, …), in 1/px²: the noise of a likelihood; empty rows at those nodes.
  Noise::Precision precision;
  bool converged = false;
  int iterations = 0;
  int elements_rejected = 0;  ///< by their residual, which no displacement of an element explains: a crack
  double residual_rms = 0;    ///< grey levels
  double picture_noise = 0;   ///< standard deviation of one picture's noise, from the residual; grey levels
  std::string message;        ///< why it did not converge; empty if it did
};

/// One reference picture and its mesh, many deformed pictures.
class KNOTHE_EXPORT Correlation {
 public:
  /// Errors: UsageError for a mesh or region outside the picture or without texture, a mesh whose elements
  /// name nodes that are not there or have no area, and for settings that make no sense.
  explicit Correlation(const GreyPicture& reference, const CorrelationSettings& settings = {});
  ~Correlation();
  Correlation(Correlation&&) noexcept;
  Correlation& operator=(Correlation&&) noexcept;

  [[nodiscard]] std::vector<double> node_x() const;  ///< m, px
  [[nodiscard]] std::vector<double> node_y() const;
  [[nodiscard]] std::vector<std::array<int, 4>> elements() const;  ///< as of PictureMesh
  /// The displacements of a picture; the iteration starts from those of the last one. Errors: UsageError for
  /// a picture of another size.
  [[nodiscard]] Displacements correlate(const GreyPicture& deformed);
  /// u, v (k × 2) of the last picture at points (k × 2); NaN outside the mesh.
  [[nodiscard]] std::vector<double> at(std::span<const double> points) const;

 private:
  struct Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace knothe
