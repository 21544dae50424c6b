#pragma once
/// @file Shape and motion of a surface that two or more calibrated cameras see.
///
/// One mesh on the surface has nodes X in space; camera c sees it as the plane mesh P_c(X), on which the
/// pictures of that camera are correlated (image_correlation.hpp). From the displacements d_c of all cameras,
/// with precisions Π_c, u = argmin Σ_c |P_c(X + u) − P_c(X) + b_c(u) − d_c|²_{Π_c}: to second order this is
/// the joint correlation of all pictures with the three components of u as unknowns, because Π_c is the
/// Gauss–Newton matrix of camera c. b_c: what perspective adds between the nodes (element_view.hpp).
/// Precision of u: Σ_c J_cᵀ Π_c J_c, J_c = ∂P_c/∂X.
#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <string>
#include <vector>

#include "knothe/base/index.hpp"
#include "knothe/files/picture.hpp"
#include "knothe/imaging/camera/camera.hpp"
#include "knothe/imaging/correlation/image_correlation.hpp"

namespace knothe::imaging {

/// Three rows of coordinates, one column a node; unit of length of the cameras.
using SurfacePoints = Eigen::Matrix3Xd;

struct StereoSurface {
  SurfacePoints points;           ///< X
  std::vector<ImageMesh> meshes;  ///< P_c(X) for each camera, one topology
  double epipolar_rms = 0;        ///< px, of find_surface: lines of sight that miss each other
};

/// What one camera measured on its mesh.
struct CameraMotion {
  Eigen::VectorXd displacement;  ///< d_c, 2 per node, px
  Eigen::SparseMatrix<double>
      precision;               ///< Π_c, 1/px², both triangles; rows empty where nothing was measured
  std::vector<char> measured;  ///< of each node
};

struct SurfaceMotion {
  Eigen::VectorXd displacement;           ///< u, 3 per node, unit of length; 0 where not measured
  Eigen::SparseMatrix<double> precision;  ///< of u, both triangles
  Eigen::VectorXd std;                    ///< √diag of its inverse; 0 where not measured
  std::vector<char> measured;             ///< nodes that two or more cameras measured
  double chi_square = 0;    ///< Σ_c |residual|²_{Π_c}: of `redundancy` degrees of freedom if all is well
  Index redundancy = 0;     ///< values of the measured nodes less three a node
  double epipolar_rms = 0;  ///< px, root of the mean square residual per redundant value
};

/// The shape: the reference of the first camera is correlated with that of each other on `mesh` (px of the
/// first), and each node lies on the first camera's line of sight through it where the others see it best,
/// z = argmin Σ_c |P_c(X(z)) + b_c − p_0 − d_0c|²_{M_c}, b_c what perspective adds between the nodes.
/// Elements that another camera does not see are left out. Errors: UsageError where cameras and references
/// differ in number or nothing is seen by all cameras; DataError where the epipolar residual is above
/// `epipolar_bound` px, which says that the calibration does not belong to the pictures.
[[nodiscard]] StereoSurface find_surface(const std::vector<Camera>& cameras,
                                         const std::vector<files::Picture>& references, const ImageMesh& mesh,
                                         const CorrelationOptions& options = {}, double epipolar_bound = 0.5);

/// The motion of a surface from what the cameras measured. Nodes that fewer than two cameras measured are
/// eliminated (their rows of the precision hold what one camera says). Errors: UsageError for sizes that do
/// not fit, NumericalError where the normal matrix is singular, a node leaves the cameras' view, or
/// Gauss–Newton does not converge.
[[nodiscard]] SurfaceMotion surface_motion(const std::vector<Camera>& cameras, const StereoSurface& surface,
                                           const std::vector<CameraMotion>& motions);

/// Green's strain of the surface in its tangent plane, E = ½ G⁺ᵀ (gᵀg − GᵀG) G⁺ with the tangents G before
/// and g after, at each node: the mean over its elements whose nodes are all measured, 0 where there is none.
/// One column a node, rows xx, yy, zz, xy, yz, xz (VTK's order) in the axes of the world. A rigid motion has
/// none.
[[nodiscard]] Eigen::MatrixXd surface_strains(const SurfacePoints& points, const SurfaceMotion& motion,
                                              const std::vector<std::array<int, 4>>& elements);

/// Where a camera sees the points, as the nodes of a mesh with the same elements.
[[nodiscard]] ImageMesh seen_mesh(const Camera& camera, const SurfacePoints& points,
                                  const std::vector<std::array<int, 4>>& elements);

}  // namespace knothe::imaging
