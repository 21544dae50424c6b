#include "knothe/posterior/map/samples/sample_objective.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>

#include "knothe/base/index.hpp"
#include "knothe/posterior/map/one_variable_basis.hpp"
#include "knothe/posterior/map/rectifier.hpp"

namespace knothe::posterior {

namespace {

using Values = OneVariableBasis::Values;
constexpr Rectifier k_rectifier = Rectifier::softplus;

/// Values of the one-variable functions 0 … degree at all samples of one variable, n × (degree + 1).
Eigen::MatrixXd tabulate(const OneVariableBasis& basis, bool monotone,
                         const Eigen::Ref<const Eigen::VectorXd>& x, int degree) {
  Eigen::MatrixXd table(x.size(), degree + 1);
  Values value{}, first{}, second{};
  for (Index i = 0; i < x.size(); ++i) {
    if (monotone)
      basis.monotone(x[i], degree, value, first, second);
    else
      basis.constant(x[i], degree, value, first, second);
    for (int j = 0; j <= degree; ++j) table(i, j) = value[j];
  }
  return table;
}

int highest_degree(const std::vector<MultiIndex>& set, int variable) {
  int degree = 0;
  for (const MultiIndex& index : set) degree = std::max(degree, index.degree_of(variable));
  return degree;
}

/// Π over the variables below k of the tabulated functions.
Eigen::VectorXd product(const MultiIndex& index, int k, const std::vector<Eigen::MatrixXd>& tables, Index n) {
  Eigen::VectorXd result = Eigen::VectorXd::Ones(n);
  for (const auto& f : index.factors)
    if (f.variable < k) result.array() *= tables[f.variable].col(f.degree).array();
  return result;
}

/// h with r(h) = slope > 0.
double inverse_rectifier(double slope) {
  const double s = slope / k_softplus_scale;  // log(1 + eʰ) = s
  return s > 30 ? s : std::log(std::expm1(s));
}

}  // namespace

SampleObjective::SampleObjective(const TriangularMap& map, Index k,
                                 const Eigen::Ref<const Eigen::MatrixXd>& y, double regularisation)
    : regularisation_(regularisation), own_(y.col(k)) {
  const OneVariableBasis basis(map.parametrisation());
  const MapComponent& c = map.component(k);
  const Index n = y.rows();
  const int kk = k;
  std::vector<Eigen::MatrixXd> constant_tables, monotone_tables;
  for (int v = 0; v < kk; ++v) {
    constant_tables.push_back(tabulate(basis, false, y.col(v), highest_degree(c.constant, v)));
    monotone_tables.push_back(tabulate(basis, true, y.col(v), highest_degree(c.monotone, v)));
  }
  constant_.resize(n, c.constant_count());
  monotone_count_ = c.monotone_count();
  penalised_.setZero(dimension());
  for (Index m = 0; m < constant_.cols(); ++m) {
    const MultiIndex& index = c.constant[m];
    constant_.col(m) = product(index, kk, constant_tables, n);
    if (index.total == 0) constant_column_ = m;
    if (index.total == 1) linear_.push_back(m);
    if (index.total > 1) penalised_[m] = 1;
  }
  const int degree = highest_degree(c.monotone, kk);
  degrees_ = degree + 1;
  of_degree_.resize(degrees_);
  for (Index m = 0; m < monotone_count_; ++m) {
    const MultiIndex& index = c.monotone[m];
    of_degree_[index.degree_of(kk)].push_back(m);
    if (index.total == 0) unit_monotone_ = m;
    if (index.total > 0) penalised_[constant_.cols() + m] = 1;
  }
  for (const auto& members : of_degree_) {
    Eigen::MatrixXd columns(n, std::ssize(members));
    for (Index m = 0; m < std::ssize(members); ++m)
      columns.col(m) = product(c.monotone[members[m]], kk, monotone_tables, n);
    prefix_.push_back(std::move(columns));
  }
  psi_ = tabulate(basis, true, own_, degree);
  IntegrationRule rule;
  Values value{};
  for (Index i = 0; i < n; ++i) {
    rule_begin_.push_back(rule_weight_.size());
    basis.integration_rule(own_[i], degree, rule);
    for (Index q = 0; q < std::ssize(rule.weight); ++q) {
      rule_weight_.push_back(rule.weight[q]);
      basis.monotone(rule.node[q], degree, value);
      rule_psi_.insert(rule_psi_.end(), value.begin(), value.begin() + degrees_);
    }
  }
  rule_begin_.push_back(rule_weight_.size());
  weights_.setConstant(n, 1.0 / n);
}

/// b and h = Σ_j b_j ψ_j at every sample.
void SampleObjective::collapse(const Eigen::VectorXd& a) {
  b_.resize(own_.size(), degrees_);
  Eigen::VectorXd part;
  for (Index j = 0; j < degrees_; ++j) {
    const auto& members = of_degree_[j];
    part.resize(std::ssize(members));
    for (Index m = 0; m < std::ssize(members); ++m) part[m] = a[constant_.cols() + members[m]];
    b_.col(j).noalias() = prefix_[j] * part;
  }
  h_ = b_.cwiseProduct(psi_).rowwise().sum();
}

/// ∫ r(h), and its first and second derivatives in b.
void SampleObjective::integrate(int derivatives) {
  const Index n = own_.size();
  const std::size_t p = degrees_;
  integral_.setZero(n);
  g_.setZero(n, degrees_);
  if (derivatives >= 2) curvature_.setZero(n, degrees_ * degrees_);
  std::vector<double> b(p), g(p), curvature(p * p);
  for (Index i = 0; i < n; ++i) {
    double sum = 0;
    std::fill(g.begin(), g.end(), 0.0), std::fill(curvature.begin(), curvature.end(), 0.0);
    for (std::size_t j = 0; j < p; ++j) b[j] = b_(i, j);
    for (std::size_t q = rule_begin_[i]; q < rule_begin_[i + 1]; ++q) {
      const double* psi = rule_psi_.data() + q * p;
      double h = 0;
      for (std::size_t j = 0; j < p; ++j) h += b[j] * psi[j];
      const Rectified r = rectify(k_rectifier, h);
      const double w = rule_weight_[q];
      sum += w * r.value;
      for (std::size_t j = 0; j < p; ++j) g[j] += w * r.first * psi[j];
      if (derivatives >= 2)
        for (std::size_t j = 0; j < p; ++j)
          for (std::size_t l = 0; l <= j; ++l) curvature[j * p + l] += w * r.second * psi[j] * psi[l];
    }
    integral_[i] = sum;
    for (std::size_t j = 0; j < p; ++j) {
      g_(i, j) = g[j];
      if (derivatives >= 2)
        for (std::size_t l = 0; l <= j; ++l) curvature_(i, j * p + l) = curvature[j * p + l];
    }
  }
}

Eigen::VectorXd SampleObjective::losses(const Eigen::VectorXd& a) {
  collapse(a);
  integrate(0);
  const Eigen::VectorXd s = constant_ * a.head(constant_.cols()) + integral_;
  Eigen::VectorXd result(s.size());
  for (Index i = 0; i < s.size(); ++i)
    result[i] = std::min(0.5 * s[i] * s[i] - log_rectified(k_rectifier, h_[i]), 1e6);
  return result;
}

bool SampleObjective::evaluate(const Eigen::VectorXd& a, int derivatives, double& value,
                               Eigen::VectorXd& gradient, Eigen::MatrixXd& hessian) {
  const Index n = own_.size(), n_c = constant_.cols();
  collapse(a);
  integrate(derivatives);
  const Eigen::VectorXd s = constant_ * a.head(n_c) + integral_;
  value = 0.5 * regularisation_ * penalised_.dot(a.cwiseAbs2());
  Eigen::VectorXd slope(n), bend(n);  // w (log r)', w (log r)''
  for (Index i = 0; i < n; ++i) {
    if (weights_[i] == 0) {
      slope[i] = bend[i] = 0;
      continue;
    }
    value += weights_[i] * (0.5 * s[i] * s[i] - log_rectified(k_rectifier, h_[i]));
    const double first = log_rectified_slope(k_rectifier, h_[i]);
    const Rectified r = rectify(k_rectifier, h_[i]);
    slope[i] = weights_[i] * first;
    bend[i] = r.value > 1e-200 ? weights_[i] * (r.second / r.value - first * first) : 0;
  }
  if (!std::isfinite(value)) return false;
  if (derivatives < 1) return true;
  const Eigen::VectorXd residual = weights_.cwiseProduct(s);
  gradient = regularisation_ * penalised_.cwiseProduct(a);
  gradient.head(n_c).noalias() += constant_.transpose() * residual;
  Eigen::MatrixXd sensitivity(n, dimension());  // ∂S/∂a
  sensitivity.leftCols(n_c) = constant_;
  for (Index j = 0; j < degrees_; ++j) {
    const auto& members = of_degree_[j];
    const auto& prefix = prefix_[j];
    const Eigen::VectorXd part =
        prefix.transpose() * (residual.cwiseProduct(g_.col(j)) - slope.cwiseProduct(psi_.col(j)));
    for (Index m = 0; m < std::ssize(members); ++m) {
      gradient[n_c + members[m]] += part[m];
      sensitivity.col(n_c + members[m]) = prefix.col(m).cwiseProduct(g_.col(j));
    }
  }
  if (derivatives < 2) return true;
  hessian.noalias() = sensitivity.transpose() * weights_.asDiagonal() * sensitivity;
  hessian.diagonal() += regularisation_ * penalised_;
  for (Index j = 0; j < degrees_; ++j)
    for (Index l = 0; l <= j; ++l) {
      const auto &rows = of_degree_[j], &columns = of_degree_[l];
      const Eigen::VectorXd scale = residual.cwiseProduct(curvature_.col(j * degrees_ + l)) -
                                    bend.cwiseProduct(psi_.col(j)).cwiseProduct(psi_.col(l));
      const Eigen::MatrixXd block = prefix_[j].transpose() * scale.asDiagonal() * prefix_[l];
      for (Index r = 0; r < std::ssize(rows); ++r)
        for (Index c = 0; c < std::ssize(columns); ++c) {
          const double entry = block(r, c);
          hessian(n_c + rows[r], n_c + columns[c]) += entry;
          if (j != l) hessian(n_c + columns[c], n_c + rows[r]) += entry;
        }
    }
  return true;
}

Eigen::VectorXd SampleObjective::affine_start() const {
  // x_k = β_0 + βᵀ x_before + σ e, hence S = (x_k − β_0 − βᵀ x_before)/σ.
  const Index n = own_.size(), columns = 1 + std::ssize(linear_);
  Eigen::MatrixXd design(n, columns);
  design.col(0).setOnes();
  for (Index m = 0; m < std::ssize(linear_); ++m) design.col(m + 1) = constant_.col(linear_[m]);
  Eigen::MatrixXd normal = design.transpose() * weights_.asDiagonal() * design;
  normal.diagonal().array() += 1e-12;  // coordinates that repeat each other
  const Eigen::VectorXd right = design.transpose() * weights_.cwiseProduct(own_);
  const Eigen::VectorXd beta = normal.ldlt().solve(right);
  const double variance = weights_.dot((own_ - design * beta).cwiseAbs2());
  const double slope = 1 / std::sqrt(std::max(variance, 1e-12));
  Eigen::VectorXd a = Eigen::VectorXd::Zero(dimension());
  a[constant_column_] = -slope * beta[0];
  for (Index m = 0; m < std::ssize(linear_); ++m) a[linear_[m]] = -slope * beta[m + 1];
  a[constant_.cols() + unit_monotone_] = inverse_rectifier(slope);
  return a;
}

}  // namespace knothe::posterior
