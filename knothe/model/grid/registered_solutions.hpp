#pragma once
/// @file Solutions of a problem with a travelling front, interpolated at equal state instead of equal time.
#include <Eigen/Core>
#include <span>
#include <vector>

#include "knothe/numerics/functions/cubic_spline.hpp"

namespace knothe::model {

/// A solution over time that begins in proportion to the time, u = t u_el.
struct History {
  std::vector<double> time;   ///< [n], increasing, the first above 0
  std::vector<double> state;  ///< [n], does not grow (a secant stiffness); constant where u = t u_el
  Eigen::MatrixXd values;     ///< u, rows × n
};

/// A front passes one element after the other. At equal time solutions of neighbouring parameters differ in
/// where it is, and what is interpolated between them is smeared. At equal state κ (of its first value) they
/// differ in when it gets there: shape and clock,
///
///   V(κ; q) = u(λ(κ; q); q) / λ(κ; q),   λ(κ; q): the time at which κ is reached,
///
/// are smooth in the parameters q, and interpolated by the splines of a tensor grid. Between two times of a
/// history V and λ are linear in κ; before the first change of the state and after the last V is constant.
class RegisteredSolutions {
 public:
  /// `nodes`: of each axis. `histories`: one for each grid point, last axis fastest. UsageError if numbers
  /// differ, or a state is not positive at first.
  RegisteredSolutions(std::span<const std::vector<double>> nodes, std::vector<History> histories);

  /// u at `times`, rows × times, for the parameters `q`.
  [[nodiscard]] Eigen::MatrixXd at(std::span<const double> q, std::span<const double> times) const;

 private:
  /// The damaged part of a history.
  struct Track {
    std::vector<double> state;  ///< falling, from 1
    std::vector<double> time;
    Eigen::MatrixXd shape;  ///< V, rows × n
  };
  static Track track_of(const History& history);
  static double clock(const Track& track, double state);

  std::vector<numerics::CubicSplineBasis> axes_;
  std::vector<Track> tracks_;
  std::vector<double> levels_;  ///< of κ, all that occur, falling
  Eigen::MatrixXd clocks_;      ///< λ, levels × tracks
};

}  // namespace knothe::model
