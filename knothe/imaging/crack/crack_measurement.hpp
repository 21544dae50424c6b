#pragma once
/// @file Path, opening and tip of a crack, measured in a picture, with their uncertainty.
///
/// Three steps, each of its own (docs/explanation/imaging.md): where the crack runs (crack_path.hpp), how far
/// its two sides have moved apart along it (crack_opening.hpp), and where that ends (crack_tip.hpp).
#include <array>
#include <optional>
#include <string>
#include <vector>

#include "knothe/imaging/correlation/image_correlation.hpp"

namespace knothe::imaging {

struct CrackSearchOptions {
  /// px on either side of the path that are not looked at: the torn edge, or half the width of a band of
  /// damage. 0: 3 px.
  double gap = 0;
  double reach =
      0;  ///< px of each side, from the gap on, whose motion is measured; 0: one and a half elements
  double band = 0;  ///< px along the crack over which one opening is measured; 0: half an element
  /// Place in the reference picture from which lengths count, e.g. the end of a notch: the nearest point of
  /// the path. Without it: where the path enters the mesh.
  std::optional<std::array<double, 2>> origin;
};

/// A piece of the crack's path, in the reference picture.
struct CrackPoint {
  double x = 0, y = 0;      ///< px
  double position_std = 0;  ///< px, across the path
  double along = 0;         ///< arc length from the mouth or the origin, px
  double opening = 0;      ///< of one side against the other along the direction in which the crack opens, px
  double opening_std = 0;  ///< px
  double sliding = 0;      ///< the same across that direction, px
  bool measured = false;   ///< false: too few pixels, or the sides could not be followed
};

struct CrackMeasurement {
  bool found = false;
  /// Natural log of the evidence for a crack that ends somewhere in the mesh against none at all.
  double log_evidence = 0;
  /// False: it runs through the mesh to its other side; `length` is then the path's and says "at least".
  bool tip_in_view = false;
  std::vector<CrackPoint> path;       ///< from the mouth on, beyond the tip to the other side of the mesh
  std::array<double, 2> tip{};        ///< px, where the path has the mean length
  std::array<double, 2> mouth{};      ///< px, where the crack enters the mesh
  std::array<double, 2> direction{};  ///< unit vector in which the far side opens
  double length = 0,
         length_std = 0;  ///< arc length from mouth or origin to tip, px: posterior mean, deviation
  std::array<double, 2> interval{};  ///< of the length, 95 %, px
  double mouth_opening = 0;          ///< px, of the first piece that was measured
  /// Places that are open like a crack but do not belong to the path, three elements long or more: branches,
  /// or a second crack. They are not measured.
  int others = 0;
  std::array<double, 2> other{};  ///< px, the middle of the largest
  std::string message;            ///< why none was found, or what is to be known of it; empty otherwise
};

/// The crack in the picture that `correlation` measured last, with that result. `gamma`: noise of one
/// picture, grey levels. It looks for one crack that comes in at a side of the mesh and runs, without turning
/// back, up, down, left or right; branches are not followed. A numerical outcome ("no crack") is in the
/// result. Errors: UsageError for gamma ≤ 0 or negative options.
[[nodiscard]] CrackMeasurement measure_crack(const ImageCorrelation& correlation,
                                             const CorrelationResult& result, double gamma,
                                             double reference_count = 1,
                                             const CrackSearchOptions& options = {});

}  // namespace knothe::imaging
