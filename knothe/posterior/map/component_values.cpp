#include <cmath>

#include "knothe/base/index.hpp"
#include "knothe/posterior/log_density.hpp"
#include "knothe/posterior/map/point_tables.hpp"
#include "knothe/posterior/map/rectifier.hpp"

namespace knothe::posterior {

namespace {

/// r, r' and r'' at many h, with Eigen's vectorised functions; the same values as `rectify`.
void rectify_all(Rectifier rectifier, const Eigen::VectorXd& h, int derivatives, Eigen::VectorXd& zeroth,
                 Eigen::VectorXd& first, Eigen::VectorXd& second) {
  if (rectifier == Rectifier::softplus) {
    second = (-h.array().abs()).exp();  // e^{−|h|}
    zeroth = k_softplus_scale * (h.array().cwiseMax(0.0) + (1 + second.array()).log());
    if (derivatives < 1) return;
    first = k_softplus_scale / (1 + second.array());
    second.array() *= first.array();
    first = (h.array() >= 0).select(first, second);
    if (derivatives >= 2) second.array() /= 1 + (-h.array().abs()).exp();
    return;
  }
  const auto inside = h.array().cwiseMin(k_exponential_limit);
  first = inside.exp();
  zeroth = first.array() * (1 + h.array() - inside);
  if (derivatives >= 2) second = (h.array() > k_exponential_limit).select(0, first);
}

}  // namespace

void ComponentValues::evaluate_slope(const PointTables& tables, const MapLayout& layout, Index k,
                                     const Eigen::VectorXd& coefficients) {
  const auto& c = layout.component(k);
  const auto& prefix = tables.prefix(k);
  const auto& psi = tables.psi(k);
  const Index n = prefix.rows(), degrees = c.degrees();
  b.resize(n, degrees);
  h.resize(n);
  for (Index j = 0; j < degrees; ++j) {
    const auto& group = c.groups[j];
    const double* a = coefficients.data() + c.monotone_begin() + group.begin;
    auto column = b.col(j);
    std::size_t m = 0;
    if (!group.column.empty() && group.column[0] == 0)
      column.setConstant(a[m++]);  // the first column of prefix is 1
    else
      column.setZero();
    for (; m < group.column.size(); ++m) column += a[m] * prefix.col(group.column[m]);
    if (j == 0)
      h = column;  // ψ_0 = 1
    else
      h.array() += column.array() * psi.col(j).array();
  }
}

bool ComponentValues::evaluate(const PointTables& tables, const MapLayout& layout, Index k,
                               const Eigen::VectorXd& coefficients, int derivatives) {
  evaluate_slope(tables, layout, k, coefficients);
  const Rectifier rectifier = tables.rectifier();
  if (rectifier == Rectifier::square)
    square(tables, k);
  else
    integrate(tables, k, derivatives);
  const auto& c = layout.component(k);
  const auto& prefix = tables.constant_prefix(k);
  for (Index m = 0; m < c.constant_count; ++m) value += coefficients[c.offset + m] * prefix.col(m);
  logarithm(rectifier, derivatives);
  return rectifier != Rectifier::square || h.minCoeff() > 0;
}

void ComponentValues::square(const PointTables& tables, Index k) {
  const auto& integrals = tables.integrals(k);
  const Index degrees = b.cols();
  g.resize(b.rows(), degrees);
  value.setZero(b.rows());
  for (Index j = 0; j < degrees; ++j) {
    auto column = g.col(j).array();
    column = 2 * integrals.col(packed_index(j, 0)).array() * b.col(0).array();
    for (Index l = 1; l < degrees; ++l)
      column += 2 * integrals.col(packed_index(j, l)).array() * b.col(l).array();
    value.array() += 0.5 * b.col(j).array() * column;
  }
}

void ComponentValues::integrate(const PointTables& tables, Index k, int derivatives) {
  const Index n = b.rows(), degrees = b.cols(), packed = degrees * (degrees + 1) / 2;
  value.setZero(n);
  if (derivatives >= 1) g.setZero(n, degrees);
  if (derivatives >= 2) curvature.setZero(n, packed);
  for (const auto& piece : tables.pieces(k)) {
    const auto rows = std::ssize(piece.rows);
    local_b_ = b(piece.rows, Eigen::all);
    local_value_.setZero(rows);
    if (derivatives >= 1) local_g_.setZero(rows, degrees);
    if (derivatives >= 2) local_curvature_.setZero(rows, packed);
    for (Index q = 0; q < piece.nodes; ++q) {
      const auto psi = piece.psi.middleCols(q * degrees, degrees);
      const auto weight = piece.weight.col(q).array();
      node_h_ = local_b_.col(0);
      for (Index j = 1; j < degrees; ++j) node_h_.array() += local_b_.col(j).array() * psi.col(j).array();
      rectify_all(tables.rectifier(), node_h_, derivatives, zeroth_, first_, second_);
      local_value_.array() += weight * zeroth_.array();
      if (derivatives < 1) continue;
      first_.array() *= weight;
      for (Index j = 0; j < degrees; ++j) local_g_.col(j).array() += first_.array() * psi.col(j).array();
      if (derivatives < 2) continue;
      second_.array() *= weight;
      for (Index j = 0; j < degrees; ++j) {
        first_ = second_.cwiseProduct(psi.col(j));
        for (Index l = 0; l <= j; ++l)
          local_curvature_.col(packed_index(j, l)).array() += first_.array() * psi.col(l).array();
      }
    }
    value(piece.rows) += local_value_;
    if (derivatives >= 1) g(piece.rows, Eigen::all) += local_g_;
    if (derivatives >= 2) curvature(piece.rows, Eigen::all) += local_curvature_;
  }
}

void ComponentValues::logarithm(Rectifier rectifier, int derivatives) {
  if (rectifier == Rectifier::square) {
    log_slope = 2 * h.array().abs().log();
    if (derivatives >= 1) log_slope_first = 2 / h.array();
    if (derivatives >= 2) log_slope_second = -0.5 * log_slope_first.array().square();
    return;
  }
  const Index n = h.size();
  log_slope.resize(n), log_slope_first.resize(n), log_slope_second.resize(n);
  for (Index i = 0; i < n; ++i) {
    log_slope[i] = log_rectified(rectifier, h[i]);
    if (derivatives < 1) continue;
    // (log r)'' = r''/r − (r'/r)²; far out r = eʰ for the softplus, h itself for the exponential.
    const double slope = log_rectified_slope(rectifier, h[i]);
    log_slope_first[i] = slope;
    const Rectified r = rectify(rectifier, h[i]);
    const bool is_linear = rectifier == Rectifier::exponential ? h[i] <= k_exponential_limit : h[i] < -30;
    log_slope_second[i] = is_linear ? 0 : r.second / r.value - slope * slope;
  }
}

}  // namespace knothe::posterior
