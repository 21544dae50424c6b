#include "knothe/transport/solve/kl_objective.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "knothe/base/error.hpp"

namespace knothe::transport {

namespace {

/// Above this many entries the tables of second derivatives are not made (512 MB).
constexpr double k_max_pair_entries = 64.0 * 1024 * 1024;

/// ∂h/∂a_e at all points: the products Φ_e, n × n_e.
void monotone_products(const PointTables& points, const MapLayout::Component& c, Eigen::Index k,
                       Eigen::MatrixXd& out) {
  out.resize(points.points().rows(), c.monotone_count);
  for (Eigen::Index j = 0; j < c.degrees(); ++j) {
    const auto& group = c.groups[static_cast<std::size_t>(j)];
    for (Eigen::Index m = 0; m < group.size(); ++m)
      out.col(group.begin + m) =
          points.prefix(k).col(group.column[static_cast<std::size_t>(m)]).cwiseProduct(points.psi(k).col(j));
  }
}

}  // namespace

TrainingTables::TrainingTables(numerics::PointRule training_rule, const TriangularMap& map)
    : rule(std::move(training_rule)), layout(map), points(rule.points, map, layout) {
  log_reference = standard_normal_log_density(rule.points);
  if (points.rectifier() != Rectifier::square) return;
  double pairs = 0;
  for (const auto& c : layout.components())
    pairs += 0.5 * static_cast<double>(c.monotone_count * (c.monotone_count + 1) * size());
  if (pairs > k_max_pair_entries) return;
  std::vector<Eigen::Index> degree, column;
  for (Eigen::Index k = 0; k < rule.points.cols(); ++k) {
    const auto& c = layout.component(k);
    degree.clear(), column.clear();
    for (Eigen::Index j = 0; j < c.degrees(); ++j)
      for (const Eigen::Index m : c.groups[static_cast<std::size_t>(j)].column)
        degree.push_back(j), column.push_back(m);
    Eigen::MatrixXd pair(size(), c.monotone_count * (c.monotone_count + 1) / 2);
    for (Eigen::Index a = 0; a < c.monotone_count; ++a)
      for (Eigen::Index b = 0; b <= a; ++b) {
        const auto sa = static_cast<std::size_t>(a), sb = static_cast<std::size_t>(b);
        pair.col(sampling::packed_index(a, b)) =
            2 * points.prefix(k).col(column[sa]).array() * points.prefix(k).col(column[sb]).array() *
            points.integrals(k).col(sampling::packed_index(degree[sa], degree[sb])).array();
      }
    pair_basis.push_back(std::move(pair));
  }
}

void KullbackLeiblerObjective::begin(const TrainingTables& tables, const AffineMap& pre_map,
                                     sampling::CheckedDensity& target, double highest_log_density) {
  const auto d = static_cast<Eigen::Index>(tables.layout.components().size());
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
  const auto components = static_cast<std::size_t>(d);
  component_.resize(components), step_component_.resize(components);
  sensitivity_.resize(components), log_basis_.resize(components);
  last_.resize(0), curvature_at_.resize(0);
}

bool KullbackLeiblerObjective::map_points(const Eigen::VectorXd& a, int derivatives) {
  const Eigen::Index n = tables_->size(), d = matrix_.rows();
  log_determinant_.setConstant(n, pre_log_determinant_);
  for (Eigen::Index k = 0; k < d; ++k) {
    auto& c = component_[static_cast<std::size_t>(k)];
    if (!c.evaluate(tables_->points, tables_->layout, k, a, derivatives)) return false;
    log_determinant_ += c.log_slope;
  }
  z_.resize(n, d);
  for (Eigen::Index i = 0; i < d; ++i) {
    z_.col(i).setConstant(offset_[i]);
    for (Eigen::Index j = 0; j < d; ++j)
      if (matrix_(i, j) != 0) z_.col(i) += matrix_(i, j) * component_[static_cast<std::size_t>(j)].value;
  }
  return std::isfinite(z_.sum()) && std::isfinite(log_determinant_.sum());
}

void KullbackLeiblerObjective::pull_back(int derivatives) {
  const Eigen::Index n = z_.rows(), d = z_.cols();
  const auto& w = tables_->rule.weights;
  const auto& m = matrix_;
  for (Eigen::Index i = 0; i < n; ++i) {
    if (batch_.value[i] != -std::numeric_limits<double>::infinity()) continue;
    batch_.value[i] = floor_;
    if (derivatives >= 1) batch_.gradient.row(i).setZero();
    if (derivatives >= 2) batch_.hessian.row(i).setZero();
  }
  if (derivatives >= 1) {  // slope = −w ∘ (∇ log π̄ · A)
    slope_.setZero(n, d);
    for (Eigen::Index k = 0; k < d; ++k) {
      for (Eigen::Index i = 0; i < d; ++i)
        if (m(i, k) != 0) slope_.col(k) += m(i, k) * batch_.gradient.col(i);
      slope_.col(k).array() *= -w.array();
    }
  }
  if (derivatives >= 2) {  // curvature = −w ∘ (Aᵀ ∇² log π̄ A)
    curvature_.setZero(n, d * (d + 1) / 2);
    for (Eigen::Index a = 0; a < d; ++a)
      for (Eigen::Index b = 0; b <= a; ++b) {
        auto entry = curvature_.col(sampling::packed_index(a, b));
        for (Eigen::Index i = 0; i < d; ++i)
          for (Eigen::Index j = 0; j <= i; ++j) {
            const double f = i == j ? m(i, a) * m(i, b) : m(i, a) * m(j, b) + m(j, a) * m(i, b);
            if (f != 0) entry += f * batch_.hessian.col(sampling::packed_index(i, j));
          }
        entry.array() *= -w.array();
      }
  }
}

/// Adds Σ_j prefixᵀ adjoint_j, by groups, to the coefficients a_e, and constant_prefixᵀ outer to a_c.
static void add_adjoint(const PointTables& points, const MapLayout::Component& c, Eigen::Index k,
                        const Eigen::Ref<const Eigen::VectorXd>& constant, const Eigen::MatrixXd& adjoint,
                        Eigen::VectorXd& out) {
  out.segment(c.offset, c.constant_count).noalias() = points.constant_prefix(k).transpose() * constant;
  const auto& prefix = points.prefix(k);
  for (Eigen::Index j = 0; j < c.degrees(); ++j) {
    const auto& group = c.groups[static_cast<std::size_t>(j)];
    for (Eigen::Index m = 0; m < group.size(); ++m)
      out[c.monotone_begin() + group.begin + m] =
          prefix.col(group.column[static_cast<std::size_t>(m)]).dot(adjoint.col(j));
  }
}

void KullbackLeiblerObjective::fill_gradient(Eigen::VectorXd& gradient) {
  const auto& w = tables_->rule.weights;
  for (Eigen::Index k = 0; k < matrix_.cols(); ++k) {
    const auto& values = component_[static_cast<std::size_t>(k)];
    scratch_ = -w.array() * values.log_slope_first.array();
    adjoint_.resize(w.size(), values.b.cols());
    for (Eigen::Index j = 0; j < adjoint_.cols(); ++j)
      adjoint_.col(j) = slope_.col(k).array() * values.g.col(j).array() +
                        scratch_.array() * tables_->points.psi(k).col(j).array();
    add_adjoint(tables_->points, tables_->layout.component(k), k, slope_.col(k), adjoint_, gradient);
  }
}

auto KullbackLeiblerObjective::curvature_of_map(Eigen::Index k, Eigen::Index j, Eigen::Index l) const {
  const bool square = tables_->points.rectifier() == Rectifier::square;
  const Eigen::MatrixXd& table =
      square ? tables_->points.integrals(k) : component_[static_cast<std::size_t>(k)].curvature;
  return (square ? 2.0 : 1.0) * table.col(sampling::packed_index(j, l)).array();
}

/// Σ_i slope_i ∂²M^k/∂a_e∂a_e into the corner of component k.
void KullbackLeiblerObjective::add_map_curvature(Eigen::Index k, Eigen::MatrixXd& hessian) {
  const auto& c = tables_->layout.component(k);
  auto corner = hessian.block(c.monotone_begin(), c.monotone_begin(), c.monotone_count, c.monotone_count);
  if (!tables_->pair_basis.empty()) {
    scratch_.noalias() = tables_->pair_basis[static_cast<std::size_t>(k)].transpose() * slope_.col(k);
    for (Eigen::Index a = 0; a < c.monotone_count; ++a)
      for (Eigen::Index b = 0; b <= a; ++b) {
        corner(a, b) += scratch_[sampling::packed_index(a, b)];
        if (b < a) corner(b, a) += scratch_[sampling::packed_index(a, b)];
      }
    return;
  }
  const auto& prefix = tables_->points.prefix(k);
  for (Eigen::Index j = 0; j < c.degrees(); ++j)
    for (Eigen::Index l = 0; l <= j; ++l) {
      const auto &row = c.groups[static_cast<std::size_t>(j)],
                 &column = c.groups[static_cast<std::size_t>(l)];
      scratch_ = slope_.col(k).array() * curvature_of_map(k, j, l);
      scaled_ = prefix(Eigen::all, column.column);
      scaled_.array().colwise() *= scratch_.array();
      block_.noalias() = prefix(Eigen::all, row.column).transpose() * scaled_;
      corner.block(row.begin, column.begin, row.size(), column.size()) += block_;
      if (l < j) corner.block(column.begin, row.begin, column.size(), row.size()) += block_.transpose();
    }
}

void KullbackLeiblerObjective::fill_hessian(Eigen::MatrixXd& hessian) {
  const Eigen::Index d = matrix_.cols();
  const auto& w = tables_->rule.weights;
  const auto& points = tables_->points;
  for (Eigen::Index k = 0; k < d; ++k) {
    const auto sk = static_cast<std::size_t>(k);
    const auto& c = tables_->layout.component(k);
    auto& s = sensitivity_[sk];
    s.resize(w.size(), c.count());
    s.leftCols(c.constant_count) = points.constant_prefix(k);
    for (Eigen::Index j = 0; j < c.degrees(); ++j) {
      const auto& group = c.groups[static_cast<std::size_t>(j)];
      for (Eigen::Index m = 0; m < group.size(); ++m)
        s.col(c.constant_count + group.begin + m) = points.prefix(k)
                                                        .col(group.column[static_cast<std::size_t>(m)])
                                                        .cwiseProduct(component_[sk].g.col(j));
    }
    for (Eigen::Index l = 0; l <= k; ++l) {
      const auto& cl = tables_->layout.component(l);
      scaled_ = s.array().colwise() * curvature_.col(sampling::packed_index(k, l)).array();
      block_.noalias() = scaled_.transpose() * sensitivity_[static_cast<std::size_t>(l)];
      hessian.block(c.offset, cl.offset, c.count(), cl.count()) = block_;
      if (l < k) hessian.block(cl.offset, c.offset, cl.count(), c.count()) = block_.transpose();
    }
    auto& e = log_basis_[sk];
    monotone_products(points, c, k, e);
    scaled_ = e.array().colwise() * (-w.array() * component_[sk].log_slope_second.array());
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
  const Eigen::Index n = tables_->size(), d = matrix_.cols();
  const auto& points = tables_->points;
  if (curvature_at_.size() != a.size() || curvature_at_ != a) {
    (void)map_points(a, 2);
    target_->evaluate(z_, 2, batch_);
    pull_back(2);
    last_ = curvature_at_ = a;
  }
  product.resize(v.size());
  moved_.setZero(n, d);  // how v moves M
  for (Eigen::Index l = 0; l < d; ++l) {
    const auto& c = tables_->layout.component(l);
    auto& step = step_component_[static_cast<std::size_t>(l)];
    step.evaluate_slope(points, tables_->layout, l, v);  // how v moves b and h
    moved_.col(l).noalias() = points.constant_prefix(l) * v.segment(c.offset, c.constant_count);
    for (Eigen::Index j = 0; j < step.b.cols(); ++j)
      moved_.col(l).array() +=
          component_[static_cast<std::size_t>(l)].g.col(j).array() * step.b.col(j).array();
  }
  for (Eigen::Index k = 0; k < d; ++k) {
    const auto& values = component_[static_cast<std::size_t>(k)];
    const auto& step = step_component_[static_cast<std::size_t>(k)];
    shift_.setZero(n, 1);
    for (Eigen::Index l = 0; l < d; ++l)
      shift_.col(0).array() += curvature_.col(sampling::packed_index(k, l)).array() * moved_.col(l).array();
    scratch_ = -tables_->rule.weights.array() * values.log_slope_second.array() * step.h.array();
    adjoint_.resize(n, values.b.cols());
    for (Eigen::Index j = 0; j < adjoint_.cols(); ++j) {
      adjoint_.col(j) =
          shift_.col(0).array() * values.g.col(j).array() + scratch_.array() * points.psi(k).col(j).array();
      for (Eigen::Index l = 0; l < adjoint_.cols(); ++l)
        adjoint_.col(j).array() += slope_.col(k).array() * step.b.col(l).array() * curvature_of_map(k, j, l);
    }
    add_adjoint(points, tables_->layout.component(k), k, shift_.col(0), adjoint_, product);
  }
}

double KullbackLeiblerObjective::step_limit(const Eigen::VectorXd& a, const Eigen::VectorXd& step) {
  if (tables_->points.rectifier() != Rectifier::square) return 1;
  constexpr double k_fraction = 0.9;  // of the way to the border
  double limit = 1 / k_fraction;
  for (Eigen::Index k = 0; k < matrix_.cols(); ++k) {
    auto& here = step_component_[static_cast<std::size_t>(k)];
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
                               sampling::LogDensityBatch& out) {
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
  for (Eigen::Index a = 0; a < points.cols(); ++a)
    out.hessian.col(sampling::packed_index(a, a)).array() -= rest;
}

}  // namespace knothe::transport
