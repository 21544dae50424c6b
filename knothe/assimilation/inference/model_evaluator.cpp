#include "knothe/assimilation/inference/model_evaluator.hpp"

#include <fmt/format.h>

#include <cassert>
#include <chrono>
#include <cmath>
#include <limits>
#include <mutex>
#include <utility>

#include "knothe/base/error.hpp"

namespace knothe::assimilation {
namespace {

constexpr std::size_t k_max_stored = std::size_t{1} << 25;  ///< doubles of known answers: 256 MB
constexpr double k_poison = std::numeric_limits<double>::quiet_NaN();

std::string key_of(CallKind kind, const Eigen::Ref<const Eigen::VectorXd>& point,
                   const Eigen::Ref<const Eigen::VectorXd>& sensitivity) {
  std::string key(1, static_cast<char>(kind));
  for (const auto* part : {&point, &sensitivity})
    key.append(reinterpret_cast<const char*>(part->data()), part->size() * sizeof(double));
  return key;
}

const char* name_of(CallKind kind) {
  constexpr const char* k_names[] = {"output", "gradient", "Jacobian", "Hessian"};
  return k_names[static_cast<int>(kind)];
}

bool needs_sensitivity(CallKind kind) {
  return kind == CallKind::gradient || kind == CallKind::hessian;
}

}  // namespace

ModelEvaluator::ModelEvaluator(model::ForwardModel& model, std::vector<posterior::Prior> priors, double step)
    : model_(&model), priors_(std::move(priors)), step_(step) {
  if (std::ssize(priors_) != model.dimension())
    throw UsageError(
        fmt::format("{}: {} priors for {} parameters", model.where(), priors_.size(), model.dimension()));
}

/// A fraction of the prior's scale: its standard deviation, its width, or (lognormal) that of log p.
double ModelEvaluator::step_of(Eigen::Index k, double p) const {
  const posterior::Prior& prior = priors_[k];
  using Family = posterior::Prior::Family;
  if (prior.family() == Family::uniform) return step_ * (prior.upper() - prior.lower());
  const double spread = prior.from_standard_normal(0.5).value - prior.from_standard_normal(-0.5).value;
  if (prior.family() == Family::normal) return step_ * spread;
  // Of a lognormal prior the logarithm has one scale everywhere.
  return step_ * p * spread / prior.from_standard_normal(0).value;
}

void ModelEvaluator::require_finite(const Eigen::Ref<const Eigen::MatrixXd>& points,
                                    const Eigen::MatrixXd& values, const char* what) const {
  if (values.allFinite()) return;
  for (Eigen::Index i = 0; i < values.cols(); ++i)
    for (Eigen::Index j = 0; j < values.rows(); ++j)
      if (!std::isfinite(values(j, i)))
        throw DataError(fmt::format("{}: the {} at ({}) is not finite (entry {} is {})", model_->where(),
                                    what, fmt::join(points.col(i), ", "), j, values(j, i)));
}

Eigen::Index ModelEvaluator::answer_size(CallKind kind) const {
  const Eigen::Index m = model_->output_count(), d = model_->dimension();
  const Eigen::Index sizes[] = {m, d, m * d, d * d};
  return sizes[static_cast<int>(kind)];
}

bool ModelEvaluator::fits(const ModelCall& call) const {
  const Eigen::Index sensitivity = needs_sensitivity(call.kind) ? model_->output_count() : 0;
  return call.point.size() == model_->dimension() && call.sensitivity.size() == sensitivity &&
         call.answer.size() == answer_size(call.kind) && call.answer.allFinite();
}

/// Of one point, as the models count it.
std::int64_t ModelEvaluator::cost_of(CallKind kind) const {
  const std::int64_t costs[] = {1, k_gradient_cost, model_->dimension(), model_->dimension()};
  return costs[static_cast<int>(kind)];
}

std::int64_t ModelEvaluator::spent() const {
  const model::ModelCalls& calls = model_->calls();
  return earlier_ + calls.evaluations + k_gradient_cost * calls.gradients + calls.jacobians + calls.hessians;
}

void ModelEvaluator::remember(const ModelCall& call) {
  keep(call, true);
}

void ModelEvaluator::keep(const ModelCall& call, bool of_earlier_run) {
  assert(fits(call));
  if (stored_ + call.answer.size() > k_max_stored) return;
  if (known_.emplace(key_of(call.kind, call.point, call.sensitivity), Known{call.answer, of_earlier_run})
          .second)
    stored_ += call.answer.size();
}

/// The model itself, timed; every answer is passed on as it comes.
void ModelEvaluator::call(CallKind kind, const Eigen::MatrixXd& points, const Eigen::MatrixXd& sensitivities,
                          Eigen::MatrixXd& answers) {
  std::mutex one_at_a_time;
  if (answered)
    model_->answered = [&](Eigen::Index i) {
      const ModelCall call{kind, points.col(i), sensitivities.col(i), answers.col(i)};
      const std::lock_guard lock(one_at_a_time);
      if (call.answer.allFinite()) answered(call);
    };
  const auto start = std::chrono::steady_clock::now();
  switch (kind) {
    case CallKind::evaluate:
      model_->evaluate(points, answers);
      break;
    case CallKind::gradient:
      model_->gradient(points, sensitivities, answers);
      break;
    case CallKind::jacobian:
      model_->jacobian(points, answers);
      break;
    case CallKind::hessian:
      model_->hessian(points, sensitivities, answers);
      break;
  }
  seconds_ += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  if (progress) progress(model_->calls());
  require_finite(points, answers, name_of(kind));
}

double ModelEvaluator::now() const {
  if (clock) return clock();
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

/// So many of these calls that they end in time, at the pace of the slowest so far; one where there were
/// none.
Eigen::Index ModelEvaluator::in_time(Eigen::Index wanted) const {
  if (deadline == k_no_deadline) return wanted;
  const double left = deadline - now();
  if (left <= 0) throw BudgetSpent("the time for calls of the model is over: raise seconds");
  if (left >= slowest_ * wanted) return slowest_ > 0 ? wanted : 1;
  return std::max<Eigen::Index>(1, std::floor(left / slowest_));
}

void ModelEvaluator::ask(CallKind kind, const Eigen::Ref<const Eigen::MatrixXd>& points,
                         const Eigen::Ref<const Eigen::MatrixXd>& sensitivities, Eigen::MatrixXd& answers) {
  const Eigen::Index n = points.cols();
  answers.setConstant(answer_size(kind), n, k_poison);
  std::vector<Eigen::Index> missing;
  std::unordered_map<std::string, Eigen::Index> first;  // a call that is twice in this batch
  std::vector<std::pair<Eigen::Index, Eigen::Index>> twins;
  for (Eigen::Index i = 0; i < n; ++i) {
    const std::string key = key_of(kind, points.col(i), sensitivities.col(i));
    if (const auto it = known_.find(key); it != known_.end()) {
      answers.col(i) = it->second.answer;
      if (std::exchange(it->second.of_earlier_run, false)) earlier_ += cost_of(kind);
    } else if (const auto [twin, is_new] = first.try_emplace(key, i); is_new) {
      missing.push_back(i);
    } else {
      twins.emplace_back(i, twin->second);
    }
  }
  if (!missing.empty() && std::ssize(missing) > (budget_ - spent()) / cost_of(kind))
    throw BudgetSpent(fmt::format("the budget of {} calls of the model is spent", budget_));
  for (auto begin = missing.begin(); begin != missing.end();) {
    const std::vector<Eigen::Index> some(begin, begin + in_time(missing.end() - begin));
    begin += std::ssize(some);
    const Eigen::MatrixXd wanted = points(Eigen::all, some), sensitive = sensitivities(Eigen::all, some);
    Eigen::MatrixXd found = Eigen::MatrixXd::Constant(answers.rows(), wanted.cols(), k_poison);
    const double before = now();
    call(kind, wanted, sensitive, found);
    slowest_ = std::max(slowest_, (now() - before) / std::ssize(some));
    answers(Eigen::all, some) = found;
    for (Eigen::Index i = 0; i < found.cols(); ++i)
      keep({kind, wanted.col(i), sensitive.col(i), found.col(i)}, false);
  }
  for (const auto& [twin, original] : twins) answers.col(twin) = answers.col(original);
}

void ModelEvaluator::evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, Eigen::MatrixXd& values) {
  ask(CallKind::evaluate, points, Eigen::MatrixXd(0, points.cols()), values);
}

void ModelEvaluator::jacobian(const Eigen::Ref<const Eigen::MatrixXd>& points, Eigen::MatrixXd& jacobians) {
  const Eigen::Index m = model_->output_count(), d = points.rows(), n = points.cols();
  if (has_jacobian()) return ask(CallKind::jacobian, points, Eigen::MatrixXd(0, n), jacobians);
  jacobians.setConstant(m * d, n, k_poison);
  // Two points per parameter: central, or 0, h, 2h (−h, −2h) at an end of the support.
  Eigen::MatrixXd shifted(d, 2 * d * n), values, centre;
  Eigen::MatrixXd kind(d, n);  // 0 central, ±1 one-sided
  for (Eigen::Index i = 0; i < n; ++i)
    for (Eigen::Index k = 0; k < d; ++k) {
      const double p = points(k, i), h = step_of(k, p);
      const posterior::Prior& prior = priors_[k];
      kind(k, i) = p + h > prior.upper() ? -1 : p - h < prior.lower() ? 1 : 0;
      auto near = shifted.col(2 * (i * d + k)), far = shifted.col(2 * (i * d + k) + 1);
      near = far = points.col(i);
      near[k] = p + (kind(k, i) < 0 ? -h : h);
      far[k] = kind(k, i) == 0 ? p - h : p + 2 * h * kind(k, i);
    }
  evaluate(shifted, values);
  if ((kind.array() != 0).any()) evaluate(points, centre);
  for (Eigen::Index i = 0; i < n; ++i)
    for (Eigen::Index k = 0; k < d; ++k) {
      const Eigen::Index c = 2 * (i * d + k);
      const double near = shifted(k, c) - points(k, i), far = shifted(k, c + 1) - points(k, i);
      auto column = jacobians.col(i).segment(k * m, m);
      if (kind(k, i) == 0) {
        column = (values.col(c) - values.col(c + 1)) / (near - far);
      } else {
        const auto slope_near = (values.col(c) - centre.col(i)) / near,
                   slope_far = (values.col(c + 1) - centre.col(i)) / far;
        column = (far * slope_near - near * slope_far) / (far - near);
      }
    }
}

void ModelEvaluator::gradient(const Eigen::Ref<const Eigen::MatrixXd>& points,
                              const Eigen::Ref<const Eigen::MatrixXd>& sensitivities,
                              Eigen::MatrixXd& gradients) {
  ask(CallKind::gradient, points, sensitivities, gradients);
}

void ModelEvaluator::hessian(const Eigen::Ref<const Eigen::MatrixXd>& points,
                             const Eigen::Ref<const Eigen::MatrixXd>& sensitivities,
                             Eigen::MatrixXd& hessians) {
  const Eigen::Index d = points.rows(), n = points.cols();
  if (has_hessian()) return ask(CallKind::hessian, points, sensitivities, hessians);
  hessians.setConstant(d * d, n, k_poison);
  // Steps from a point that is moved inwards where the support ends.
  Eigen::MatrixXd centres = points, steps(d, n);
  for (Eigen::Index i = 0; i < n; ++i)
    for (Eigen::Index k = 0; k < d; ++k) {
      const posterior::Prior& prior = priors_[k];
      const double h = steps(k, i) = step_of(k, points(k, i));
      centres(k, i) = std::clamp(points(k, i), prior.lower() + h, prior.upper() - h);
    }
  Eigen::MatrixXd up(d, d * n), down(d, d * n);
  for (Eigen::Index i = 0; i < n; ++i)
    for (Eigen::Index k = 0; k < d; ++k) {
      up.col(i * d + k) = down.col(i * d + k) = centres.col(i);
      up(k, i * d + k) += steps(k, i);
      down(k, i * d + k) -= steps(k, i);
    }
  if (has_gradient())
    hessian_of_gradients(up, down, sensitivities, hessians);
  else
    hessian_of_values(centres, steps, up, down, hessians);
}

/// Column k: central difference of the gradients along parameter k, then made symmetric.
void ModelEvaluator::hessian_of_gradients(const Eigen::MatrixXd& up, const Eigen::MatrixXd& down,
                                          const Eigen::Ref<const Eigen::MatrixXd>& sensitivities,
                                          Eigen::MatrixXd& hessians) {
  const Eigen::Index d = up.rows(), n = sensitivities.cols();
  Eigen::MatrixXd repeated(sensitivities.rows(), d * n), above, below, h(d, d);
  for (Eigen::Index c = 0; c < d * n; ++c) repeated.col(c) = sensitivities.col(c / d);
  gradient(up, repeated, above);
  gradient(down, repeated, below);
  for (Eigen::Index i = 0; i < n; ++i) {
    for (Eigen::Index k = 0; k < d; ++k) {
      const Eigen::Index c = i * d + k;
      h.col(k) = (above.col(c) - below.col(c)) / (up(k, c) - down(k, c));
    }
    hessians.col(i) = (0.5 * (h + h.transpose())).reshaped();
  }
}

/// Of one output: second differences along the axes; a mixed one from the two points (+, +) and (−, −).
void ModelEvaluator::hessian_of_values(const Eigen::MatrixXd& centres, const Eigen::MatrixXd& steps,
                                       const Eigen::MatrixXd& up, const Eigen::MatrixXd& down,
                                       Eigen::MatrixXd& hessians) {
  const Eigen::Index d = up.rows(), n = centres.cols(), pairs = d * (d - 1) / 2;
  Eigen::MatrixXd mixed(d, 2 * pairs * n), f0, f_up, f_down, f_mixed;
  Eigen::Index c = 0;
  for (Eigen::Index i = 0; i < n; ++i)
    for (Eigen::Index k = 0; k < d; ++k)
      for (Eigen::Index l = 0; l < k; ++l)
        for (const double sign : {1.0, -1.0}) {
          mixed.col(c) = centres.col(i);
          mixed(k, c) += sign * steps(k, i);
          mixed(l, c++) += sign * steps(l, i);
        }
  evaluate(centres, f0);
  evaluate(up, f_up);
  evaluate(down, f_down);
  evaluate(mixed, f_mixed);
  c = 0;
  for (Eigen::Index i = 0; i < n; ++i)
    for (Eigen::Index k = 0; k < d; ++k) {
      const auto sum = [&](Eigen::Index j) { return f_up(0, i * d + j) + f_down(0, i * d + j); };
      hessians(k * d + k, i) = (sum(k) - 2 * f0(0, i)) / (steps(k, i) * steps(k, i));
      for (Eigen::Index l = 0; l < k; ++l, c += 2)
        hessians(k * d + l, i) = hessians(l * d + k, i) =
            (f_mixed(0, c) + f_mixed(0, c + 1) - sum(k) - sum(l) + 2 * f0(0, i)) /
            (2 * steps(k, i) * steps(l, i));
    }
}

}  // namespace knothe::assimilation
