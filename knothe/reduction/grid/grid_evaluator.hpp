#pragma once
/// @file Functions of two variables on the nodes of a tensor grid: much of the work is common to a row.
#include <Eigen/Core>
#include <span>

namespace knothe::reduction {

/// Nodes `begin` … `end` − 1 of the second axis, at node `row` of the first one. Their values begin at `at`.
struct GridRun {
  Eigen::Index row, begin, end, at;
};

/// A real function of two variables that is cheaper on a tensor grid than point by point.
class GridEvaluator {
 public:
  virtual ~GridEvaluator() = default;
  /// `axes`: n × 2, the nodes of each axis, increasing. Fills `value`, in which the runs lie one after the
  /// other.
  virtual void evaluate_on_grid(const Eigen::Ref<const Eigen::MatrixXd>& axes, std::span<const GridRun> runs,
                                Eigen::Ref<Eigen::VectorXd> value) = 0;

 protected:
  GridEvaluator() = default;
  GridEvaluator(const GridEvaluator&) = default;
  GridEvaluator& operator=(const GridEvaluator&) = default;
};

/// The nodes of the runs, one by one, n × d. With one variable there is one row, its nodes those of the only
/// axis.
[[nodiscard]] inline Eigen::MatrixXd nodes_of(const Eigen::Ref<const Eigen::MatrixXd>& axes,
                                              std::span<const GridRun> runs) {
  Eigen::MatrixXd points(runs.empty() ? 0 : runs.back().at + runs.back().end - runs.back().begin,
                         axes.cols());
  for (const GridRun& run : runs) {
    const Eigen::Index n = run.end - run.begin;
    if (axes.cols() == 2) points.col(0).segment(run.at, n).setConstant(axes(run.row, 0));
    points.col(axes.cols() - 1).segment(run.at, n) = axes.col(axes.cols() - 1).segment(run.begin, n);
  }
  return points;
}

}  // namespace knothe::reduction
