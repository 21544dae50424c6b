#include "knothe/likelihood/step/collapsed_posterior.hpp"

#include <cassert>
#include <cmath>
#include <numbers>

namespace knothe::likelihood {
namespace {

const double k_log_2_pi = std::log(2 * std::numbers::pi);

/// log(exp a + exp b) into a.
void add_in_logarithms(Eigen::Ref<Eigen::ArrayXd> a, const Eigen::Ref<const Eigen::ArrayXd>& b) {
  a = a.max(b) + (1 + (-(a - b).abs()).exp()).log();
}

/// The share of each column in Σ exp(row), averaged over the rows.
Eigen::VectorXd shares_of(Eigen::ArrayXXd value, const Eigen::Ref<const Eigen::VectorXd>& weights) {
  Eigen::ArrayXd largest = value.col(0);
  for (Eigen::Index k = 1; k < value.cols(); ++k) largest = largest.max(value.col(k));
  Eigen::ArrayXd sum = Eigen::ArrayXd::Zero(value.rows());
  for (Eigen::Index k = 0; k < value.cols(); ++k) {
    value.col(k) = (value.col(k) - largest).exp();
    sum += value.col(k);
  }
  return value.matrix().transpose() * (weights.array() / sum).matrix();
}

}  // namespace

CollapsedLogDensity::CollapsedLogDensity(std::shared_ptr<const model::ParameterFunctions> functions,
                                         std::shared_ptr<const posterior::PriorTransform> transform,
                                         Eigen::VectorXd central_functions)
    : functions_(std::move(functions)),
      transform_(std::move(transform)),
      central_(std::move(central_functions)),
      magnitude_(functions_->magnitude(central_)) {
  assert(functions_->dimension() == transform_->dimension() && functions_->count() == central_.size());
  set_form(StepForm::zero(central_.size()));
}

void CollapsedLogDensity::set_form(const StepForm& form) {
  const StepForm* const one[] = {&form};
  set_mixture(one, std::array{0.0});
  if (noise_level_) noise_level_->set(form);
}

void CollapsedLogDensity::set_mixture(std::span<const StepForm* const> forms,
                                      std::span<const double> log_weights, std::span<const double> shares) {
  assert(!forms.empty() && forms.size() == log_weights.size());
  assert(shares.empty() || shares.size() == forms.size());
  while (components_.size() < forms.size()) {
    components_.emplace_back();
    components_.back().likelihood = functions_->make_quadratic_form();
  }
  count_ = forms.size();
  alone_.reset();
  for (std::size_t k = 0; k < count_; ++k) {
    set_component(components_[k], *forms[k], log_weights[k]);
    components_[k].contributes = shares.empty() || shares[k] > 1e-3;
  }
}

void CollapsedLogDensity::set_component(Component& c, const StepForm& form, double log_weight) {
  c.factor.compute(form.quadratic, form.linear, magnitude_);
  // −2 log L = |Lᵀv − y|² − 2 (h − L y)·v + constants, v = w − w₀.
  c.combination = c.factor.lower().transpose();
  c.shift = -c.factor.solution();
  c.shift.noalias() -= c.combination * central_;
  const double constant = -0.5 * (form.constant + form.log_normaliser) +
                          0.5 * c.factor.solution().squaredNorm() - c.factor.remainder().dot(central_);
  c.likelihood->set(c.combination, c.shift, c.factor.remainder(), constant + log_weight);
}

CollapsedLogDensity::Workspace& CollapsedLogDensity::workspace(Eigen::Index n) {
  const auto [it, is_new] = workspaces_.try_emplace(n);
  Workspace& w = it->second;
  if (is_new) {
    const Eigen::Index d = dimension();
    w.p.resize(n, d);
    w.first.resize(n, d);
    w.second.resize(n, d);
  }
  return w;
}

void CollapsedLogDensity::evaluate_likelihood(const Eigen::Ref<const Eigen::MatrixXd>& p, int derivatives,
                                              posterior::LogDensityBatch& out) {
  if (count_ > 1) return evaluate_mixture(p, derivatives, out);
  components_[0].likelihood->evaluate(p, derivatives, out.value, out.gradient, out.hessian);
  if (noise_level_) noise_level_->marginalise(derivatives, out);
}

/// ℓ = log Σ exp ℓ_k; with shares s_k = exp(ℓ_k − ℓ): ∇ℓ = Σ s_k ∇ℓ_k, ∇²ℓ = Σ s_k (∇²ℓ_k + ∇ℓ_k∇ℓ_kᵀ) −
/// ∇ℓ∇ℓᵀ. Component by component, with the sum so far as one of two.
void CollapsedLogDensity::evaluate_mixture(const Eigen::Ref<const Eigen::MatrixXd>& p, int derivatives,
                                           posterior::LogDensityBatch& out) {
  const Eigen::Index d = dimension();
  posterior::LogDensityBatch& next = workspace(p.rows()).component;
  next.resize(p.rows(), d, derivatives);
  std::size_t k = first_felt();
  components_[k].likelihood->evaluate(p, derivatives, out.value, out.gradient, out.hessian);
  for (++k; k < count_; ++k) {
    if (!is_felt(k)) continue;
    components_[k].likelihood->evaluate(p, derivatives, next.value, next.gradient, next.hessian);
    const Eigen::ArrayXd difference = next.value.array() - out.value.array();
    const Eigen::ArrayXd less = (-difference.abs()).exp();  // the smaller over the larger
    out.value.array() += difference.max(0.0) + (1 + less).log();
    if (derivatives == 0) continue;
    // Of the next, in what both make.
    const Eigen::ArrayXd share = (difference > 0).select(1.0, less) / (1 + less);
    if (derivatives >= 2) {
      for (Eigen::Index a = 0; a < d; ++a) {
        for (Eigen::Index b = 0; b <= a; ++b) {
          const Eigen::Index at = posterior::packed_index(a, b);
          // With two parts the outer products come to s (1 − s) (∇ℓ₂ − ∇ℓ₁)(∇ℓ₂ − ∇ℓ₁)ᵀ.
          out.hessian.col(at).array() += share * (next.hessian.col(at) - out.hessian.col(at)).array() +
                                         share * (1 - share) *
                                             (next.gradient.col(a) - out.gradient.col(a)).array() *
                                             (next.gradient.col(b) - out.gradient.col(b)).array();
        }
      }
    }
    out.gradient.array() += share.replicate(1, d) * (next.gradient - out.gradient).array();
  }
}

std::size_t CollapsedLogDensity::first_felt() const {
  std::size_t k = 0;
  while (k + 1 < count_ && !is_felt(k)) ++k;
  return k;
}

Eigen::VectorXd CollapsedLogDensity::component_shares(const Eigen::Ref<const Eigen::MatrixXd>& p,
                                                      const Eigen::Ref<const Eigen::VectorXd>& weights) {
  posterior::LogDensityBatch next;
  next.resize(p.rows(), dimension(), 0);
  const Eigen::Index count = count_;
  Eigen::ArrayXXd value(p.rows(), count);
  for (Eigen::Index k = 0; k < count; ++k) {
    components_[k].likelihood->evaluate(p, 0, next.value, next.gradient, next.hessian);
    value.col(k) = next.value;
  }
  return shares_of(std::move(value), weights);
}

Eigen::VectorXd CollapsedLogDensity::component_shares(std::span<const numerics::GridRun> runs,
                                                      const Eigen::Ref<const Eigen::VectorXd>& weights) {
  const Eigen::Index count = count_;
  Eigen::ArrayXXd value(weights.size(), count);
  for (Eigen::Index k = 0; k < count; ++k) evaluate_component(components_[k], runs, value.col(k).matrix());
  return shares_of(std::move(value), weights);
}

void CollapsedLogDensity::set_grid(const Eigen::Ref<const Eigen::MatrixXd>& axes) {
  assert(axes.cols() == dimension());
  Eigen::MatrixXd none;
  axes_.resize(axes.rows(), axes.cols());
  transform_->evaluate(axes, 0, axes_, none, none);
  prior_ = 0.5 * (axes.array().square() + k_log_2_pi);
  for (std::size_t k = 0; k < count_; ++k)
    if (auto* on_grid = dynamic_cast<numerics::GridEvaluator*>(components_[k].likelihood.get());
        on_grid != nullptr && on_grid->has_grid())
      on_grid->set_grid(axes_);
}

void CollapsedLogDensity::evaluate_component(Component& component, std::span<const numerics::GridRun> runs,
                                             Eigen::Ref<Eigen::VectorXd> value) {
  auto* on_grid = dynamic_cast<numerics::GridEvaluator*>(component.likelihood.get());
  if (on_grid != nullptr && on_grid->has_grid()) return on_grid->evaluate_runs(runs, value);
  Eigen::MatrixXd none;
  component.likelihood->evaluate(numerics::nodes_of(axes_, runs), 0, value, none, none);
}

void CollapsedLogDensity::evaluate_runs(std::span<const numerics::GridRun> runs,
                                        Eigen::Ref<Eigen::VectorXd> value) {
  std::size_t k = first_felt();
  evaluate_component(components_[k], runs, value);
  for (++k; k < count_; ++k) {
    if (!is_felt(k)) continue;
    next_values_.resize(value.size());
    evaluate_component(components_[k], runs, next_values_);
    add_in_logarithms(value.array(), next_values_.array());
  }
  if (noise_level_) {
    posterior::LogDensityBatch batch;
    batch.value = value;
    noise_level_->marginalise(0, batch);
    value = batch.value;
  }
  if (!transform_->is_independent()) add_dependence(runs, value);
  const Eigen::Index last = dimension() - 1;
  for (const numerics::GridRun& run : runs) {
    const Eigen::Index n = run.end - run.begin;
    double of_row = 0;
    for (Eigen::Index i = last - 1, rest = run.row; i >= 0; --i, rest /= prior_.rows())
      of_row += prior_(rest % prior_.rows(), i);
    value.segment(run.at, n).array() -= of_row + prior_.col(last).segment(run.begin, n);
  }
}

void CollapsedLogDensity::add_dependence(std::span<const numerics::GridRun> runs,
                                         Eigen::Ref<Eigen::VectorXd> value) const {
  posterior::LogDensityBatch batch;
  batch.value = value;
  transform_->add_dependence(numerics::nodes_of(axes_, runs), 0, batch);
  value = batch.value;
}

void CollapsedLogDensity::evaluate_standardised(const Eigen::Ref<const Eigen::MatrixXd>& z, int derivatives,
                                                Factor factor, posterior::LogDensityBatch& out) {
  const Eigen::Index d = dimension();
  Workspace& w = workspace(z.rows());
  transform_->evaluate(z, derivatives, w.p, w.first, w.second);
  evaluate_likelihood(w.p, derivatives, out);
  if (factor == Factor::likelihood_and_dependence) transform_->add_dependence(w.p, derivatives, out);
  if (derivatives >= 2) {
    for (Eigen::Index a = 0; a < d; ++a) {
      for (Eigen::Index b = 0; b <= a; ++b) {
        auto entry = out.hessian.col(posterior::packed_index(a, b)).array();
        entry *= w.first.col(a).array() * w.first.col(b).array();
        if (a == b) entry += out.gradient.col(a).array() * w.second.col(a).array();
      }
    }
  }
  if (derivatives >= 1) out.gradient.array() *= w.first.array();
}

void CollapsedLogDensity::evaluate(const Eigen::Ref<const Eigen::MatrixXd>& z, int derivatives,
                                   posterior::LogDensityBatch& out) {
  evaluate_standardised(z, derivatives, Factor::likelihood_and_dependence, out);
  add_standard_normal(z, derivatives, out);
}

void add_standard_normal(const Eigen::Ref<const Eigen::MatrixXd>& z, int derivatives,
                         posterior::LogDensityBatch& out) {
  const Eigen::Index d = z.cols();
  out.value.array() -= 0.5 * d * k_log_2_pi;
  for (Eigen::Index a = 0; a < d; ++a) {
    out.value.array() -= 0.5 * z.col(a).array().square();
    if (derivatives >= 2) out.hessian.col(posterior::packed_index(a, a)).array() -= 1;
  }
  if (derivatives >= 1) out.gradient -= z;
}

}  // namespace knothe::likelihood
