#pragma once
/// @file Functions of few variables on the nodes of a tensor grid: much of the work is common to a row.
#include <Eigen/Core>
#include <span>

#include "knothe/base/index.hpp"

namespace knothe::numerics {

/// Nodes `begin` … `end` − 1 of the last axis. `row` numbers the rows along it: with two variables the node
/// of the first axis, with three that of the second fastest. Their values begin at `at`.
struct GridRun {
  Index row, begin, end, at;
};

/// A real function of one to three variables that is cheaper on a tensor grid than point by point.
class GridEvaluator {
 public:
  virtual ~GridEvaluator() = default;
  /// Whether it is: for as many variables as it has.
  [[nodiscard]] virtual bool has_grid() const { return true; }
  /// The grid from now on, for the function as it is. `axes`: n × d, the nodes of each axis, increasing.
  virtual void set_grid(const Eigen::Ref<const Eigen::MatrixXd>& axes) = 0;
  /// Fills `value`, in which the runs lie one after the other. What a node gets depends on no other node.
  virtual void evaluate_runs(std::span<const GridRun> runs, Eigen::Ref<Eigen::VectorXd> value) = 0;

 protected:
  GridEvaluator() = default;
  GridEvaluator(const GridEvaluator&) = default;
  GridEvaluator& operator=(const GridEvaluator&) = default;
};

/// The nodes of the runs, one by one, n × d. With one variable there is one row, its nodes those of the only
/// axis.
[[nodiscard]] inline Eigen::MatrixXd nodes_of(const Eigen::Ref<const Eigen::MatrixXd>& axes,
                                              std::span<const GridRun> runs) {
  const Index last = axes.cols() - 1;
  Eigen::MatrixXd points(runs.empty() ? 0 : runs.back().at + runs.back().end - runs.back().begin,
                         axes.cols());
  for (const GridRun& run : runs) {
    const Index n = run.end - run.begin;
    for (Index k = last - 1, rest = run.row; k >= 0; --k, rest /= axes.rows())
      points.col(k).segment(run.at, n).setConstant(axes(rest % axes.rows(), k));
    points.col(last).segment(run.at, n) = axes.col(last).segment(run.begin, n);
  }
  return points;
}

}  // namespace knothe::numerics
