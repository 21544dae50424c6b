#pragma once
/// @file The likelihood of one component of a map from samples, with exact gradient and Hessian. Private to
/// the room.
#include <Eigen/Core>
#include <vector>

#include "knothe/base/index.hpp"
#include "knothe/numerics/optimise/minimiser.hpp"
#include "knothe/posterior/map/triangular_map.hpp"

namespace knothe::posterior {

/// J_k of sample_map.hpp. With b_j = Σ_{α: α_k = j} a_α Φ'_α(x_1 … x_{k−1}) and h(θ) = Σ_j b_j ψ_j(θ):
///   S = Φ_c a_c + ∫₀^{x_k} r(h) dθ,  ∂S/∂b_j = ∫ r'(h) ψ_j,  ∂²S/∂b_j∂b_l = ∫ r''(h) ψ_j ψ_l.
class SampleObjective final : public numerics::Objective {
 public:
  /// Component k of `map`, an integrated softplus, at the samples y (n × d, standardised). The map must
  /// outlive this.
  SampleObjective(const TriangularMap& map, Index k, const Eigen::Ref<const Eigen::MatrixXd>& y,
                  double regularisation);
  /// Σ w = 1. Samples of weight zero take no part; `held_out` tells about them.
  void set_weights(Eigen::VectorXd weights) { weights_ = std::move(weights); }
  [[nodiscard]] Index dimension() const override { return constant_.cols() + monotone_count_; }
  bool evaluate(const Eigen::VectorXd& a, int derivatives, double& value, Eigen::VectorXd& gradient,
                Eigen::MatrixXd& hessian) override;
  /// ½ S² − log ∂_k S at every sample.
  [[nodiscard]] Eigen::VectorXd losses(const Eigen::VectorXd& a);
  /// The best affine component in closed form: least squares on the linear terms it has.
  [[nodiscard]] Eigen::VectorXd affine_start() const;

 private:
  void collapse(const Eigen::VectorXd& a);
  void integrate(int derivatives);

  double regularisation_;
  Eigen::VectorXd own_;        ///< n: y_k
  Eigen::MatrixXd constant_;   ///< n × n_c: Φ_c
  std::vector<Index> linear_;  ///< columns of Φ_c that are single coordinates
  Index constant_column_ = 0;  ///< of Φ_c that is 1
  Index unit_monotone_ = 0;    ///< in a_e, the empty index
  Eigen::VectorXd penalised_;  ///< 1 for coefficients under λ, else 0
  Index monotone_count_ = 0, degrees_ = 0;
  std::vector<std::vector<Index>> of_degree_;   ///< per degree in x_k: its coefficients in a_e
  std::vector<Eigen::MatrixXd> prefix_;         ///< per degree, n × their number: Φ'_α
  Eigen::MatrixXd psi_;                         ///< n × degrees: ψ_j(y_k)
  std::vector<std::size_t> rule_begin_;         ///< n + 1: of each sample's integration nodes
  std::vector<double> rule_weight_, rule_psi_;  ///< nodes; nodes × degrees
  Eigen::VectorXd weights_;
  Eigen::MatrixXd b_, g_, curvature_;  ///< n × degrees, the same, n × degrees²
  Eigen::VectorXd h_, integral_;
};

}  // namespace knothe::posterior
