#pragma once
/// @file What inference asks of a model: predictions at parameter points, and the derivatives it has.
#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <string>

namespace knothe::model {

/// Calls made to a model, one count per kind.
struct ModelCalls {
  std::int64_t evaluations = 0;  ///< points at which the outputs were computed
  std::int64_t gradients = 0;    ///< products of a transposed Jacobian and a vector
  std::int64_t jacobians = 0;    ///< products of a Jacobian and a vector
  std::int64_t hessians = 0;     ///< products of a Hessian and a vector
};

/// f: R^d → R^m. Batches hold one column per point, so that the outputs of a point are contiguous. Errors
/// of a model (no answer, wrong size, not finite) are DataErrors that name the point.
class ForwardModel {
 public:
  virtual ~ForwardModel() = default;
  [[nodiscard]] virtual Eigen::Index dimension() const = 0;     ///< d
  [[nodiscard]] virtual Eigen::Index output_count() const = 0;  ///< m
  /// What messages call the model.
  [[nodiscard]] virtual std::string where() const = 0;

  /// Whether 10⁵ evaluations take negligible time, as those of a reduced model do.
  [[nodiscard]] virtual bool is_cheap() const { return false; }
  [[nodiscard]] virtual bool has_gradient() const { return false; }
  [[nodiscard]] virtual bool has_jacobian() const { return false; }
  [[nodiscard]] virtual bool has_hessian() const { return false; }

  /// f at `points` (d × n) into `values` (m × n, sized by the caller).
  virtual void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points,
                        Eigen::Ref<Eigen::MatrixXd> values) = 0;
  /// Jᵀ s at each point: `sensitivities` m × n, `gradients` d × n. Only if `has_gradient`.
  virtual void gradient(const Eigen::Ref<const Eigen::MatrixXd>& points,
                        const Eigen::Ref<const Eigen::MatrixXd>& sensitivities,
                        Eigen::Ref<Eigen::MatrixXd> gradients);
  /// J at each point: column i of `jacobians` ((m·d) × n) is J_i, m × d column by column. Only if
  /// `has_jacobian`.
  virtual void jacobian(const Eigen::Ref<const Eigen::MatrixXd>& points,
                        Eigen::Ref<Eigen::MatrixXd> jacobians);
  /// Σ_i s_i ∇² f_i at each point: `hessians` (d·d) × n, symmetric. Only if `has_hessian`.
  virtual void hessian(const Eigen::Ref<const Eigen::MatrixXd>& points,
                       const Eigen::Ref<const Eigen::MatrixXd>& sensitivities,
                       Eigen::Ref<Eigen::MatrixXd> hessians);

  /// A model whose answers take long calls it, from any thread, when column i of the batch is complete.
  std::function<void(Eigen::Index)> answered;

  [[nodiscard]] const ModelCalls& calls() const { return calls_; }

 protected:
  ModelCalls calls_;
};

}  // namespace knothe::model
