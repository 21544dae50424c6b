#pragma once
/// @file A nodal displacement field as a function of place, for drawing pictures of a body that moves so.
#include <Eigen/Core>
#include <array>
#include <vector>

#include "knothe/imaging/mesh/image_mesh.hpp"
#include "knothe/imaging/series/speckle.hpp"

namespace knothe::imaging {

/// The field of a mesh, continued beyond its outline by that of the nearest point of the outline, within a
/// few pixels; farther off it is zero.
class MeshField {
 public:
  explicit MeshField(ImageMesh mesh);
  MeshField(const MeshField&) = delete;
  MeshField& operator=(const MeshField&) = delete;

  [[nodiscard]] const ImageMesh& mesh() const { return mesh_; }
  /// Nodal displacements from now on, interleaved, px.
  void set(const Eigen::VectorXd& displacement) { displacement_ = displacement; }
  [[nodiscard]] Displacement at(double x, double y) const;
  /// 1 inside, 0 outside, and between them a smooth step of about 2 px across the outline, as a lens makes
  /// it.
  [[nodiscard]] double body(double x, double y) const;
  /// Distance to the outline, px; infinity where it is farther than about 12 px.
  [[nodiscard]] double outline_distance(double x, double y) const;

 private:
  struct Nearest {
    int edge = -1;  ///< −1: none near
    double along = 0, distance = 0;
  };
  [[nodiscard]] Nearest nearest_edge(double x, double y) const;

  ImageMesh mesh_;
  PointLocator locator_;
  Eigen::VectorXd displacement_;
  std::vector<std::array<int, 2>> edges_;  ///< of the outline
  Region bounds_;                          ///< of the cells
  int columns_ = 0, rows_ = 0;
  std::vector<std::vector<int>> cells_;  ///< edges near each cell
};

/// A mask (1 and 0) of a picture of that size without the pixels nearer than `margin` px to the outline of
/// the mesh: the edge of a body against its background is too sharp to be interpolated, and what lies behind
/// does not move with it. Combined with `mask`, which may be empty.
[[nodiscard]] files::Picture without_outline(const MeshField& field, int width, int height, double margin,
                                             const files::Picture& mask = {});

}  // namespace knothe::imaging
