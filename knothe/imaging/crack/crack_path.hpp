#pragma once
/// @file Where a crack runs. Private to the room.
///
/// First from element to element, by how far each is stretched; then from pixel to pixel, by which side's
/// motion explains them. Both are shortest paths (dynamic programming).
#include <array>
#include <optional>
#include <vector>

#include "knothe/imaging/correlation/image_correlation.hpp"
#include "knothe/imaging/correlation/residual_kernel.hpp"

namespace knothe::imaging {

/// The picture seen with the crack running along s: (t, s) is (x, y) for a crack up or down, (y, x) for one
/// across.
struct CrackView {
  bool across = false;
  [[nodiscard]] std::array<double, 2> swap(double t, double s) const {
    return across ? std::array<double, 2>{s, t} : std::array<double, 2>{t, s};
  }
};

/// Motion of one side of the crack near a place: u_t = a_0 + a_1 (t − t_0) + a_2 (s − s_0), u_s with b.
struct SideMotion {
  double t0 = 0, s0 = 0;
  std::array<double, 3> a{}, b{};
  [[nodiscard]] std::array<double, 2> at(double t, double s) const {
    return {a[0] + a[1] * (t - t0) + a[2] * (s - s0), b[0] + b[1] * (t - t0) + b[2] * (s - s0)};
  }
};

/// Reference and deformed picture of a result, as the correlation sees them, in view coordinates.
struct CrackScene {
  const ImageMesh* mesh = nullptr;
  const CorrelationResult* result = nullptr;
  ReferenceRows reference{};
  const SplineImage* deformed = nullptr;
  CrackView view;
  double element = 0;                        ///< size, px
  std::vector<std::array<double, 4>> nodes;  ///< t, s, u_t, u_s of those that are measured

  [[nodiscard]] bool inside(int t, int s) const {
    return view.across ? reference.contains(s, t) : reference.contains(t, s);
  }
  [[nodiscard]] std::size_t index(int t, int s) const {
    return view.across ? reference.index(s, t) : reference.index(t, s);
  }
  /// f − α g(x + u) − β at a pixel; nothing where it is masked or has left the picture.
  [[nodiscard]] std::optional<double> residual(int t, int s, const std::array<double, 2>& motion) const;
  /// Least squares over the measured nodes of one side (+1: larger t), from `margin` to `margin` + three
  /// elements away from the path. Nothing if there are fewer than four.
  [[nodiscard]] std::optional<SideMotion> side(double t, double s, int sign, double margin) const;
};
[[nodiscard]] CrackScene crack_scene(const ImageCorrelation& correlation, const CorrelationResult& result,
                                     bool across);

/// A path given at evenly spaced s.
struct RoughPath {
  double first = 0, step = 1;  ///< s of the first point, px
  std::vector<double> t, std;  ///< px; std of t where it was refined
  double score = 0;            ///< how much it collected, in elements that are wide open
  [[nodiscard]] double at(double s) const;
};

/// From side to side of the mesh over the elements that are stretched most; elements that were taken out
/// count as wide open.
[[nodiscard]] RoughPath stretched_path(const ImageCorrelation& correlation, const CrackScene& scene);

/// What is open like the path, but not part of it.
struct OtherOpenings {
  int count = 0;
  std::array<double, 2> middle{};  ///< px (x, y), of the largest
};
/// Elements that touch each other, more than one and a half elements from the path, stretched by a good part
/// of what the most stretched is, three elements long or more; those that lie in the path's way beyond its
/// ends do not count.
[[nodiscard]] OtherOpenings other_openings(const ImageCorrelation& correlation, const CrackScene& scene,
                                           const RoughPath& path);

/// The same path in bands of `band` px: in each the place where the motions of the two sides (extrapolated,
/// from `margin` on) change over so that the residual is least, within `search` px; Laplace prior on the
/// change from band to band. Most probable path, and the marginal standard deviation in each band.
[[nodiscard]] RoughPath refined_path(const CrackScene& scene, const RoughPath& rough, double band,
                                     double margin, double search);

}  // namespace knothe::imaging
