#include "knothe/posterior/map/point_evaluation.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "knothe/base/index.hpp"
#include "knothe/posterior/log_density.hpp"
#include "knothe/posterior/map/rectifier.hpp"

namespace knothe::posterior {

namespace {

using Values = PointEvaluation::Values;

double dot(const Values& b, const Values& functions, int n) {
  double sum = 0;
  for (Index j = 0; j <= n; ++j) sum += b[j] * functions[j];
  return sum;
}

}  // namespace

double PointEvaluation::Factors::at(const MultiIndex::Factor& f, int derivative) const {
  const std::size_t v = f.variable, j = f.degree;
  return derivative == 0 ? value[v][j] : derivative == 1 ? first[v][j] : second[v][j];
}

/// Π of the factors in the variables below `below`; with `a`, `b` ≥ 0 differentiated in those. Zero where the
/// index does not contain them.
double PointEvaluation::Factors::product(const MultiIndex& index, int below, int a, int b) const {
  double result = 1;
  int found = 0;
  for (const auto& f : index.factors) {
    if (f.variable >= below) break;
    const int times = (f.variable == a ? 1 : 0) + (f.variable == b ? 1 : 0);
    found += times;
    result *= at(f, times);
  }
  return found == (a >= 0 ? 1 : 0) + (b >= 0 ? 1 : 0) ? result : 0.0;
}

PointEvaluation::PointEvaluation(const MapStructure& structure, const double* coefficients)
    : structure_(structure), coefficients_(coefficients), x_(structure.components.size()) {
  for (Factors* factors : {&constant_, &monotone_}) {
    factors->value.resize(x_.size());
    factors->first.resize(x_.size());
    factors->second.resize(x_.size());
  }
}

void PointEvaluation::set(Index variable, double x) {
  const std::size_t v = variable;
  x_[v] = x;
  structure_.basis.constant(x, structure_.constant_degree[v], constant_.value[v], constant_.first[v],
                            constant_.second[v]);
  structure_.basis.monotone(x, structure_.monotone_degree[v], monotone_.value[v], monotone_.first[v],
                            monotone_.second[v]);
}

double PointEvaluation::constant_part(Index k, int a, int b) const {
  const MapComponent& c = structure_.components[k];
  const double* a_c = coefficients_ + c.offset;
  double sum = 0;
  for (Index m = 0; m < std::ssize(c.constant); ++m)
    sum += a_c[m] * constant_.product(c.constant[m], k, a, b);
  return sum;
}

void PointEvaluation::collapse(Index k, Values& out, int a, int b) const {
  const MapComponent& c = structure_.components[k];
  const double* a_e = coefficients_ + c.offset + c.constant_count();
  const int variable = k;
  std::fill(out.begin(), out.begin() + c.degree + 1, 0.0);
  for (Index m = 0; m < std::ssize(c.monotone); ++m)
    out[c.monotone[m].degree_of(variable)] += a_e[m] * monotone_.product(c.monotone[m], variable, a, b);
}

/// ∂_a M = ∂_a C + ∫ r' ∂_a h,  ∂_ab M = ∂_ab C + ∫ (r'' ∂_a h ∂_b h + r' ∂_ab h),  ∂_k M = r(h(x_k)),
/// ∂_ka M = r' ∂_a h,  ∂_kk M = r' h'.
void PointEvaluation::derivatives(Index k, bool with_second, Derivatives& out) {
  const int kk = k, n = structure_.components[k].degree;
  const Rectifier rectifier = structure_.basis.parametrisation().rectifier;
  Values b{}, functions{};
  std::vector<Values> b_a(k), b_ab(with_second ? k * (k + 1) / 2 : 0);
  std::vector<double> h_a(k);
  out.first.assign(k + 1, 0);
  out.second.assign(with_second ? (k + 1) * (k + 2) / 2 : 0, 0);
  const auto entry = [&](int a, int c) -> double& { return out.second[packed_index(a, c)]; };

  collapse(k, b);
  out.value = constant_part(k);
  for (int a = 0; a < kk; ++a) {
    collapse(k, b_a[a], a);
    out.first[a] = constant_part(k, a);
    for (int c = 0; with_second && c <= a; ++c) {
      collapse(k, b_ab[packed_index(a, c)], a, c);
      entry(a, c) = constant_part(k, a, c);
    }
  }
  structure_.basis.integration_rule(x_[k], n, rule_);
  for (Index q = 0; q < std::ssize(rule_.node); ++q) {
    structure_.basis.monotone(rule_.node[q], n, functions);
    const Rectified r = rectify(rectifier, dot(b, functions, n));
    const double w = rule_.weight[q];
    out.value += w * r.value;
    for (int a = 0; a < kk; ++a) {
      h_a[a] = dot(b_a[a], functions, n);
      out.first[a] += w * r.first * h_a[a];
      for (int c = 0; with_second && c <= a; ++c)
        entry(a, c) +=
            w * (r.second * h_a[a] * h_a[c] + r.first * dot(b_ab[packed_index(a, c)], functions, n));
    }
  }
  const Values& here = monotone_.value[k];
  const double h = dot(b, here, n);
  const Rectified r = rectify(rectifier, h);
  out.log_slope = log_rectified(rectifier, h);
  out.first[k] = r.value;
  if (!with_second) return;
  for (int a = 0; a < kk; ++a) entry(kk, a) = r.first * dot(b_a[a], here, n);
  entry(kk, kk) = r.first * dot(b, monotone_.first[k], n);
}

double PointEvaluation::solve(Index k, double target) {
  const int n = structure_.components[k].degree;
  const Rectifier rectifier = structure_.basis.parametrisation().rectifier;
  Values b{}, functions{};
  collapse(k, b);
  const double constant = constant_part(k);
  const auto rectified = [&](double t) {
    structure_.basis.monotone(t, n, functions);
    return rectify(rectifier, dot(b, functions, n)).value;
  };
  const auto residual = [&](double t) {
    structure_.basis.integration_rule(t, n, rule_);
    double sum = constant - target;
    for (Index q = 0; q < std::ssize(rule_.node); ++q) sum += rule_.weight[q] * rectified(rule_.node[q]);
    return sum;
  };
  const double accuracy = 1e-15 * (1 + std::abs(target) + std::abs(constant));
  // From where a map near the identity has it. Newton's steps, while no bracket is known not too long.
  constexpr double k_infinity = std::numeric_limits<double>::infinity();
  double low = -k_infinity, high = k_infinity, t = target - constant;
  for (int iteration = 0; iteration < 400 && std::abs(t) < 1e100; ++iteration) {
    const double r = residual(t);
    if (std::abs(r) <= accuracy) break;
    (r < 0 ? low : high) = t;
    const double slope = rectified(t), newton = t - r / slope, longest = 4 * (1 + std::abs(t));
    double next = newton;
    if (high - low < k_infinity) {
      if (!(slope > 0 && newton > low && newton < high)) next = 0.5 * (low + high);
      if (high - low <= 4e-16 * (std::abs(low) + std::abs(high))) break;
    } else if (!(slope > 0 && std::abs(newton - t) < longest)) {
      next = t + (r < 0 ? longest : -longest);
    }
    if (next == t) break;
    t = next;
  }
  return t;
}

}  // namespace knothe::posterior
