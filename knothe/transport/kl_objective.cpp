#include "knothe/transport/kl_objective.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace knothe::transport {

namespace {

/// Above this many entries the tables of second derivatives are not made (512 MB); the solver then uses
/// gradients.
constexpr double k_max_pair_entries = 64.0 * 1024 * 1024;

}  // namespace

TrainingTables::TrainingTables(numerics::PointRule training_rule, int order, const TailedHermite& basis)
    : rule(std::move(training_rule)), layout(rule.points.cols(), order), points(rule.points, order, basis) {
  log_reference = standard_normal_log_density(rule.points);
  const Eigen::Index n = rule.points.rows();
  double pairs = 0;
  for (const auto& c : layout.components())
    pairs += 0.5 * static_cast<double>(c.monotone_count * (c.monotone_count + 1) * n);
  for (Eigen::Index k = 0; k < rule.points.cols(); ++k) {
    const auto& c = layout.components()[static_cast<std::size_t>(k)];
    Eigen::MatrixXd basis_k(n, c.monotone_count);
    std::vector<Eigen::Index> degree(static_cast<std::size_t>(c.monotone_count)), column(degree.size());
    for (Eigen::Index j = 0; j < order; ++j)
      for (Eigen::Index m = 0; m < c.group_size(j); ++m) {
        const Eigen::Index at = c.group_begin[static_cast<std::size_t>(j)] + m;
        degree[static_cast<std::size_t>(at)] = j;
        column[static_cast<std::size_t>(at)] = m;
        basis_k.col(at) = points.prefix(k).col(m).cwiseProduct(points.psi(k).col(j));
      }
    monotone_basis.push_back(std::move(basis_k));
    if (pairs > k_max_pair_entries) continue;
    Eigen::MatrixXd pair(n, c.monotone_count * (c.monotone_count + 1) / 2);
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
                                     sampling::CheckedDensity& target, double mode_log_density) {
  tables_ = &tables;
  pre_map_ = &pre_map;
  target_ = &target;
  floor_ = mode_log_density - 1000;
  pre_map_log_determinant_ = pre_map.log_determinant();
  const auto d = static_cast<std::size_t>(pre_map.dimension());
  component_.resize(d), step_component_.resize(d), sensitivity_.resize(d);
  last_.resize(0);
}

bool KullbackLeiblerObjective::map_points(const Eigen::VectorXd& a) {
  const Eigen::Index n = tables_->rule.points.rows(), d = pre_map_->dimension();
  z_.resize(n, d);
  log_determinant_.setOnes(n);
  for (Eigen::Index k = 0; k < d; ++k) {
    auto& c = component_[static_cast<std::size_t>(k)];
    c.evaluate(tables_->points, tables_->layout, tables_->order(), k, a);
    if (!(c.h.minCoeff() > 0)) return false;
    log_determinant_.array() *= c.h.array();
  }
  log_determinant_ = 2 * log_determinant_.array().log() + pre_map_log_determinant_;
  for (Eigen::Index i = 0; i < d; ++i) {
    z_.col(i).setConstant(pre_map_->shift[i]);
    for (Eigen::Index j = 0; j <= i; ++j)
      z_.col(i) += pre_map_->lower(i, j) * component_[static_cast<std::size_t>(j)].value;
  }
  return std::isfinite(z_.sum());
}

void KullbackLeiblerObjective::pull_back(int derivatives) {
  const Eigen::Index n = z_.rows(), d = z_.cols();
  const auto& w = tables_->rule.weights;
  const auto& l = pre_map_->lower;
  for (Eigen::Index i = 0; i < n; ++i) {
    if (batch_.value[i] != -std::numeric_limits<double>::infinity()) continue;
    batch_.value[i] = floor_;
    if (derivatives >= 1) batch_.gradient.row(i).setZero();
    if (derivatives >= 2) batch_.hessian.row(i).setZero();
  }
  if (derivatives >= 1) {  // slope = −w ∘ (∇ log π̄ · L)
    slope_.resize(n, d);
    for (Eigen::Index k = 0; k < d; ++k) {
      slope_.col(k) = l(k, k) * batch_.gradient.col(k);
      for (Eigen::Index i = k + 1; i < d; ++i) slope_.col(k) += l(i, k) * batch_.gradient.col(i);
      slope_.col(k).array() *= -w.array();
    }
  }
  if (derivatives >= 2) {  // curvature = −w ∘ (Lᵀ ∇² log π̄ L)
    curvature_.setZero(n, d * (d + 1) / 2);
    for (Eigen::Index a = 0; a < d; ++a)
      for (Eigen::Index b = 0; b <= a; ++b) {
        auto entry = curvature_.col(sampling::packed_index(a, b));
        for (Eigen::Index i = a; i < d; ++i)
          for (Eigen::Index j = b; j < d; ++j)
            if (const double f = l(i, a) * l(j, b); f != 0)
              entry += f * batch_.hessian.col(sampling::packed_index(i, j));
        entry.array() *= -w.array();
      }
  }
}

void KullbackLeiblerObjective::fill_gradient(Eigen::VectorXd& gradient) {
  const Eigen::Index n = z_.rows(), d = z_.cols();
  const auto& w = tables_->rule.weights;
  for (Eigen::Index k = 0; k < d; ++k) {
    const auto& c = tables_->layout.components()[static_cast<std::size_t>(k)];
    const auto& values = component_[static_cast<std::size_t>(k)];
    const auto& prefix = tables_->points.prefix(k);
    auto& s = sensitivity_[static_cast<std::size_t>(k)];
    s.resize(n, c.count());
    s.leftCols(c.constant_count) = tables_->points.constant_prefix(k).leftCols(c.constant_count);
    for (Eigen::Index j = 0; j < tables_->order(); ++j)
      for (Eigen::Index m = 0; m < c.group_size(j); ++m)
        s.col(c.constant_count + c.group_begin[static_cast<std::size_t>(j)] + m) =
            2 * prefix.col(m).cwiseProduct(values.g.col(j));
    gradient.segment(c.offset, c.count()).noalias() = s.transpose() * slope_.col(k);
    scratch_ = -2 * w.array() / values.h.array();
    gradient.segment(c.monotone_begin(), c.monotone_count).noalias() +=
        tables_->monotone_basis[static_cast<std::size_t>(k)].transpose() * scratch_;
  }
}

void KullbackLeiblerObjective::fill_hessian(Eigen::MatrixXd& hessian) {
  const Eigen::Index d = z_.cols();
  const auto& w = tables_->rule.weights;
  for (Eigen::Index k = 0; k < d; ++k) {
    const auto sk = static_cast<std::size_t>(k);
    const auto& c = tables_->layout.components()[sk];
    for (Eigen::Index l = 0; l <= k; ++l) {
      const auto& cl = tables_->layout.components()[static_cast<std::size_t>(l)];
      scaled_ = sensitivity_[sk].array().colwise() * curvature_.col(sampling::packed_index(k, l)).array();
      block_.noalias() = scaled_.transpose() * sensitivity_[static_cast<std::size_t>(l)];
      hessian.block(c.offset, cl.offset, c.count(), cl.count()) = block_;
      if (l < k) hessian.block(cl.offset, c.offset, cl.count(), c.count()) = block_.transpose();
    }
    auto corner = hessian.block(c.monotone_begin(), c.monotone_begin(), c.monotone_count, c.monotone_count);
    const auto& e = tables_->monotone_basis[sk];
    scaled_ = e.array().colwise() * (2 * w.array() / component_[sk].h.array().square());
    block_.noalias() = scaled_.transpose() * e;
    corner += block_;
    scratch_.noalias() = tables_->pair_basis[sk].transpose() * slope_.col(k);
    for (Eigen::Index a = 0; a < c.monotone_count; ++a) {
      for (Eigen::Index b = 0; b < a; ++b) {
        corner(a, b) += scratch_[sampling::packed_index(a, b)];
        corner(b, a) = corner(a, b);
      }
      corner(a, a) += scratch_[sampling::packed_index(a, a)];
    }
  }
}

bool KullbackLeiblerObjective::evaluate(const Eigen::VectorXd& a, int derivatives, double& value,
                                        Eigen::VectorXd& gradient, Eigen::MatrixXd& hessian) {
  last_.resize(0);
  if (!map_points(a)) return false;
  target_->evaluate(z_, derivatives, batch_);
  pull_back(derivatives);
  const auto& t = *tables_;
  value = (t.rule.weights.array() * (t.log_reference - batch_.value - log_determinant_).array()).sum();
  if (derivatives >= 1) fill_gradient(gradient);
  if (derivatives >= 2) fill_hessian(hessian);
  last_ = a;
  return true;
}

double KullbackLeiblerObjective::step_limit(const Eigen::VectorXd& a, const Eigen::VectorXd& step) {
  constexpr double k_fraction = 0.9;  // of the way to the border
  double limit = 1 / k_fraction;
  for (Eigen::Index k = 0; k < pre_map_->dimension(); ++k) {
    auto& here = step_component_[static_cast<std::size_t>(k)];
    here.evaluate_slope(tables_->points, tables_->layout, tables_->order(), k, a);
    scratch_ = here.h;
    here.evaluate_slope(tables_->points, tables_->layout, tables_->order(), k, step);
    limit = std::min(limit, 1 / (-here.h.array() / scratch_.array()).cwiseMax(1e-300).maxCoeff());
  }
  return std::min(1.0, k_fraction * limit);
}

double KullbackLeiblerObjective::variance_diagnostic(const Eigen::VectorXd& a) {
  const auto& t = *tables_;
  if (last_.size() != a.size() || last_ != a) {
    if (!map_points(a)) return 1e300;
    target_->evaluate(z_, 0, batch_);
    pull_back(0);
    last_ = a;
  }
  scratch_ = t.log_reference - batch_.value - log_determinant_;
  const double mean = t.rule.weights.dot(scratch_);
  return 0.5 * (t.rule.weights.array() * (scratch_.array() - mean).square()).sum();
}

}  // namespace knothe::transport
