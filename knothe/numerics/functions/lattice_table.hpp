#pragma once
/// @file Smooth functions of two variables at many weighted points, from few evaluations.
#include <Eigen/Core>
#include <array>
#include <functional>
#include <map>
#include <vector>

#include "knothe/base/index.hpp"

namespace knothe::numerics {

/// The functions' values on a lattice over their box, halved as often as the standard deviation of the points
/// asks for, and cubic interpolation between its nodes. Nodes are kept for the next points: where these move
/// little from one call to the next, few are new. What is found does not depend on earlier calls, to the bit.
class LatticeTable {
 public:
  /// The functions at points (n × d): n × count.
  using Functions = std::function<Eigen::MatrixXd(const Eigen::MatrixXd& points)>;

  /// `lower`, `upper`: the box, d; `count`: how many functions.
  LatticeTable(const Eigen::VectorXd& lower, const Eigen::VectorXd& upper, Index count);

  /// The functions at `points` (n × d) of `weights` (n, ≥ 0): n × count. Interpolated where their third
  /// differences leave an error below 1 % of their standard deviation over the points, or below 1e-5 times
  /// the share of the weights there; evaluated elsewhere, and everywhere where the variables are not two, the
  /// points are few or the box is unbounded.
  [[nodiscard]] Eigen::MatrixXd evaluate(const Eigen::MatrixXd& points, const Eigen::VectorXd& weights,
                                         const Functions& functions);

 private:
  struct Axis {
    double lower = 0, width = 0;  ///< of the box
    int level = 0;                ///< 2^level intervals
    Index first = 0, size = 0;    ///< the nodes in use: the window

    [[nodiscard]] Index intervals() const { return Index{1} << level; }
    [[nodiscard]] double node(Index i) const;
    /// In intervals from `lower`.
    [[nodiscard]] double place_of(double x) const { return (x - lower) / width * intervals(); }
    /// The first of the four nodes from which a value at `place` is interpolated.
    [[nodiscard]] Index stencil_at(double place) const;
  };
  /// Of a point: the first node of its 4 × 4 stencil, in the window, and how many intervals beyond it is.
  struct Place {
    Index stencil;
    std::array<double, 2> beyond;
  };
  using Tile = std::array<Index, 2>;

  [[nodiscard]] bool set_levels(const Eigen::MatrixXd& points, const Eigen::VectorXd& weights);
  [[nodiscard]] bool locate(const Eigen::MatrixXd& points);
  void fill_window(const Functions& functions);
  [[nodiscard]] const Eigen::MatrixXd& values_of(const Tile& tile, const Functions& functions);
  [[nodiscard]] Eigen::MatrixXd interpolate() const;
  [[nodiscard]] std::vector<Index> find_rough(const Eigen::VectorXd& std,
                                              const Eigen::VectorXd& shares) const;
  [[nodiscard]] double third_difference(Index function, Index stencil) const;

  std::array<Axis, 2> axes_;
  bool possible_;
  Index count_;
  std::map<Tile, Eigen::MatrixXd> tiles_;  ///< of the present levels: 16 nodes × count
  std::vector<Place> places_;              ///< of the points
  std::vector<char> used_;                 ///< whether a stencil begins at a node of the window
  Eigen::MatrixXd window_;  ///< values at its nodes, the second axis fastest, × count; of those in use
};

}  // namespace knothe::numerics
