#include "knothe/posterior/map/map_kernel.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "knothe/base/index.hpp"
#include "knothe/posterior/map/lane_functions.hpp"
#include "knothe/posterior/map/point_evaluation.hpp"

namespace knothe::posterior {

namespace {

constexpr int k_together = 4;  ///< lanes whose sums are kept in registers

/// out = Σ_m value_m column_m, `term(m)` giving both.
template <class Term>
void weighted_sum(std::size_t count, const Term& term, Column& out) {
  for (int l = 0; l < k_block_lanes; l += k_together) {
    Lanes a{}, b{}, c{}, d{};
    for (std::size_t m = 0; m < count; ++m) {
      const auto [value, column] = term(m);
      const Lanes* x = column->lane + l;
      a += value * x[0], b += value * x[1], c += value * x[2], d += value * x[3];
    }
    out.lane[l] = a, out.lane[l + 1] = b, out.lane[l + 2] = c, out.lane[l + 3] = d;
  }
}

}  // namespace

/// All that is known of a block. Columns of the functions of one variable, then products.
struct MapKernel::Workspace {
  std::vector<Column> x;                   ///< per variable
  std::vector<Column> constant_functions;  ///< of the variable filled last
  std::vector<Column> monotone_functions;
  std::vector<Column> constant_products, monotone_products;
  std::vector<Column> b;  ///< of the component at work, per degree
  Column constant{}, value{}, log_determinant{};

  explicit Workspace(const MapKernel& kernel)
      : x(kernel.structure_.components.size()),
        constant_functions(k_max_order + 1),
        monotone_functions(k_max_order + 1),
        constant_products(kernel.constant_.products.size()),
        monotone_products(kernel.monotone_.products.size()),
        b(k_max_order + 1) {
    for (int l = 0; l < k_block_lanes; ++l)
      constant_products[0].lane[l] = monotone_products[0].lane[l] = lanes(1);
  }
};

MapKernel::MapKernel(MapSpecification specification) : structure_(std::move(specification)) {
  std::vector<const std::vector<MultiIndex>*> constant, monotone;
  for (const MapComponent& c : structure_.components) {
    constant.push_back(&c.constant);
    monotone.push_back(&c.monotone);
  }
  constant_ = ProductTree(constant);
  monotone_ = ProductTree(monotone);
  terms_.resize(structure_.components.size());
  for (Index k = 0; k < std::ssize(terms_); ++k) {
    const MapComponent& c = structure_.components[k];
    terms_[k].resize(c.degree + 1);
    for (Index m = 0; m < std::ssize(c.monotone); ++m)
      terms_[k][c.monotone[m].degree_of(k)].push_back({static_cast<int>(m), monotone_.of_index[k][m]});
  }
}

/// The functions of variable v, and the products that end with it.
void MapKernel::fill_functions(Index v, bool products, Workspace& work) const {
  const TailRadii& radii = structure_.basis.parametrisation().radii;
  const int n_c = structure_.constant_degree[v], n_e = structure_.monotone_degree[v];
  LaneValues functions;
  for (int l = 0; l < k_block_lanes; ++l) {
    lane_constant_functions(radii, work.x[v].lane[l], n_c, functions.data());
    for (int j = 0; j <= n_c; ++j) work.constant_functions[j].lane[l] = functions[j];
    lane_monotone_functions(radii, work.x[v].lane[l], n_e, functions.data());
    for (int j = 0; j <= n_e; ++j) work.monotone_functions[j].lane[l] = functions[j];
  }
  if (!products) return;
  const auto multiply = [&](const ProductTree& tree, const std::vector<Column>& factors,
                            std::vector<Column>& out) {
    for (int m = tree.begin[v]; m < tree.begin[v + 1]; ++m) {
      const ProductTree::Product& product = tree.products[m];
      const Column& shorter = out[product.parent];
      const Column& factor = factors[product.degree];
      Column& result = out[m];
      for (int l = 0; l < k_block_lanes; ++l) result.lane[l] = shorter.lane[l] * factor.lane[l];
    }
  };
  multiply(constant_, work.constant_functions, work.constant_products);
  multiply(monotone_, work.monotone_functions, work.monotone_products);
}

/// b_j = Σ_{α: α_k = j} a_α Φ'_α.
void MapKernel::collapse(const double* coefficients, Index k, Workspace& work) const {
  const MapComponent& c = structure_.components[k];
  const double* a_e = coefficients + c.offset + c.constant_count();
  const auto& groups = terms_[k];
  for (Index j = 0; j < std::ssize(groups); ++j)
    weighted_sum(
        groups[j].size(),
        [&](std::size_t m) {
          const Term& t = groups[j][m];
          return std::pair(a_e[t.index], &work.monotone_products[t.product]);
        },
        work.b[j]);
}

/// Φ_c a_c.
void MapKernel::constant_part(const double* coefficients, Index k, Workspace& work) const {
  const MapComponent& c = structure_.components[k];
  const double* a_c = coefficients + c.offset;
  weighted_sum(
      c.constant.size(),
      [&](std::size_t m) { return std::pair(a_c[m], &work.constant_products[constant_.of_index[k][m]]); },
      work.constant);
}

/// value = ∫₀^{x_k} r(h) dθ.
void MapKernel::integrate(Index k, Workspace& work) const {
  const int n = structure_.components[k].degree;
  const Rectifier rectifier = structure_.basis.parametrisation().rectifier;
  const OneVariableBasis::Piece inner = structure_.basis.pieces(n).front();
  const UnitRule& rule = unit_rule(inner.nodes);
  for (int l = 0; l < k_block_lanes; ++l) {
    const Lanes x = work.x[k].lane[l], inside = clamp(x, inner.end);
    Lanes sum{};
    LaneValues b, functions;
    for (int j = 0; j <= n; ++j) b[j] = work.b[j].lane[l];
    for (Index q = 0; q < std::ssize(rule.node); ++q) {
      lane_polynomials(inside * rule.node[q], n, functions.data());
      Lanes h = b[0];
      for (Index j = 1; j <= n; ++j) h += b[j] * functions[j];
      sum += rule.weight[q] * lane_rectify(rectifier, h);
    }
    work.value.lane[l] = inside * sum;
    for (int i = 0; i < k_lane_width; ++i)
      if (std::abs(x[i]) > inner.end) integrate_tail(k, l, i, work);
  }
}

/// Adds what lies between the inner radius and x_k, for one point.
void MapKernel::integrate_tail(Index k, int lane, int at, Workspace& work) const {
  const int n = structure_.components[k].degree;
  const OneVariableBasis& basis = structure_.basis;
  const double x = work.x[k].lane[lane][at], sign = x < 0 ? -1 : 1, length = std::abs(x);
  OneVariableBasis::Values functions{};
  double from = 0;
  bool outside = false;  // the first piece is done
  for (const OneVariableBasis::Piece& piece : basis.pieces(n)) {
    const double width = std::min(length, piece.end) - from;
    const UnitRule& rule = unit_rule(piece.nodes);
    for (std::size_t q = 0; outside && q < rule.node.size(); ++q) {
      basis.monotone(sign * (from + width * rule.node[q]), n, functions);
      double h = 0;
      for (Index j = 0; j <= n; ++j) h += work.b[j].lane[lane][at] * functions[j];
      work.value.lane[lane][at] +=
          sign * width * rule.weight[q] * rectify(basis.parametrisation().rectifier, h).value;
    }
    if (length <= piece.end) return;
    outside = true;
    from = piece.end;
  }
}

/// Slope at x_k; M^k = Φ_c a_c + the integral.
void MapKernel::finish_component(Index k, Workspace& work) const {
  const int n = structure_.components[k].degree;
  const Rectifier rectifier = structure_.basis.parametrisation().rectifier;
  for (int l = 0; l < k_block_lanes; ++l) {
    Lanes h = work.b[0].lane[l];
    for (Index j = 1; j <= n; ++j) h += work.b[j].lane[l] * work.monotone_functions[j].lane[l];
    work.value.lane[l] += work.constant.lane[l];
    work.log_determinant.lane[l] += lane_log_rectify(rectifier, h);
  }
}

namespace {

/// Points `first` … of column v, filled up with zeros.
void load(const Eigen::Ref<const Eigen::MatrixXd>& points, Index v, Index first, int count, Column& out) {
  if (count < k_block_points) out = Column{};
  std::memcpy(out.lane, points.data() + v * points.outerStride() + first, count * sizeof(double));
}

}  // namespace

void MapKernel::evaluate(const double* coefficients, const Eigen::Ref<const Eigen::MatrixXd>& points,
                         Eigen::MatrixXd& value, Eigen::VectorXd& log_determinant) const {
  const Index n = points.rows(), d = structure_.dimension();
  Workspace work(*this);
  for (Index first = 0; first < n; first += k_block_points) {
    const int here = std::min<Index>(k_block_points, n - first);
    work.log_determinant = Column{};
    for (Index k = 0; k < d; ++k) {
      load(points, k, first, here, work.x[k]);
      collapse(coefficients, k, work);
      constant_part(coefficients, k, work);
      integrate(k, work);
      fill_functions(k, k + 1 < d, work);
      finish_component(k, work);
      store(work.value, value.data() + k * n + first, here);
    }
    store(work.log_determinant, log_determinant.data() + first, here);
  }
}

/// Newton's method in [−r, r], r where the tails begin, for those points whose solution is there; the others
/// get NaN. `work.constant` holds Φ_c a_c − z.
void MapKernel::solve_inside(Index k, Workspace& work) const {
  constexpr int k_iterations = 60;
  const int n = structure_.components[k].degree;
  const Rectifier rectifier = structure_.basis.parametrisation().rectifier;
  const OneVariableBasis::Piece inner = structure_.basis.pieces(n).front();
  const double radius = inner.end;
  const UnitRule& rule = unit_rule(inner.nodes);
  for (int l = 0; l < k_block_lanes; ++l) {
    LaneValues b, functions;
    for (int j = 0; j <= n; ++j) b[j] = work.b[j].lane[l];
    const auto rectified = [&](Lanes t) {
      lane_polynomials(t, n, functions.data());
      Lanes h = b[0];
      for (Index j = 1; j <= n; ++j) h += b[j] * functions[j];
      return lane_rectify(rectifier, h);
    };
    const auto residual = [&](Lanes t) {
      Lanes sum{};
      for (Index q = 0; q < std::ssize(rule.node); ++q) sum += rule.weight[q] * rectified(t * rule.node[q]);
      return work.constant.lane[l] + t * sum;
    };
    Lanes low = lanes(-radius), high = lanes(radius);
    const Lanes at_low = residual(low), at_high = residual(high);
    const auto inside = (at_low < 0) & (at_high > 0);
    const Lanes accuracy = 1e-15 * (1 + absolute(work.constant.lane[l]));
    const Lanes rise = at_high - at_low;
    Lanes t = inside ? low - at_low * (high - low) / (inside ? rise : lanes(1)) : Lanes{};
    bool done = false;
    for (int iteration = 0; iteration < k_iterations && !done; ++iteration) {
      const Lanes r = residual(t), slope = rectified(t);
      low = r < 0 ? t : low;
      high = r < 0 ? high : t;
      const Lanes newton = t - r / (slope > 0 ? slope : lanes(1));
      const auto usable = (slope > 0) & (newton > low) & (newton < high);
      const Lanes next = usable ? newton : 0.5 * (low + high);
      const auto stop = (absolute(r) <= accuracy) | (absolute(next - t) <= 2e-16 * absolute(t));
      const auto finished = stop | ~inside;
      done = true;
      for (int i = 0; i < k_lane_width; ++i) done = done && finished[i] != 0;
      t = stop ? t : next;
    }
    const Lanes r = residual(t);
    const auto solved = inside & (absolute(r) <= 1e-12 * (1 + absolute(work.constant.lane[l])));
    work.x[k].lane[l] = solved ? t : lanes(std::numeric_limits<double>::quiet_NaN());
  }
}

void MapKernel::invert(const double* coefficients, const Eigen::Ref<const Eigen::MatrixXd>& z,
                       Eigen::MatrixXd& x) const {
  const Index n = z.rows(), d = structure_.dimension();
  Workspace work(*this);
  PointEvaluation point(structure_, coefficients);
  Column target;
  for (Index first = 0; first < n; first += k_block_points) {
    const int here = std::min<Index>(k_block_points, n - first);
    for (Index k = 0; k < d; ++k) {
      load(z, k, first, here, target);
      collapse(coefficients, k, work);
      constant_part(coefficients, k, work);
      for (int l = 0; l < k_block_lanes; ++l) work.constant.lane[l] -= target.lane[l];
      solve_inside(k, work);
      double* solution = x.data() + k * n + first;
      store(work.x[k], solution, here);
      for (int i = 0; i < here; ++i)
        if (std::isnan(solution[i])) {
          for (Index v = 0; v < k; ++v) point.set(v, x(first + i, v));
          solution[i] = point.solve(k, z(first + i, k));
        }
      load(x, k, first, here, work.x[k]);
      if (k + 1 < d) fill_functions(k, true, work);
    }
  }
}

}  // namespace knothe::posterior
