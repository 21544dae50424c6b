#pragma once
/// @file Elastic solutions of the beam with a vertical crack of given length (Rubio et al. 2019, §6.3.2 and
/// Fig. 10).
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "knothe/offline/law/damage_law.hpp"
#include "knothe/offline/mesh/beam_mesh.hpp"

namespace knothe::offline {

/// Lengths 0, spacing, 2 spacing, … (the paper: 80 lengths, 0 to 79 mm).
struct CrackedBeamOptions {
  int count = 80;          ///< number of lengths
  double spacing = 0.001;  ///< m; also the element size along the crack line
  double growth = 1.25;    ///< ratio of neighbouring columns away from the crack line
};

/// The solutions for a *unit* downward displacement of the load strip (m per m: multiply by the imposed
/// displacement).
class CrackedBeam {
 public:
  /// The crack starts at the right corner of the notch (as `beam` meshes it: at x = half the notch's width)
  /// and goes up. The mesh is its own: columns and rows of `spacing` along the crack line, coarser away from
  /// it, up to `beam.element` and `beam.largest_element`. Nodes of the line are there twice, left and right;
  /// for each length the pairs from the tip on are tied together by a small dense system (flexibility
  /// method), so the body is factorised once. Flanks may overlap: there is no contact. Errors: ProjectError
  /// (options).
  CrackedBeam(const BeamOptions& beam, const CrackedBeamOptions& options, const ElasticConstants& elastic);

  [[nodiscard]] std::span<const double> lengths() const { return lengths_; }  ///< m
  /// Reaction of the whole beam to a unit displacement, N/m, per length: 1 / compliance.
  [[nodiscard]] std::span<const double> stiffness() const { return stiffness_; }
  /// Displacement of all dofs (3 node + component) of the crack's own mesh for length number `index`.
  [[nodiscard]] std::span<const double> solution(int index) const;
  [[nodiscard]] const HexahedronMesh& mesh() const { return mesh_; }
  /// x of the crack line, m.
  [[nodiscard]] double line() const { return line_; }

  /// Displacement component (0 x, 1 y, 2 z) at points [n, 3] for all lengths: [count, n], C order. A point on
  /// the crack line takes the value of the right flank (x from above). Throws DataError, naming the point,
  /// outside the beam.
  [[nodiscard]] std::vector<double> interpolate(std::span<const double> points,
                                                std::span<const std::int64_t> components) const;

 private:
  struct Place {
    std::array<std::int64_t, 8> nodes;
    std::array<double, 8> weights;
  };
  void make_mesh(const BeamOptions& beam, const CrackedBeamOptions& options);
  void open_line(double top);
  void solve(const ElasticConstants& elastic);
  [[nodiscard]] Place locate(const double* point) const;

  HexahedronMesh mesh_;
  std::array<std::vector<double>, 3> planes_;
  std::vector<std::int64_t> cell_at_;               ///< [x interval][y interval][z interval], -1 in the notch
  std::vector<std::array<std::int64_t, 2>> pairs_;  ///< left and right node, from below
  double line_ = 0, corner_ = 0;
  std::vector<double> lengths_, stiffness_, solutions_;
};

}  // namespace knothe::offline
