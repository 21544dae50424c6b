#pragma once
/// @file Where the picture is in the model, from the outline of the body: its sides are looked for in the
/// picture, and scale, turn and place are fitted to them.
#include <array>
#include <optional>
#include <string>
#include <vector>

#include "knothe/files/picture.hpp"
#include "knothe/imaging/mesh/image_mesh.hpp"
#include "knothe/imaging/mesh/registration.hpp"

namespace knothe::imaging {

/// A straight side of the outline on the model's face (m: right, up), the body to its left.
struct OutlineSide {
  std::array<double, 2> from{}, to{};
};
using Outline = std::vector<OutlineSide>;

/// The sides of a polygon, whichever way it goes round. Errors: UsageError for fewer than three corners, or
/// no area.
[[nodiscard]] Outline polygon_outline(const std::vector<std::array<double, 2>>& corners);
/// The outline of a mesh whose nodes are in metres, x to the right, y *down*: edges that belong to one
/// element, those in one line joined.
[[nodiscard]] Outline outline_of(const ImageMesh& mesh);

/// A place where an edge was looked for.
struct EdgePlace {
  double x = 0, y = 0;  ///< px: of the edge that was found
  double misfit = 0;    ///< px, from the fitted outline to it, outwards
  bool used = false;    ///< false: it does not agree with the others (a shadow, a crack, a clamp)
};

struct OutlineFit {
  std::string picture;                       ///< in which the edges were looked for
  PictureFrame frame;                        ///< with relative_scale_std
  double angle_std = 0;                      ///< rad
  std::array<double, 2> place_std{};         ///< px, right and down, of the middle of the outline in view
  double misfit = 0;                         ///< px: robust standard deviation of the edges about the outline
  int places = 0;                            ///< at which an edge was looked for: in view, away from corners
  int used = 0;                              ///< of them in the fit
  std::vector<EdgePlace> edges;              ///< found
  std::vector<std::array<double, 4>> sides;  ///< fitted outline in the picture: x, y, x, y (px)
};

struct OutlineOptions {
  /// Where to begin, right to some 20 px; without it the body must be wholly in view.
  std::optional<PictureFrame> start;
  /// Relative standard deviation of the start's scale, as one more measurement of it; 0: the edges alone
  /// tell.
  double scale_std = 0;
};

/// Fits model = slope (x − i y) + offset to the edges of a body that is brighter, darker or more textured
/// than what is behind it. Along each side, in strips of up to 24 px, the edge is the change point of the
/// most likely pair of grey-level distributions, then, line by line, where the grey level is half-way between
/// both sides (subpixel). Least squares with Tukey's weights: cracks, clamps and shadows do not count. The
/// stated deviations have the scatter of the edges and, for each side as a whole, half of it and at least
/// 0.03 px (0.29 px in a mask of two grey levels). `name` is that of the picture, for messages. Errors:
/// DataError where no edge is found, where those found do not determine scale, turn and place (it says which,
/// and what sides are seen), or do not lie on the outline.
[[nodiscard]] OutlineFit fit_outline(const files::Picture& picture, const Outline& outline,
                                     const OutlineOptions& options, const std::string& name);

/// Scale, turn and place of a body that is wholly in view, by the area, axes and centre of what stands out
/// from the border of the picture: good to some pixels. Errors: DataError where nothing stands out, or it
/// reaches out of the picture.
[[nodiscard]] PictureFrame outline_start(const files::Picture& picture, const Outline& outline,
                                         const std::string& name);

}  // namespace knothe::imaging
