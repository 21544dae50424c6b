#pragma once
/// @file A triangular map on blocks of 64 points: the fast path, for every rectifier and index set.
///
/// One variable after the other, for all points of a block at once:
///  - products over x_1 … x_{k−1} are shared by all components, each one multiplication from a shorter one;
///  - b_j, the coefficients of h along x_k, are sums of such products;
///  - M^k is a sum over a few nodes θ_q = x_k t_q inside the radius where the tails begin, for all points at
///    once; the few points beyond it get the rest one by one.
/// Every point goes through the same instructions (the last block is filled up with zeros), so the result for
/// a point does not depend on its neighbours.
#include <Eigen/Core>
#include <vector>

#include "knothe/base/index.hpp"
#include "knothe/posterior/map/lanes.hpp"
#include "knothe/posterior/map/map_structure.hpp"
#include "knothe/posterior/map/product_tree.hpp"

namespace knothe::posterior {

class MapKernel {
 public:
  /// Errors: those of TriangularMap(MapSpecification).
  explicit MapKernel(MapSpecification specification);
  [[nodiscard]] const MapStructure& structure() const { return structure_; }

  /// The map at n points (n × d): value (n × d) and log-determinant (n), which have their size already.
  void evaluate(const double* coefficients, const Eigen::Ref<const Eigen::MatrixXd>& points,
                Eigen::MatrixXd& value, Eigen::VectorXd& log_determinant) const;
  /// x (n × d, sized) with M(x) = z: Newton's method inside a bracket for all points of a block whose x_k
  /// lies inside the radius, PointEvaluation::solve for the others.
  void invert(const double* coefficients, const Eigen::Ref<const Eigen::MatrixXd>& z,
              Eigen::MatrixXd& x) const;

 private:
  struct Workspace;
  struct Term {
    int index;    ///< of a coefficient in Φ_e
    int product;  ///< over x_1 … x_{k−1}
  };
  void fill_functions(Index v, bool products, Workspace& work) const;
  void collapse(const double* coefficients, Index k, Workspace& work) const;
  void constant_part(const double* coefficients, Index k, Workspace& work) const;
  void integrate(Index k, Workspace& work) const;
  void integrate_tail(Index k, int lane, int at, Workspace& work) const;
  void finish_component(Index k, Workspace& work) const;
  void solve_inside(Index k, Workspace& work) const;

  MapStructure structure_;
  ProductTree constant_, monotone_;
  std::vector<std::vector<std::vector<Term>>> terms_;  ///< [k][j]: those of degree j in x_k
};

}  // namespace knothe::posterior
