#pragma once
/// @file A separated model as a forward model: chosen dofs at chosen time steps, or an output, with exact
/// derivatives.
#include <vector>

#include "knothe/model/forward/forward_model.hpp"
#include "knothe/model/observe/observed_model.hpp"

namespace knothe::model {

/// An output (a reaction force, …) in place of displacements: w are its values at the model's times.
/// UsageError for one that is not there.
[[nodiscard]] ObservedModel observe_output(const SeparatedModel& model, const std::string& name);

/// f = b + A w(p) with all steps stacked: step after step, in each the observed dofs in their order.
class SeparatedForwardModel final : public ForwardModel {
 public:
  /// `steps`: indices into the model's times. Errors: UsageError for a step that is not there.
  SeparatedForwardModel(const ObservedModel& model, const std::vector<std::size_t>& steps, std::string where);

  /// Leaves out all but these outputs: the others were not measured.
  void restrict_to(const std::vector<Eigen::Index>& outputs);

  [[nodiscard]] Eigen::Index dimension() const override { return functions_->dimension(); }
  [[nodiscard]] Eigen::Index output_count() const override { return offset_.size(); }
  [[nodiscard]] std::string where() const override { return where_; }
  [[nodiscard]] bool is_cheap() const override { return true; }
  [[nodiscard]] bool has_jacobian() const override { return true; }
  [[nodiscard]] bool has_hessian() const override { return true; }
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, Eigen::Ref<Eigen::MatrixXd> values) override;
  void jacobian(const Eigen::Ref<const Eigen::MatrixXd>& points,
                Eigen::Ref<Eigen::MatrixXd> jacobians) override;
  void hessian(const Eigen::Ref<const Eigen::MatrixXd>& points,
               const Eigen::Ref<const Eigen::MatrixXd>& sensitivities,
               Eigen::Ref<Eigen::MatrixXd> hessians) override;

 private:
  void functions_at(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives);

  std::shared_ptr<const ParameterFunctions> functions_;
  Eigen::MatrixXd matrix_;  ///< A, m × r
  Eigen::VectorXd offset_;  ///< b, m
  std::string where_;
  FunctionBatch batch_;
};

}  // namespace knothe::model
