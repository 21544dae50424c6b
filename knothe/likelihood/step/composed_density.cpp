#include "knothe/likelihood/step/composed_density.hpp"

#include <array>
#include <cmath>

#include "knothe/numerics/statistics/weighted_statistics.hpp"

namespace knothe::likelihood {

void ComposedStepDensity::set(const posterior::ComposedMap& previous, const StepForm& datum) {
  previous_ = &previous;
  using Factor = CollapsedLogDensity::Factor;
  factor_ = previous.parts().empty() ? Factor::likelihood_and_dependence : Factor::likelihood;
  likelihood_.set_form(datum);
}

void ComposedStepDensity::evaluate(const Eigen::Ref<const Eigen::MatrixXd>& x, int derivatives,
                                   posterior::LogDensityBatch& out) {
  const Eigen::Index n = x.rows(), d = dimension(), packed = d * (d + 1) / 2;
  map_.resize(n, d, derivatives);
  previous_->evaluate(x, derivatives, map_);
  inner_.resize(n, d, derivatives);
  likelihood_.evaluate_standardised(map_.value, derivatives, factor_, inner_);
  out.value = inner_.value;
  // Chain rule through z = M^c(x): ∇ = Jᵀ ∇_z and ∇² = Jᵀ ∇²_z J + Σ_i (∂log π/∂z_i) ∇² M^c_i.
  if (derivatives >= 1) {
    out.gradient.setZero();
    for (Eigen::Index i = 0; i < d; ++i) {
      for (Eigen::Index a = 0; a < d; ++a) {
        out.gradient.col(a).array() += inner_.gradient.col(i).array() * map_.jacobian.col(i * d + a).array();
      }
    }
  }
  if (derivatives >= 2) {
    out.hessian.setZero();
    for (Eigen::Index a = 0; a < d; ++a) {
      for (Eigen::Index b = 0; b <= a; ++b) {
        const Eigen::Index ab = posterior::packed_index(a, b);
        auto entry = out.hessian.col(ab).array();
        for (Eigen::Index i = 0; i < d; ++i) {
          entry += inner_.gradient.col(i).array() * map_.hessian.col(i * packed + ab).array();
          for (Eigen::Index j = 0; j < d; ++j) {
            entry += inner_.hessian.col(posterior::packed_index(i, j)).array() *
                     map_.jacobian.col(i * d + a).array() * map_.jacobian.col(j * d + b).array();
          }
        }
      }
    }
  }
  add_standard_normal(x, derivatives, out);
}

PushedPoints push_forward(posterior::LogDensity& target, const Eigen::MatrixXd& reference,
                          const posterior::MapBatch& pushed) {
  const Eigen::Index n = reference.rows();
  posterior::LogDensityBatch batch;
  batch.resize(n, reference.cols(), 0);
  target.evaluate(pushed.value, 0, batch);
  const Eigen::ArrayXd log_weight = batch.value.array() + pushed.log_determinant.array() -
                                    posterior::standard_normal_log_density(reference).array();
  const double largest = log_weight.maxCoeff(), count = n;
  const Eigen::ArrayXd weight = (log_weight - largest).exp();
  const double sum = weight.sum();
  PushedPoints result;
  result.weights = weight / sum;
  result.effective_sample_size = 1 / (result.weights.squaredNorm() * count);
  result.log_evidence = largest + std::log(sum / count);
  result.log_evidence_lower_bound = log_weight.mean();
  result.variance_diagnostic = 0.5 * (log_weight - log_weight.mean()).square().mean();
  return result;
}

}  // namespace knothe::likelihood
