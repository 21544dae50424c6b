#include "knothe/transport/triangular_map.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>

#include "knothe/base/error.hpp"
#include "knothe/numerics/hermite.hpp"
#include "knothe/sampling/log_density.hpp"

namespace knothe::transport {

namespace {

using Values = TailedHermite::Values;

/// One of the two bases with its derivatives, in every variable, at one point.
struct Factors {
  std::vector<Values> value, first, second;

  void resize(std::size_t d) { value.resize(d), first.resize(d), second.resize(d); }
  [[nodiscard]] double at(const MultiIndex::Factor& f, int derivative) const {
    const auto v = static_cast<std::size_t>(f.variable), j = static_cast<std::size_t>(f.degree);
    return derivative == 0 ? value[v][j] : derivative == 1 ? first[v][j] : second[v][j];
  }
};

struct PointBasis {
  Factors tangent, level;  ///< for Φ_c and Φ_e

  explicit PointBasis(Eigen::Index d) {
    tangent.resize(static_cast<std::size_t>(d));
    level.resize(static_cast<std::size_t>(d));
  }
  void fill(const TailedHermite& basis, int order, Eigen::Index k, double x) {
    const auto v = static_cast<std::size_t>(k);
    basis.tangent(x, order, tangent.value[v], tangent.first[v], tangent.second[v]);
    basis.level(x, order, level.value[v], level.first[v], level.second[v]);
  }
};

/// Π of the factors in the variables below `below`; with `a`, `b` ≥ 0 differentiated in those (a == b:
/// twice). Zero where the index does not contain them.
double product(const MultiIndex& index, const Factors& factors, int below, int a = -1, int b = -1) {
  double result = 1;
  int found = 0;
  for (const auto& f : index.factors) {
    if (f.variable >= below) break;
    const int times = (f.variable == a ? 1 : 0) + (f.variable == b ? 1 : 0);
    found += times;
    result *= factors.at(f, times);
  }
  return found == (a >= 0 ? 1 : 0) + (b >= 0 ? 1 : 0) ? result : 0.0;
}

/// Φ_c a_c of component k, or a derivative of it.
double constant_part(const MapComponent& c, const double* a_c, const PointBasis& at, int k, int a = -1,
                     int b = -1) {
  double sum = 0;
  for (std::size_t m = 0; m < c.constant.size(); ++m)
    sum += a_c[m] * product(c.constant[m], at.tangent, k, a, b);
  return sum;
}

/// h(·, θ) of one point collapsed to one variable: b_j = Σ_{α: α_k = j} a_α Π_{i<k} χ_{α_i}(x_i), or a
/// derivative of it.
void collapse(const MapComponent& c, const double* a_e, const PointBasis& at, int k, int a, int b,
              Values& out, int n) {
  std::fill(out.begin(), out.begin() + n + 1, 0.0);
  for (std::size_t m = 0; m < c.monotone.size(); ++m)
    out[static_cast<std::size_t>(c.monotone[m].degree_of(k))] +=
        a_e[m] * product(c.monotone[m], at.level, k, a, b);
}

double dot(const Values& b, const Values& psi, int n) {
  double sum = 0;
  for (std::size_t j = 0; j <= static_cast<std::size_t>(n); ++j) sum += b[j] * psi[j];
  return sum;
}

/// The monotone part: ∫₀ˣ (Σ f_j χ_j)(Σ g_j χ_j) dθ.
double product_integral(const TailedHermite& basis, const Values& f, const Values& g, double x, int n) {
  const SquareRule rule(x, n, basis.radii());
  Values psi{};
  double sum = 0;
  for (std::size_t q = 0; q < static_cast<std::size_t>(rule.count); ++q) {
    numerics::normalised_hermite(rule.argument[q],
                                 std::span<double>(psi.data(), static_cast<std::size_t>(n) + 1));
    sum += rule.weight[q] * dot(f, psi, n) * dot(g, psi, n);
  }
  return sum;
}

/// All derivatives of component k at one point, into row i of `out`; x_j with j > k do not matter.
void component_derivatives(const MapComponent& c, const Eigen::VectorXd& coefficients,
                           const TailedHermite& basis, const PointBasis& at, Eigen::Index k, double x_k,
                           int order, Eigen::Index i, MapBatch& out) {
  const auto d = out.value.cols();
  const double* a_c = coefficients.data() + c.offset;
  const double* a_e = a_c + c.constant_count();
  const int n = order - 1, kk = static_cast<int>(k);
  std::vector<Values> b(static_cast<std::size_t>(k) + 1);  // ∂b/∂x_a for a < k, then b itself
  collapse(c, a_e, at, kk, -1, -1, b[static_cast<std::size_t>(k)], n);
  const Values& b0 = b[static_cast<std::size_t>(k)];
  const auto& psi = at.level.value[static_cast<std::size_t>(k)];
  const double h = dot(b0, psi, n);
  const auto constant = [&](int a, int bb) { return constant_part(c, a_c, at, kk, a, bb); };
  for (int a = 0; a < kk; ++a) {
    auto& ba = b[static_cast<std::size_t>(a)];
    collapse(c, a_e, at, kk, a, -1, ba, n);
    out.jacobian(i, k * d + a) = constant(a, -1) + 2 * product_integral(basis, b0, ba, x_k, n);
  }
  out.jacobian(i, k * d + k) = h * h;
  for (Eigen::Index a = k + 1; a < d; ++a) out.jacobian(i, k * d + a) = 0;
  if (out.hessian.size() == 0) return;
  const Eigen::Index packed = d * (d + 1) / 2;
  out.hessian.row(i).segment(k * packed, packed).setZero();
  for (int a = 0; a < kk; ++a) {
    const auto& ba = b[static_cast<std::size_t>(a)];
    out.hessian(i, k * packed + sampling::packed_index(k, a)) = 2 * h * dot(ba, psi, n);
    for (int bb = 0; bb <= a; ++bb) {
      Values bab{};
      collapse(c, a_e, at, kk, a, bb, bab, n);
      out.hessian(i, k * packed + sampling::packed_index(a, bb)) =
          constant(a, bb) + 2 * (product_integral(basis, ba, b[static_cast<std::size_t>(bb)], x_k, n) +
                                 product_integral(basis, b0, bab, x_k, n));
    }
  }
  out.hessian(i, k * packed + sampling::packed_index(k, k)) =
      2 * h * dot(b0, at.level.first[static_cast<std::size_t>(k)], n);
}

}  // namespace

void MapBatch::resize(Eigen::Index n, Eigen::Index d, int derivatives) {
  value.resize(n, d);
  log_determinant.resize(n);
  jacobian.resize(derivatives >= 1 ? n : 0, derivatives >= 1 ? d * d : 0);
  hessian.resize(derivatives >= 2 ? n : 0, derivatives >= 2 ? d * (d * (d + 1) / 2) : 0);
}

TriangularMap::TriangularMap(Eigen::Index dimension, int order, TailRadii radii)
    : basis_(radii), order_(order) {
  if (dimension < 1)
    throw UsageError(fmt::format("triangular map in {} dimensions: at least 1 is needed", dimension));
  if (order < 1 || order > k_max_order)
    throw UsageError(fmt::format("triangular map of order {}: 1 to {} are possible", order, k_max_order));
  if (!(radii.level > 0 && radii.bend > 0 && radii.tangent > 0))
    throw UsageError("triangular map: the radii of the tails must be positive");
  Eigen::Index count = 0;
  std::vector<MapComponent> components;
  for (int k = 0; k < static_cast<int>(dimension); ++k) {
    MapComponent component{total_order_indices(k, order), total_order_indices(k + 1, order - 1), count};
    count += component.constant_count() + component.monotone_count();
    components.push_back(std::move(component));
  }
  coefficients_ = Eigen::VectorXd::Zero(count);
  for (const auto& c : components) coefficients_[c.offset + c.constant_count()] = 1;  // h = 1: the identity
  components_ = std::make_shared<const std::vector<MapComponent>>(std::move(components));
}

void TriangularMap::set_coefficients(const Eigen::VectorXd& coefficients) {
  if (coefficients.size() != coefficients_.size())
    throw UsageError(fmt::format("triangular map: {} coefficients given, the map has {}", coefficients.size(),
                                 coefficients_.size()));
  if (!coefficients.allFinite()) throw UsageError("triangular map: a coefficient is not finite");
  coefficients_ = coefficients;
}

void TriangularMap::embed(const TriangularMap& lower) {
  assert(lower.dimension() == dimension() && lower.order() <= order());
  coefficients_.setZero();
  for (Eigen::Index k = 0; k < dimension(); ++k) {
    const auto &mine = component(k), &theirs = lower.component(k);
    coefficients_.segment(mine.offset, theirs.constant_count()) =
        lower.coefficients_.segment(theirs.offset, theirs.constant_count());
    coefficients_.segment(mine.offset + mine.constant_count(), theirs.monotone_count()) =
        lower.coefficients_.segment(theirs.offset + theirs.constant_count(), theirs.monotone_count());
  }
}

void TriangularMap::evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives,
                             MapBatch& out) const {
  const Eigen::Index n = points.rows(), d = dimension();
  assert(points.cols() == d);
  out.resize(n, d, derivatives);
  PointBasis at(d);
  Values b{};
  for (Eigen::Index i = 0; i < n; ++i) {
    for (Eigen::Index v = 0; v < d; ++v) at.fill(basis_, order_, v, points(i, v));
    double log_determinant = 0;
    for (Eigen::Index k = 0; k < d; ++k) {
      const MapComponent& c = component(k);
      const double* a_c = coefficients_.data() + c.offset;
      const double value = constant_part(c, a_c, at, static_cast<int>(k));
      collapse(c, a_c + c.constant_count(), at, static_cast<int>(k), -1, -1, b, order_ - 1);
      out.value(i, k) = value + product_integral(basis_, b, b, points(i, k), order_ - 1);
      log_determinant +=
          2 * std::log(std::abs(dot(b, at.level.value[static_cast<std::size_t>(k)], order_ - 1)));
      if (derivatives >= 1)
        component_derivatives(c, coefficients_, basis_, at, k, points(i, k), order_, i, out);
    }
    out.log_determinant[i] = log_determinant;
  }
}

Eigen::MatrixXd TriangularMap::evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points) const {
  MapBatch batch;
  evaluate(points, 0, batch);
  return std::move(batch.value);
}

Eigen::VectorXd TriangularMap::log_determinant(const Eigen::Ref<const Eigen::MatrixXd>& points) const {
  MapBatch batch;
  evaluate(points, 0, batch);
  return std::move(batch.log_determinant);
}

void TriangularMap::coefficient_gradients(const Eigen::Ref<const Eigen::MatrixXd>& points, Eigen::Index k,
                                          Eigen::MatrixXd& value, Eigen::MatrixXd& log_slope) const {
  const MapComponent& c = component(k);
  const Eigen::Index n = points.rows(), n_c = c.constant_count(), n_e = c.monotone_count(), d = dimension();
  const int kk = static_cast<int>(k), q = order_ - 1;
  value.resize(n, n_c + n_e);
  log_slope.setZero(n, n_c + n_e);
  PointBasis at(d);
  std::vector<double> packed(static_cast<std::size_t>(order_ * (order_ + 1) / 2));
  Values b{}, g{};
  for (Eigen::Index i = 0; i < n; ++i) {
    for (Eigen::Index v = 0; v < d; ++v) at.fill(basis_, order_, v, points(i, v));
    collapse(c, coefficients_.data() + c.offset + n_c, at, kk, -1, -1, b, q);
    basis_.product_integrals(points(i, k), q, packed);
    const auto& psi = at.level.value[static_cast<std::size_t>(k)];
    const double h = dot(b, psi, q);
    for (int j = 0; j <= q; ++j) {
      g[static_cast<std::size_t>(j)] = 0;
      for (int l = 0; l <= q; ++l)
        g[static_cast<std::size_t>(j)] +=
            packed[static_cast<std::size_t>(sampling::packed_index(j, l))] * b[static_cast<std::size_t>(l)];
    }
    for (Eigen::Index m = 0; m < n_c; ++m)
      value(i, m) = product(c.constant[static_cast<std::size_t>(m)], at.tangent, kk);
    for (Eigen::Index m = 0; m < n_e; ++m) {
      const MultiIndex& index = c.monotone[static_cast<std::size_t>(m)];
      const auto degree = static_cast<std::size_t>(index.degree_of(kk));
      const double prefix = product(index, at.level, kk);
      value(i, n_c + m) = 2 * prefix * g[degree];
      log_slope(i, n_c + m) = 2 * prefix * psi[degree] / h;
    }
  }
}

namespace {

/// t with constant + ∫₀ᵗ (Σ b_j ψ_j)² = target: an increasing function; a bracket is grown from 0, then
/// Newton's method is kept inside it by bisection.
double solve_increasing(const TailedHermite& basis, const Values& b, int n, double constant, double target) {
  const auto residual = [&](double t) { return constant - target + product_integral(basis, b, b, t, n); };
  const auto slope = [&](double t) {
    Values psi{}, first{}, second{};
    basis.level(t, n, psi, first, second);
    const double h = dot(b, psi, n);
    return h * h;
  };
  const double accuracy = 1e-15 * (1 + std::abs(target) + std::abs(constant));
  const double start = residual(0), direction = start > 0 ? -1 : 1;
  if (start == 0) return 0;
  double near = 0, far = direction;
  while (residual(far) * direction < 0 && std::abs(far) < 1e100) {
    near = far;
    far *= 2;
  }
  double low = std::min(near, far), high = std::max(near, far), t = 0.5 * (low + high);
  for (int k = 0; k < 400; ++k) {
    const double r = residual(t);
    if (std::abs(r) <= accuracy) break;
    (r < 0 ? low : high) = t;
    const double s = slope(t), newton = t - r / s;
    const double next = s > 0 && newton > low && newton < high ? newton : 0.5 * (low + high);
    if (next == t || high - low <= 4e-16 * (std::abs(low) + std::abs(high))) break;
    t = next;
  }
  return t;
}

}  // namespace

Eigen::MatrixXd TriangularMap::inverse(const Eigen::Ref<const Eigen::MatrixXd>& z) const {
  const Eigen::Index n = z.rows(), d = dimension();
  assert(z.cols() == d);
  Eigen::MatrixXd x = Eigen::MatrixXd::Zero(n, d);
  PointBasis at(d);
  Values b{};
  for (Eigen::Index i = 0; i < n; ++i)
    for (Eigen::Index k = 0; k < d; ++k) {
      const MapComponent& c = component(k);
      const double* a_c = coefficients_.data() + c.offset;
      if (k > 0) at.fill(basis_, order_, k - 1, x(i, k - 1));
      const double constant = constant_part(c, a_c, at, static_cast<int>(k));
      collapse(c, a_c + c.constant_count(), at, static_cast<int>(k), -1, -1, b, order_ - 1);
      x(i, k) = solve_increasing(basis_, b, order_ - 1, constant, z(i, k));
    }
  return x;
}

}  // namespace knothe::transport
