#pragma once
/// @file Local maxima of a log-density: where the mass is, and whether there is more than one place.
#include <Eigen/Core>
#include <array>
#include <functional>
#include <vector>

#include "knothe/posterior/checked_density.hpp"

namespace knothe::posterior {

/// A local maximum and its Laplace approximation.
struct Mode {
  Eigen::VectorXd point;  ///< z
  double value = 0;       ///< log π̄ there
  Eigen::MatrixXd
      lower;  ///< L, lower triangular, L Lᵀ = (−∇² log π̄)⁻¹, regularised where that is not positive definite
  double log_mass = 0;  ///< log of the Laplace approximation of ∫ π̄ around it
};

/// Where ascents begin.
enum class ScanReach {
  near,  ///< 0 and 39 (d ≤ 2; else 79) points of scale 1 to 3: parameters come standardised. If the density
         ///< is zero at all of them, as `wide`
  wide  ///< 160 points more, whose coordinates are 10^−6.5 to 10^6.5 in size, each for itself and all alike
};

/// Spreads along the columns of `axes` (d × m) from `point`, where log π̄ is `value`: a step of as much, to
/// both sides or, beside a bound, to the one where there is density, lowers log π̄ by 0.1 to 4. `spread` [m]:
/// first guesses. Where no step does, 1e-12 to 1e12 of the axis.
void fit_spreads(CheckedDensity& target, const Eigen::VectorXd& point, double value,
                 const Eigen::MatrixXd& axes, Eigen::VectorXd& spread);

/// Ascends from the best and, if `several`, from all local maxima of a scan, all at once, by Newton steps in
/// coordinates scaled by the curvature: positive definite curvature as it is, else by the absolute values of
/// its eigenvalues, damped where the density does not rise, longer and longer where it is a straight line.
/// The same target always gives the same modes, bit by bit.
class ModeSearch {
 public:
  /// Fills `modes`, highest log_mass first, without duplicates. Errors: NumericalError if the density is zero
  /// at all points scanned.
  void run(CheckedDensity& target, bool several, std::vector<Mode>& modes, ScanReach reach = ScanReach::near);

  /// Ascends from `starts` (m × d) and adds the modes found that `modes` has not yet, in order of log_mass.
  /// Starts at which the density is zero are left out. Ascents end where they are once `is_enough`.
  void ascend_from(CheckedDensity& target, const Eigen::Ref<const Eigen::MatrixXd>& starts,
                   std::vector<Mode>& modes, const std::function<bool()>& is_enough = {});

 private:
  void scan(CheckedDensity& target, bool wide);
  void find_neighbours();
  void choose_starts(bool several);
  void ascend(CheckedDensity& target, const std::function<bool()>& is_enough = {});
  void accept(Eigen::Index i, Eigen::Index row);
  bool rescale(Eigen::Index i, Eigen::Index row, const CheckedDensity& target);
  bool newton_step(Eigen::Index i);
  void collect(CheckedDensity& target, std::vector<Mode>& modes);
  void calibrate(CheckedDensity& target, Eigen::Index climber, Mode& mode);

  /// One ascent of the lockstep.
  struct Climber {
    double damping = 0, value = 0;
    double reach = 1e3;  ///< a step along a straight line may raise log π̄ by so much
    int iterations = 0, refits = 0;
    bool active = true, fresh = true, refit = false;
  };
  Eigen::MatrixXd scan_points_;  ///< made once per dimension
  Eigen::Index near_count_ = 0;  ///< the first of them
  /// Of each of these the four nearest: a start has no better point among them.
  std::vector<std::array<Eigen::Index, 4>> neighbours_;
  Eigen::VectorXd scan_values_;
  std::vector<Eigen::Index> starts_, order_;
  std::vector<Climber> climbers_;
  Eigen::MatrixXd position_, trial_;    ///< climbers × d
  Eigen::MatrixXd gradient_, hessian_;  ///< at position_
  Eigen::MatrixXd scales_;              ///< climbers × d, for differences
  Eigen::MatrixXd batch_points_, batch_scales_;
  std::vector<Eigen::Index> batch_of_;
  LogDensityBatch batch_;
  Eigen::MatrixXd matrix_;
  Eigen::VectorXd step_, unit_;  ///< unit_: what one step of scale 1 is in each coordinate
};

}  // namespace knothe::posterior
