#pragma once
/// @file A model called with care: nothing is computed twice, what is missing is differenced, what comes back
/// is checked.
#include <cstdint>
#include <functional>
#include <limits>
#include <string>
#include <unordered_map>
#include <vector>

#include "knothe/base/error.hpp"
#include "knothe/model/forward/forward_model.hpp"
#include "knothe/posterior/budget_spent.hpp"
#include "knothe/posterior/prior/prior.hpp"

namespace knothe::assimilation {

enum class CallKind { evaluate, gradient, jacobian, hessian };

/// What a model was asked and what it answered.
struct ModelCall {
  CallKind kind = CallKind::evaluate;
  Eigen::VectorXd point;        ///< d
  Eigen::VectorXd sensitivity;  ///< m for gradient and hessian, else empty
  Eigen::VectorXd answer;       ///< m, d, m·d or d·d
};

/// Which of the derivatives that a model says it has are used.
struct OwnDerivatives {
  bool gradient = true, jacobian = true, hessian = true;
};

using posterior::BudgetSpent;

/// Evaluations of a forward model at points of the priors' support. Points are d × n, one column each, as in
/// ForwardModel.
class ModelEvaluator {
 public:
  /// `step`: of differences, in units of each prior's scale (`scale_of`). The model must outlive this.
  ModelEvaluator(model::ForwardModel& model, std::vector<posterior::Prior> priors, double step);

  [[nodiscard]] model::ForwardModel& model() { return *model_; }
  [[nodiscard]] const model::ForwardModel& model() const { return *model_; }

  /// What the model has and what may be used of it: all, until `use` says less.
  void use(OwnDerivatives own) { own_ = own; }
  [[nodiscard]] bool has_gradient() const { return own_.gradient && model_->has_gradient(); }
  [[nodiscard]] bool has_jacobian() const { return own_.jacobian && model_->has_jacobian(); }
  [[nodiscard]] bool has_hessian() const { return own_.hessian && model_->has_hessian(); }

  /// An evaluation and a product with a Jacobian or Hessian count 1, a gradient `k_gradient_cost`. Calls that
  /// an earlier run made count when they are asked for, so that a run that goes on does what it would have
  /// done at once.
  static constexpr std::int64_t k_gradient_cost = 4;
  [[nodiscard]] std::int64_t spent() const;
  /// From here on no call is made that would bring `spent` above this; BudgetSpent is thrown in its place.
  void set_budget(std::int64_t budget) { budget_ = budget; }
  [[nodiscard]] std::int64_t budget() const { return budget_; }
  static constexpr std::int64_t k_no_budget = std::numeric_limits<std::int64_t>::max();

  /// Seconds since some moment; empty: of this machine's steady clock.
  using Clock = std::function<double()>;
  Clock clock;
  [[nodiscard]] double now() const;
  /// From this moment of the clock on no call is made either. What is known is still answered.
  static constexpr double k_no_deadline = std::numeric_limits<double>::infinity();
  double deadline = k_no_deadline;
  [[nodiscard]] bool is_out_of_time() const { return deadline < k_no_deadline && now() >= deadline; }

  /// A call made earlier, by another run: it will not be made again. Its sizes must fit.
  void remember(const ModelCall& call);
  /// Whether point, sensitivity and answer have the sizes that such a call of the model has.
  [[nodiscard]] bool fits(const ModelCall& call) const;
  /// Called for each answer of a server as it comes, one at a time, from any thread.
  std::function<void(const ModelCall&)> answered;

  /// f into `values` (m × n). No call of any kind is made twice.
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, Eigen::MatrixXd& values);
  /// J into `jacobians` ((m·d) × n): the model's own, or by central differences of second order, one-sided
  /// ones where a central one would leave the support of a prior.
  void jacobian(const Eigen::Ref<const Eigen::MatrixXd>& points, Eigen::MatrixXd& jacobians);
  /// Jᵀ s of a model that has gradients; `sensitivities` m × n, `gradients` d × n.
  void gradient(const Eigen::Ref<const Eigen::MatrixXd>& points,
                const Eigen::Ref<const Eigen::MatrixXd>& sensitivities, Eigen::MatrixXd& gradients);
  /// Σ s_i ∇² f_i into `hessians` ((d·d) × n): the model's own, by central differences of its gradients, or
  /// (one output only) by differences of values.
  void hessian(const Eigen::Ref<const Eigen::MatrixXd>& points,
               const Eigen::Ref<const Eigen::MatrixXd>& sensitivities, Eigen::MatrixXd& hessians);

  /// Seconds spent in the model.
  [[nodiscard]] double seconds() const { return seconds_; }
  /// Called after each batch of evaluations, from the caller's thread.
  std::function<void(const model::ModelCalls&)> progress;

 private:
  [[nodiscard]] double step_of(Eigen::Index k, double p) const;
  void require_finite(const Eigen::Ref<const Eigen::MatrixXd>& points, const Eigen::MatrixXd& values,
                      const char* what) const;
  void hessian_of_gradients(const Eigen::MatrixXd& up, const Eigen::MatrixXd& down,
                            const Eigen::Ref<const Eigen::MatrixXd>& sensitivities,
                            Eigen::MatrixXd& hessians);
  void hessian_of_values(const Eigen::MatrixXd& centres, const Eigen::MatrixXd& steps,
                         const Eigen::MatrixXd& up, const Eigen::MatrixXd& down, Eigen::MatrixXd& hessians);
  [[nodiscard]] Eigen::Index answer_size(CallKind kind) const;
  [[nodiscard]] std::int64_t cost_of(CallKind kind) const;
  void keep(const ModelCall& call, bool of_earlier_run);
  /// Column by column: what is known, and for the rest what the model answers.
  void ask(CallKind kind, const Eigen::Ref<const Eigen::MatrixXd>& points,
           const Eigen::Ref<const Eigen::MatrixXd>& sensitivities, Eigen::MatrixXd& answers);
  void call(CallKind kind, const Eigen::MatrixXd& points, const Eigen::MatrixXd& sensitivities,
            Eigen::MatrixXd& answers);
  [[nodiscard]] Eigen::Index in_time(Eigen::Index wanted) const;

  model::ForwardModel* model_;
  std::vector<posterior::Prior> priors_;
  double step_;
  OwnDerivatives own_;
  double seconds_ = 0;
  std::int64_t budget_ = k_no_budget, earlier_ = 0;  ///< earlier_: cost of calls of an earlier run
  double slowest_ = 0;                               ///< seconds a call took, on average over a batch
  struct Known {
    Eigen::VectorXd answer;
    bool of_earlier_run = false;  ///< and not asked for yet
  };
  std::unordered_map<std::string, Known> known_;  ///< kind, point, sensitivity, byte by byte
  std::size_t stored_ = 0;                        ///< doubles in it
};

}  // namespace knothe::assimilation
