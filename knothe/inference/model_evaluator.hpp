#pragma once
/// @file A model called with care: nothing is computed twice, what is missing is differenced, what comes back
/// is checked.
#include <functional>
#include <string>
#include <unordered_map>
#include <vector>

#include "knothe/assimilation/update/prior.hpp"
#include "knothe/inference/forward_model.hpp"

namespace knothe::inference {

/// Which of the derivatives that a model says it has are used.
struct OwnDerivatives {
  bool gradient = true, jacobian = true, hessian = true;
};

/// Evaluations of a forward model at points of the priors' support. Points are d × n, one column each, as in
/// ForwardModel.
class ModelEvaluator {
 public:
  /// `step`: of differences, in units of each prior's scale (`scale_of`). The model must outlive this.
  ModelEvaluator(ForwardModel& model, std::vector<assimilation::Prior> priors, double step);

  [[nodiscard]] ForwardModel& model() { return *model_; }
  [[nodiscard]] const ForwardModel& model() const { return *model_; }

  /// What the model has and what may be used of it: all, until `use` says less.
  void use(OwnDerivatives own) { own_ = own; }
  [[nodiscard]] bool has_gradient() const { return own_.gradient && model_->has_gradient(); }
  [[nodiscard]] bool has_jacobian() const { return own_.jacobian && model_->has_jacobian(); }
  [[nodiscard]] bool has_hessian() const { return own_.hessian && model_->has_hessian(); }

  /// The points evaluated so far (d × n) with their values (m × n), as many as are stored.
  void stored(Eigen::MatrixXd& points, Eigen::MatrixXd& values) const;
  /// Points evaluated earlier, by another run: they will not be evaluated again. Errors: UsageError for sizes
  /// that do not fit.
  void remember(const Eigen::Ref<const Eigen::MatrixXd>& points,
                const Eigen::Ref<const Eigen::MatrixXd>& values);

  /// f into `values` (m × n). Points evaluated before are not evaluated again.
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
  std::function<void(const ModelCalls&)> progress;

 private:
  [[nodiscard]] double step_of(Eigen::Index k, double p) const;
  void require_finite(const Eigen::Ref<const Eigen::MatrixXd>& points, const Eigen::MatrixXd& values,
                      const char* what) const;
  void hessian_of_gradients(const Eigen::MatrixXd& up, const Eigen::MatrixXd& down,
                            const Eigen::Ref<const Eigen::MatrixXd>& sensitivities,
                            Eigen::MatrixXd& hessians);
  void hessian_of_values(const Eigen::MatrixXd& centres, const Eigen::MatrixXd& steps,
                         const Eigen::MatrixXd& up, const Eigen::MatrixXd& down, Eigen::MatrixXd& hessians);
  template <class Call>
  void timed(const Call& call);

  ForwardModel* model_;
  std::vector<assimilation::Prior> priors_;
  double step_;
  OwnDerivatives own_;
  double seconds_ = 0;
  std::unordered_map<std::string, std::size_t> known_;  ///< point, byte by byte → column of `stored_`
  std::vector<double> stored_;                          ///< outputs, m per point
};

}  // namespace knothe::inference
