#include "knothe/assimilation/update/posterior_shift.hpp"

#include <algorithm>
#include <cassert>

#include "knothe/base/cancellation.hpp"
#include "knothe/numerics/statistics/weighted_statistics.hpp"

namespace knothe::assimilation {
namespace {

using Eigen::Index;

/// Of two results with mean and covariance.
template <class Ours, class Theirs>
PosteriorShift difference(std::size_t step, const Ours& ours, const Theirs& reference) {
  const Eigen::ArrayXd std = reference.covariance.diagonal().array().sqrt();
  return {step, ((ours.mean - reference.mean).array().abs() / std).maxCoeff(),
          (ours.covariance.diagonal().array().sqrt() / std - 1).abs().maxCoeff()};
}

/// log L of all data up to `step` at points p.
Eigen::VectorXd log_likelihood(SequentialUpdate& update, std::size_t step, const Eigen::MatrixXd& p) {
  update.target().set_form(update.form_up_to(step));
  posterior::LogDensityBatch batch;
  batch.resize(p.rows(), p.cols(), 0);
  update.target().evaluate_likelihood(p, 0, batch);
  return batch.value;
}

/// The reference's weighted points with the model's likelihood in place of the reference's: no second
/// posterior is needed, and what the points are off by is off in both. Where too few points would be left the
/// shift is large, and the model's own posterior says how large.
PosteriorShift reweighted(SequentialUpdate& by_model, SequentialUpdate& by_reference, std::size_t step) {
  constexpr double k_enough = 0.05;
  const UpdateResult reference = by_reference.posterior_without_monitor(step);
  const Eigen::VectorXd change =
      log_likelihood(by_model, step, reference.points) - log_likelihood(by_reference, step, reference.points);
  const Eigen::VectorXd before = reference.weights.array().max(1e-300).log();
  const Eigen::VectorXd log_weight = before + change;
  if (numerics::effective_share(log_weight) < k_enough * numerics::effective_share(before))
    return difference(step, by_model.posterior_without_monitor(step), reference);
  const Eigen::VectorXd weights = (log_weight.array() - log_weight.maxCoeff()).exp();
  return difference(step, numerics::moments_of(reference.points, weights),
                    numerics::moments_of(reference.points, reference.weights));
}

std::vector<PosteriorShift> reweighted_shifts(SequentialUpdate& by_model, SequentialUpdate& by_reference,
                                              const Eigen::MatrixXd& data) {
  constexpr Index k_steps = 5;  // of those of the data
  const Index n = data.cols(), shown = std::min(n, k_steps);
  for (std::size_t t = 0; t < static_cast<std::size_t>(n); ++t) {
    const auto datum =
        std::make_shared<const likelihood::Datum>(likelihood::Datum{{}, t, t, data.col(t), {}});
    for (SequentialUpdate* update : {&by_model, &by_reference}) update->add(datum, t);
  }
  std::vector<PosteriorShift> shifts;
  for (Index k = 1; k <= shown; ++k) {
    check_cancellation("nothing is kept of the posteriors so far");
    shifts.push_back(reweighted(by_model, by_reference, k * n / shown - 1));
  }
  return shifts;
}

}  // namespace

std::vector<PosteriorShift> posterior_shift(std::shared_ptr<const model::ObservedModel> model,
                                            std::shared_ptr<const model::ObservedModel> reference,
                                            const Eigen::MatrixXd& data, const likelihood::NoiseModel& noise,
                                            const std::vector<posterior::Prior>& priors,
                                            posterior::Method kind) {
  assert(model->time.size() == reference->time.size() && data.cols() == std::ssize(model->time));
  const bool is_large = priors.size() > 3;
  UpdateOptions options;
  options.kind = is_large ? posterior::Method::automatic : kind;
  SequentialUpdate by_model(std::move(model), noise, priors, options);
  SequentialUpdate by_reference(std::move(reference), noise, priors, options);
  if (is_large) return reweighted_shifts(by_model, by_reference, data);
  std::vector<PosteriorShift> shifts;
  for (Index t = 0; t < data.cols(); ++t) {
    check_cancellation("nothing is kept of the posteriors so far");
    const std::size_t step = t;
    const UpdateResult& ours = by_model.update(step, step, data.col(t));
    const UpdateResult& theirs = by_reference.update(step, step, data.col(t));
    shifts.push_back(difference(step, ours, theirs));
  }
  return shifts;
}

ShiftSummary summarise(const std::vector<PosteriorShift>& shifts) {
  assert(!shifts.empty());
  const auto by_mean = [](const PosteriorShift& a, const PosteriorShift& b) { return a.mean < b.mean; };
  const auto by_std = [](const PosteriorShift& a, const PosteriorShift& b) { return a.std < b.std; };
  return {*std::max_element(shifts.begin(), shifts.end(), by_mean),
          *std::max_element(shifts.begin(), shifts.end(), by_std), shifts.back()};
}

}  // namespace knothe::assimilation
