#pragma once
/// @file What composed maps need: the target of the next map (Rubio et al. 2019, Eq. 11), and the importance
/// weights of a composition against the whole posterior.
#include <Eigen/Core>

#include "knothe/likelihood/step/collapsed_posterior.hpp"
#include "knothe/model/observe/observed_model.hpp"
#include "knothe/posterior/log_density.hpp"
#include "knothe/posterior/map/composed_map.hpp"

namespace knothe::likelihood {

/// log π*_i(x) = log π_{t_i}(d_i | M^c_{i−1}(x)) + log ρ(x): the likelihood of one datum seen through the
/// maps so far.
class ComposedStepDensity final : public posterior::LogDensity {
 public:
  explicit ComposedStepDensity(CollapsedLogDensity likelihood) : likelihood_(std::move(likelihood)) {}

  /// The composition M^c_{i−1}, which must outlive the evaluations, and the datum's form.
  void set(const posterior::ComposedMap& previous, const StepForm& datum);

  [[nodiscard]] Eigen::Index dimension() const override { return likelihood_.dimension(); }
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& x, int derivatives,
                posterior::LogDensityBatch& out) override;

 private:
  CollapsedLogDensity likelihood_;
  const posterior::ComposedMap* previous_ = nullptr;
  CollapsedLogDensity::Factor factor_ = CollapsedLogDensity::Factor::likelihood;
  posterior::MapBatch map_;
  posterior::LogDensityBatch inner_;
};

/// The maps so far, composed, and the target of the next one.
struct MapComposition {
  MapComposition(const model::ObservedModel& model,
                 std::shared_ptr<const posterior::PriorTransform> transform, const Eigen::VectorXd& central)
      : map(transform->dimension()),
        density(CollapsedLogDensity(model.functions, std::move(transform), central)) {}

  posterior::ComposedMap map;  ///< M_1 ∘ … ∘ M_i, Eq. 10
  ComposedStepDensity density;
  posterior::MapBatch batch;
};

/// Points z = T(x) with importance weights π̄(z) |det ∇T(x)| / ρ(x).
struct PushedPoints {
  Eigen::VectorXd weights;              ///< n, sum 1
  double effective_sample_size = 0;     ///< fraction
  double variance_diagnostic = 0;       ///< Eq. 9
  double log_evidence = 0;              ///< consistent
  double log_evidence_lower_bound = 0;  ///< Eq. 24
};
[[nodiscard]] PushedPoints push_forward(posterior::LogDensity& target, const Eigen::MatrixXd& reference,
                                        const posterior::MapBatch& pushed);

}  // namespace knothe::likelihood
