#pragma once
/// @file Local maxima of a log-density: where the mass is, and whether there is more than one place.
#include <Eigen/Core>
#include <vector>

#include "knothe/sampling/checked_density.hpp"

namespace knothe::sampling {

/// A local maximum and its Laplace approximation.
struct Mode {
  Eigen::VectorXd point;  ///< z
  double value = 0;       ///< log π̄ there
  Eigen::MatrixXd
      lower;  ///< L, lower triangular, L Lᵀ = (−∇² log π̄)⁻¹, regularised where that is not positive definite
  double log_mass = 0;  ///< log of the Laplace approximation of ∫ π̄ around it
};

/// Ascends from the best and, if `several`, from all local maxima of a scan of 0 and low-discrepancy points
/// of scale 1 (some 3), all at once, by damped Newton steps. The same target always gives the same modes, bit
/// by bit.
class ModeSearch {
 public:
  /// Fills `modes`, highest log_mass first, without duplicates. Errors: NumericalError if the density is zero
  /// at all points scanned.
  void run(CheckedDensity& target, bool several, std::vector<Mode>& modes);

 private:
  void scan(CheckedDensity& target);
  void choose_starts(bool several);
  void ascend(CheckedDensity& target);
  bool newton_step(Eigen::Index i);
  void collect(CheckedDensity& target, std::vector<Mode>& modes);
  void calibrate(CheckedDensity& target, Mode& mode);

  /// One ascent of the lockstep.
  struct Climber {
    double damping = 0, value = 0;
    int iterations = 0;
    bool active = true;
  };
  Eigen::MatrixXd scan_points_;  ///< made once per dimension
  Eigen::VectorXd scan_values_;
  std::vector<Eigen::Index> starts_, order_;
  std::vector<Climber> climbers_;
  Eigen::MatrixXd position_, trial_;    ///< climbers × d
  Eigen::MatrixXd gradient_, hessian_;  ///< at position_
  Eigen::MatrixXd batch_points_;
  std::vector<Eigen::Index> batch_of_;
  LogDensityBatch batch_;
  Eigen::MatrixXd matrix_;
  Eigen::VectorXd step_;
};

}  // namespace knothe::sampling
