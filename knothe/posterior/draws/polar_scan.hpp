#pragma once
/// @file A log-density on rings around a point, closer together the nearer they are: where else there may be
/// mass, seen from a mode, at every scale at once.
#include <Eigen/Core>
#include <vector>

#include "knothe/posterior/checked_density.hpp"

namespace knothe::posterior {

/// In one dimension points to both sides of the centre, in two points on rings, whose radii grow by a
/// constant factor: neighbours are a fixed share of their distance from the centre apart. The points of each
/// ring lie between those of the one before it, hence six neighbours.
class PolarScan {
 public:
  static constexpr Eigen::Index k_max_dimension = 2;

  /// Radii from `first` to `last`, in units of the columns of `lower` (d × d) around `centre`; neighbours are
  /// `spacing` of their distance from the centre apart.
  PolarScan(CheckedDensity& target, const Eigen::VectorXd& centre, const Eigen::MatrixXd& lower, double first,
            double last, double spacing);

  [[nodiscard]] const Eigen::MatrixXd& points() const { return points_; }  ///< n × d; the first is the centre
  [[nodiscard]] const Eigen::VectorXd& values() const { return values_; }  ///< n, log π̄
  /// n: log π̄ and the log of the volume that the point stands for. The sum over all points is the trapezoidal
  /// rule in angle and logarithm of the radius.
  [[nodiscard]] const Eigen::VectorXd& log_mass() const { return log_mass_; }
  [[nodiscard]] double log_evidence() const;
  /// Points with no neighbour of higher density.
  [[nodiscard]] std::vector<Eigen::Index> local_maxima() const;
  /// `count` points, some more than once, that stand for equal shares of the mass.
  [[nodiscard]] std::vector<Eigen::Index> sample(Eigen::Index count) const;

 private:
  Eigen::Index rings_ = 0, directions_ = 0;
  Eigen::MatrixXd points_;
  Eigen::VectorXd values_, log_mass_;
};

}  // namespace knothe::posterior
