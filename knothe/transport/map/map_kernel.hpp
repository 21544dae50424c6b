#pragma once
/// @file A triangular map on blocks of 64 points: the fast path, for every parametrisation.
///
/// One variable after the other, for all points of a block at once:
///  - products over x_1 … x_{k−1} are shared by all components, each one multiplication from a shorter one;
///  - b_j, the coefficients of h along x_k, are sums of such products;
///  - M^k and g_j = ∫₀^{x_k} r'(h) χ_j dθ are sums over the same few nodes θ_q = x_k t_q inside the radius
///    where the tails begin, for all points at once; the few points beyond it get the rest one by one;
///  - gradients are products again: ∂M^k/∂a_{e,α} = Φ'_α g_{α_k}, ∂log r/∂a_{e,α} = Φ'_α χ_{α_k} r'/r.
/// Every point goes through the same instructions (the last block is filled up with zeros), so the result for
/// a point does not depend on its neighbours or on the number of threads.
#include <Eigen/Core>
#include <vector>

#include "knothe/transport/map/lanes.hpp"
#include "knothe/transport/map/map_structure.hpp"
#include "knothe/transport/map/product_tree.hpp"

namespace knothe::transport {

class MapKernel {
 public:
  /// Errors: those of TriangularMap(MapSpecification).
  explicit MapKernel(MapSpecification specification);
  [[nodiscard]] const MapStructure& structure() const { return structure_; }

  /// Where results go: column-major arrays of `rows` rows; null, or empty, where not wanted.
  struct Output {
    Eigen::Index rows = 0;
    double* value = nullptr;                  ///< rows × d
    double* log_determinant = nullptr;        ///< rows
    std::vector<double*> value_gradient;      ///< per component rows × (n_c + n_e)
    std::vector<double*> log_slope_gradient;  ///< per component rows × n_e
  };

  /// The map at rows `first` … `first + count` of the points; results to the same rows.
  void evaluate(const double* coefficients, const Eigen::Ref<const Eigen::MatrixXd>& points,
                Eigen::Index first, Eigen::Index count, const Output& out) const;
  /// x with M(x) = z for the same rows: Newton's method inside a bracket for all points of a block whose x_k
  /// lies inside the radius, PointEvaluation::solve for the others.
  void invert(const double* coefficients, const Eigen::Ref<const Eigen::MatrixXd>& z, Eigen::Index first,
              Eigen::Index count, Eigen::MatrixXd& x) const;

 private:
  struct Workspace;
  struct Term {
    int index;    ///< of a coefficient in Φ_e
    int product;  ///< over x_1 … x_{k−1}
  };
  void fill_functions(Eigen::Index v, bool products, Workspace& work) const;
  void collapse(const double* coefficients, Eigen::Index k, Workspace& work) const;
  void constant_part(const double* coefficients, Eigen::Index k, int count, double* gradient,
                     Eigen::Index rows, Workspace& work) const;
  void integrate(Eigen::Index k, bool gradients, Workspace& work) const;
  void integrate_tail(Eigen::Index k, int lane, int at, bool gradients, Workspace& work) const;
  void finish_component(Eigen::Index k, Workspace& work) const;
  void monotone_gradients(Eigen::Index k, int count, Eigen::Index first, const Output& out,
                          const Workspace& work) const;
  void solve_inside(Eigen::Index k, Workspace& work) const;

  MapStructure structure_;
  ProductTree constant_, monotone_;
  std::vector<std::vector<std::vector<Term>>> terms_;  ///< [k][j]: those of degree j in x_k
};

}  // namespace knothe::transport
