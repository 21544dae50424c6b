#include "knothe/posterior/map/solve/kl_objective.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"

namespace knothe::posterior {

namespace {

/// Above this many entries the tables of second derivatives are not made (512 MB).
constexpr double k_max_pair_entries = 64.0 * 1024 * 1024;

/// ∂h/∂a_e at all points: the products Φ_e, n × n_e.
void monotone_products(const PointTables& points, const MapLayout::Component& c, Index k,
                       Eigen::MatrixXd& out) {
  out.resize(points.points().rows(), c.monotone_count);
  for (Index j = 0; j < c.degrees(); ++j) {
    const auto& group = c.groups[j];
    for (Index m = 0; m < group.size(); ++m)
      out.col(group.begin + m) = points.prefix(k).col(group.column[m]).cwiseProduct(points.psi(k).col(j));
  }
}

}  // namespace

TrainingTables::TrainingTables(numerics::PointRule training_rule, const TriangularMap& map)
    : rule(std::move(training_rule)), layout(map), points(rule.points, map, layout) {
  log_reference = standard_normal_log_density(rule.points);
  if (points.rectifier() != Rectifier::square) return;
  double pairs = 0;
  for (const auto& c : layout.components())
    pairs += 0.5 * (c.monotone_count * (c.monotone_count + 1) * size());
  if (pairs > k_max_pair_entries) return;
  std::vector<Index> degree, column;
  for (Index k = 0; k < rule.points.cols(); ++k) {
    const auto& c = layout.component(k);
    degree.clear(), column.clear();
    for (Index j = 0; j < c.degrees(); ++j)
      for (const Index m : c.groups[j].column) degree.push_back(j), column.push_back(m);
    Eigen::MatrixXd pair(size(), c.monotone_count * (c.monotone_count + 1) / 2);
    for (Index a = 0; a < c.monotone_count; ++a)
      for (Index b = 0; b <= a; ++b) {
        pair.col(packed_index(a, b)) = 2 * points.prefix(k).col(column[a]).array() *
                                       points.prefix(k).col(column[b]).array() *
                                       points.integrals(k).col(packed_index(degree[a], degree[b])).array();
      }
    pair_basis.push_back(std::move(pair));
  }
}

void KullbackLeiblerObjective::begin(const TrainingTables& tables, const AffineMap& pre_map,
                                     CheckedDensity& target, double highest_log_density) {
  const auto d = std::ssize(tables.layout.components());
  if (pre_map.dimension() != d || target.dimension() != d)
    throw UsageError(
        fmt::format("Kullback-Leibler objective: a map in {} variables, a pre-map in {} and a density in {}",
                    d, pre_map.dimension(), target.dimension()));
  tables_ = &tables;
  target_ = &target;
  matrix_ = pre_map.matrix();
  offset_ = pre_map.shift;
  pre_log_determinant_ = pre_map.log_determinant();
  floor_ = highest_log_density - 1000;
  const std::size_t components = d;
  component_.resize(components), step_component_.resize(components);
  sensitivity_.resize(components), log_basis_.resize(components);
  last_.resize(0), curvature_at_.resize(0);
}

bool KullbackLeiblerObjective::map_points(const Eigen::VectorXd& a, int derivatives) {
  const Index n = tables_->size(), d = matrix_.rows();
  log_determinant_.setConstant(n, pre_log_determinant_);
  for (Index k = 0; k < d; ++k) {
    auto& c = component_[k];
    if (!c.evaluate(tables_->points, tables_->layout, k, a, derivatives)) return false;
    log_determinant_ += c.log_slope;
  }
  z_.resize(n, d);
  for (Index i = 0; i < d; ++i) {
    z_.col(i).setConstant(offset_[i]);
    for (Index j = 0; j < d; ++j)
      if (matrix_(i, j) != 0) z_.col(i) += matrix_(i, j) * component_[j].value;
  }
  return std::isfinite(z_.sum()) && std::isfinite(log_determinant_.sum());
}

void KullbackLeiblerObjective::pull_back(int derivatives) {
  const Index n = z_.rows(), d = z_.cols();
  const auto& w = tables_->rule.weights;
  const auto& m = matrix_;
  for (Index i = 0; i < n; ++i) {
    if (batch_.value[i] != -std::numeric_limits<double>::infinity()) continue;
    batch_.value[i] = floor_;
    if (derivatives >= 1) batch_.gradient.row(i).setZero();
    if (derivatives >= 2) batch_.hessian.row(i).setZero();
  }
  if (derivatives >= 1) {  // slope = −w ∘ (∇ log π̄ · A)
    slope_.setZero(n, d);
    for (Index k = 0; k < d; ++k) {
      for (Index i = 0; i < d; ++i)
        if (m(i, k) != 0) slope_.col(k) += m(i, k) * batch_.gradient.col(i);
      slope_.col(k).array() *= -w.array();
    }
  }
  if (derivatives >= 2) {  // curvature = −w ∘ (Aᵀ ∇² log π̄ A)
    curvature_.setZero(n, d * (d + 1) / 2);
    for (Index a = 0; a < d; ++a)
      for (Index b = 0; b <= a; ++b) {
        auto entry = curvature_.col(packed_index(a, b));
        for (Index i = 0; i < d; ++i)
          for (Index j = 0; j <= i; ++j) {
            const double f = i == j ? m(i, a) * m(i, b) : m(i, a) * m(j, b) + m(j, a) * m(i, b);
            if (f != 0) entry += f * batch_.hessian.col(packed_index(i, j));
          }
        entry.array() *= -w.array();
      }
  }
}

/// Adds Σ_j prefixᵀ adjoint_j, by groups, to the coefficients a_e, and constant_prefixᵀ outer to a_c.
static void add_adjoint(const PointTables& points, const MapLayout::Component& c, Index k,
                        const Eigen::Ref<const Eigen::VectorXd>& constant, const Eigen::MatrixXd& adjoint,
                        Eigen::VectorXd& out) {
  out.segment(c.offset, c.constant_count).noalias() = points.constant_prefix(k).transpose() * constant;
  const auto& prefix = points.prefix(k);
  for (Index j = 0; j < c.degrees(); ++j) {
    const auto& group = c.groups[j];
    for (Index m = 0; m < group.size(); ++m)
      out[c.monotone_begin() + group.begin + m] = prefix.col(group.column[m]).dot(adjoint.col(j));
  }
}

void KullbackLeiblerObjective::fill_gradient(Eigen::VectorXd& gradient) {
  const auto& w = tables_->rule.weights;
  for (Index k = 0; k < matrix_.cols(); ++k) {
    const auto& values = component_[k];
    scratch_ = -w.array() * values.log_slope_first.array();
    adjoint_.resize(w.size(), values.b.cols());
    for (Index j = 0; j < adjoint_.cols(); ++j)
      adjoint_.col(j) = slope_.col(k).array() * values.g.col(j).array() +
                        scratch_.array() * tables_->points.psi(k).col(j).array();
    add_adjoint(tables_->points, tables_->layout.component(k), k, slope_.col(k), adjoint_, gradient);
  }
}

auto KullbackLeiblerObjective::curvature_of_map(Index k, Index j, Index l) const {
  const bool square = tables_->points.rectifier() == Rectifier::square;
  const Eigen::MatrixXd& table = square ? tables_->points.integrals(k) : component_[k].curvature;
  return (square ? 2.0 : 1.0) * table.col(packed_index(j, l)).array();
}

/// Σ_i slope_i ∂²M^k/∂a_e∂a_e into the corner of component k.
void KullbackLeiblerObjective::add_map_curvature(Index k, Eigen::MatrixXd& hessian) {
  const auto& c = tables_->layout.component(k);
  auto corner = hessian.block(c.monotone_begin(), c.monotone_begin(), c.monotone_count, c.monotone_count);
  if (!tables_->pair_basis.empty()) {
    scratch_.noalias() = tables_->pair_basis[k].transpose() * slope_.col(k);
    for (Index a = 0; a < c.monotone_count; ++a)
      for (Index b = 0; b <= a; ++b) {
        corner(a, b) += scratch_[packed_index(a, b)];
        if (b < a) corner(b, a) += scratch_[packed_index(a, b)];
      }
    return;
  }
  const auto& prefix = tables_->points.prefix(k);
  for (Index j = 0; j < c.degrees(); ++j)
    for (Index l = 0; l <= j; ++l) {
      const auto &row = c.groups[j], &column = c.groups[l];
      scratch_ = slope_.col(k).array() * curvature_of_map(k, j, l);
      scaled_ = prefix(Eigen::all, column.column);
      scaled_.array().colwise() *= scratch_.array();
      block_.noalias() = prefix(Eigen::all, row.column).transpose() * scaled_;
      corner.block(row.begin, column.begin, row.size(), column.size()) += block_;
      if (l < j) corner.block(column.begin, row.begin, column.size(), row.size()) += block_.transpose();
    }
}

void KullbackLeiblerObjective::fill_hessian(Eigen::MatrixXd& hessian) {
  const Index d = matrix_.cols();
  const auto& w = tables_->rule.weights;
  const auto& points = tables_->points;
  for (Index k = 0; k < d; ++k) {
    const auto& c = tables_->layout.component(k);
    auto& s = sensitivity_[k];
    s.resize(w.size(), c.count());
    s.leftCols(c.constant_count) = points.constant_prefix(k);
    for (Index j = 0; j < c.degrees(); ++j) {
      const auto& group = c.groups[j];
      for (Index m = 0; m < group.size(); ++m)
        s.col(c.constant_count + group.begin + m) =
            points.prefix(k).col(group.column[m]).cwiseProduct(component_[k].g.col(j));
    }
    for (Index l = 0; l <= k; ++l) {
      const auto& cl = tables_->layout.component(l);
      scaled_ = s.array().colwise() * curvature_.col(packed_index(k, l)).array();
      block_.noalias() = scaled_.transpose() * sensitivity_[l];
      hessian.block(c.offset, cl.offset, c.count(), cl.count()) = block_;
      if (l < k) hessian.block(cl.offset, c.offset, cl.count(), c.count()) = block_.transpose();
    }
    auto& e = log_basis_[k];
    monotone_products(points, c, k, e);
    scaled_ = e.array().colwise() * (-w.array() * component_[k].log_slope_second.array());
    block_.noalias() = scaled_.transpose() * e;
    hessian.block(c.monotone_begin(), c.monotone_begin(), c.monotone_count, c.monotone_count) += block_;
    add_map_curvature(k, hessian);
  }
}

bool KullbackLeiblerObjective::evaluate(const Eigen::VectorXd& a, int derivatives, double& value,
                                        Eigen::VectorXd& gradient, Eigen::MatrixXd& hessian) {
  last_.resize(0), curvature_at_.resize(0);
  if (!map_points(a, derivatives)) return false;
  target_->evaluate(z_, derivatives, batch_);
  pull_back(derivatives);
  const auto& t = *tables_;
  value = (t.rule.weights.array() * (t.log_reference - batch_.value - log_determinant_).array()).sum();
  if (derivatives >= 1) fill_gradient(gradient);
  if (derivatives >= 2) fill_hessian(hessian);
  last_ = a;
  if (derivatives >= 2) curvature_at_ = a;
  return true;
}

void KullbackLeiblerObjective::hessian_vector(const Eigen::VectorXd& a, const Eigen::VectorXd& v,
                                              Eigen::VectorXd& product) {
  const Index n = tables_->size(), d = matrix_.cols();
  const auto& points = tables_->points;
  if (curvature_at_.size() != a.size() || curvature_at_ != a) {
    (void)map_points(a, 2);
    target_->evaluate(z_, 2, batch_);
    pull_back(2);
    last_ = curvature_at_ = a;
  }
  product.resize(v.size());
  moved_.setZero(n, d);  // how v moves M
  for (Index l = 0; l < d; ++l) {
    const auto& c = tables_->layout.component(l);
    auto& step = step_component_[l];
    step.evaluate_slope(points, tables_->layout, l, v);  // how v moves b and h
    moved_.col(l).noalias() = points.constant_prefix(l) * v.segment(c.offset, c.constant_count);
    for (Index j = 0; j < step.b.cols(); ++j)
      moved_.col(l).array() += component_[l].g.col(j).array() * step.b.col(j).array();
  }
  for (Index k = 0; k < d; ++k) {
    const auto& values = component_[k];
    const auto& step = step_component_[k];
    shift_.setZero(n, 1);
    for (Index l = 0; l < d; ++l)
      shift_.col(0).array() += curvature_.col(packed_index(k, l)).array() * moved_.col(l).array();
    scratch_ = -tables_->rule.weights.array() * values.log_slope_second.array() * step.h.array();
    adjoint_.resize(n, values.b.cols());
    for (Index j = 0; j < adjoint_.cols(); ++j) {
      adjoint_.col(j) =
          shift_.col(0).array() * values.g.col(j).array() + scratch_.array() * points.psi(k).col(j).array();
      for (Index l = 0; l < adjoint_.cols(); ++l)
        adjoint_.col(j).array() += slope_.col(k).array() * step.b.col(l).array() * curvature_of_map(k, j, l);
    }
    add_adjoint(points, tables_->layout.component(k), k, shift_.col(0), adjoint_, product);
  }
}

double KullbackLeiblerObjective::step_limit(const Eigen::VectorXd& a, const Eigen::VectorXd& step) {
  if (tables_->points.rectifier() != Rectifier::square) return 1;
  constexpr double k_fraction = 0.9;  // of the way to the border
  double limit = 1 / k_fraction;
  for (Index k = 0; k < matrix_.cols(); ++k) {
    auto& here = step_component_[k];
    here.evaluate_slope(tables_->points, tables_->layout, k, a);
    scratch_ = here.h;
    here.evaluate_slope(tables_->points, tables_->layout, k, step);
    limit = std::min(limit, 1 / (-here.h.array() / scratch_.array()).cwiseMax(1e-300).maxCoeff());
  }
  return std::min(1.0, k_fraction * limit);
}

double KullbackLeiblerObjective::variance_diagnostic(const Eigen::VectorXd& a) {
  const auto& t = *tables_;
  if (last_.size() != a.size() || last_ != a) {
    curvature_at_.resize(0);
    if (!map_points(a, 0)) return 1e300;
    target_->evaluate(z_, 0, batch_);
    pull_back(0);
    last_ = a;
  }
  scratch_ = t.log_reference - batch_.value - log_determinant_;
  const double mean = t.rule.weights.dot(scratch_);
  return 0.5 * (t.rule.weights.array() * (scratch_.array() - mean).square()).sum();
}

void TemperedDensity::evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives,
                               LogDensityBatch& out) {
  inner_->evaluate(points, derivatives, out);
  const double rest = 1 - beta_;
  // β · (−∞) with β = 0 would be NaN; that density is the prior alone.
  const Eigen::VectorXd prior = standard_normal_log_density(points);
  if (beta_ == 0)
    out.value = prior;
  else
    out.value = beta_ * out.value + rest * prior;
  if (derivatives >= 1) out.gradient = beta_ * out.gradient - rest * points;
  if (derivatives < 2) return;
  out.hessian *= beta_;
  for (Index a = 0; a < points.cols(); ++a) out.hessian.col(packed_index(a, a)).array() -= rest;
}

}  // namespace knothe::posterior
