#pragma once
/// @file Mass that a map does not cover: the one fault that its diagnostic, independent points and effective
/// sample size cannot see, because they all live on its image (docs/explanation/transport.md).
#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

#include "knothe/base/index.hpp"
#include "knothe/posterior/mode_search.hpp"

namespace knothe::posterior {

struct MapResult;

/// How far a solve looks for mass elsewhere.
enum class ModeSearchLevel {
  none,         ///< not at all
  multi_start,  ///< ascents from several starts: a few microseconds more
  tempered      ///< also particles that come from far outside, and their evidence: thousands of evaluations
};

struct MissedModesOptions {
  ModeSearchLevel level = ModeSearchLevel::tempered;
  double mode_mass = 1e-3;  ///< a mode with this share of the mass counts
  Index particles = 0;      ///< 0: 128 (with reference_spread 64) · 2^d, 256 to 4096
  int max_moves = 5;        ///< Metropolis moves per temperature; a MapSolver asks for 3
  std::int64_t max_evaluations = 1000000;
  /// Particles begin in N(0, spread² I): for parameters that come standardised, around 2. 0: nothing is
  /// known; they begin 120 times as wide as the modes found.
  double reference_spread = 0;
  std::uint64_t seed = 1;
};

/// What was found.
struct MissedModes {
  bool found = false;
  Eigen::VectorXd mode;  ///< z of the mode left out, or of a place where mass is left out
  double share = 0;      ///< about: of the whole mass, how much the map leaves out
  std::string reason;    ///< a clause: "a second mode at z = (…) …"
  /// By the particles, if the level is `tempered` and nothing had been found before; and the map's own
  /// estimate by importance weights.
  double tempered_log_evidence = 0, tempered_log_evidence_error = 0;
  double map_log_evidence = 0, map_log_evidence_error = 0;
  bool tempered_done = false;
  /// The particles found as much mass as the map has; if not, even with four times as many, they prove
  /// nothing.
  bool tempered_conclusive = false;
  /// Scans on rings around the main mode found all mass to be the map's, so that no particles were needed.
  bool scanned = false;
};

/// `modes` are those of the solve's own search, main mode first; those found here are added.
[[nodiscard]] MissedModes look_for_missed_modes(CheckedDensity& target, const MapResult& result,
                                                ModeSearch& search, std::vector<Mode>& modes,
                                                const MissedModesOptions& options = {});

}  // namespace knothe::posterior
