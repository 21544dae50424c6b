#include "knothe/assimilation/update/baseline_update.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <chrono>
#include <cmath>
#include <numbers>

#include "knothe/assimilation/update/composed_density.hpp"
#include "knothe/assimilation/update/maximum_a_posteriori.hpp"
#include "knothe/assimilation/update/prior_of_model.hpp"
#include "knothe/base/error.hpp"
#include "knothe/numerics/statistics/weighted_statistics.hpp"
#include "knothe/sampling/adaptive_metropolis.hpp"
#include "knothe/sampling/sequential_monte_carlo.hpp"
#include "knothe/transport/diagnose/trust.hpp"

namespace knothe::assimilation {
namespace {

constexpr Eigen::Index k_reference_points = 1024;

double log_sum_exp(const Eigen::VectorXd& x) {
  const double most = x.maxCoeff();
  return most + std::log((x.array() - most).exp().sum());
}

}  // namespace

BaselineUpdate::BaselineUpdate(std::shared_ptr<const reduction::ObservedModel> model, NoiseModel noise,
                               std::vector<Prior> priors, BaselineOptions options)
    : options_(options),
      transform_(truncated_to_box(*model, std::move(priors))),
      projector_(model, std::move(noise), medians(*transform_)),
      target_(model->functions, transform_, projector_.central_functions()),
      reference_(standardised_points(k_reference_points, transform_->dimension(), options.seed)),
      sum_(StepForm::zero(model->functions->count())) {
  if (options_.kind == Method::sequential_monte_carlo || options_.kind == Method::markov_chain) return;
  filter_.emplace(options_.kind, model->functions, transform_, projector_.central_functions(),
                  std::max<Eigen::Index>(options_.samples / 50, 20), options_.seed);
}

const UpdateResult& BaselineUpdate::update(std::size_t step, std::size_t time_index,
                                           const Eigen::Ref<const Eigen::VectorXd>& values) {
  using Clock = std::chrono::steady_clock;
  if (last_ && step <= *last_) {
    throw UsageError(
        fmt::format("step {} comes after step {}: a filter takes the steps in order", step, *last_));
  }
  const auto start = Clock::now();
  StepForm form;
  projector_.project(step, time_index, values, form);
  last_ = step;
  sum_.add(form);
  target_.set_form(sum_);
  const double before = log_evidence_;
  result_ = {};
  result_.method = options_.kind;
  result_.step = step;
  result_.time = projector_.model().time[time_index];
  result_.used = form.used;
  result_.missing = form.missing;
  if (filter_) {
    by_filter(form);
  } else if (options_.kind == Method::sequential_monte_carlo) {
    by_particles();
  } else {
    by_chain();
  }
  log_evidence_ = result_.log_evidence;
  result_.log_evidence_lower_bound = result_.log_evidence;
  result_.log_evidence_increment = log_evidence_ - before;
  result_.elapsed_us.map = std::chrono::duration<double, std::micro>(Clock::now() - start).count();
  return result_;
}

Eigen::VectorXd BaselineUpdate::log_weights(const Eigen::VectorXd& mean, const Eigen::MatrixXd& covariance,
                                            Eigen::MatrixXd& z) {
  const Eigen::LLT<Eigen::MatrixXd> factor(covariance);
  const Eigen::MatrixXd root = factor.matrixL();
  z = (reference_ * root.transpose()).rowwise() + mean.transpose();
  sampling::LogDensityBatch batch;
  batch.resize(z.rows(), z.cols(), 0);
  target_.evaluate(z, 0, batch);
  const double normaliser = 0.5 * static_cast<double>(mean.size()) * std::log(2 * std::numbers::pi) +
                            root.diagonal().array().log().sum();
  return batch.value + 0.5 * reference_.rowwise().squaredNorm() +
         Eigen::VectorXd::Constant(z.rows(), normaliser);
}

void BaselineUpdate::by_filter(const StepForm& form) {
  result_.log_evidence = log_evidence_ + filter_->update(form);
  Eigen::MatrixXd z;
  const Eigen::VectorXd weights = log_weights(filter_->mean(), filter_->covariance(), z);
  if (filter_->members().rows() > 0) z = filter_->members();
  set_points(z, Eigen::VectorXd::Constant(z.rows(), 1 / static_cast<double>(z.rows())));
  result_.effective_sample_size = numerics::effective_share(weights);
  result_.variance_diagnostic =
      0.5 * (weights.array() - weights.mean()).square().sum() / static_cast<double>(weights.size());
  result_.tolerance_reached = false;
  const transport::Trust trust =
      transport::assess_trust({result_.variance_diagnostic, result_.effective_sample_size, false, ""});
  result_.trusted = result_.tolerance_reached = trust.trusted;
  if (!trust.trusted) result_.remark = "the posterior is not the Gaussian of the filter: " + trust.reason;
  const Eigen::VectorXd& m = filter_->mean();
  result_.maximum_a_posteriori.resize(m.size());
  for (Eigen::Index k = 0; k < m.size(); ++k)
    result_.maximum_a_posteriori[k] = transform_->prior(k).from_standard_normal(m[k]).value;
}

void BaselineUpdate::by_particles() {
  sampling::SequentialMonteCarloOptions options;
  options.particles = std::max<Eigen::Index>(options_.samples / 5, 100);
  options.seed = options_.seed;
  const auto particles = sampling::sequential_monte_carlo(target_, options);
  set_points(particles.sample.points, particles.sample.weights);
  result_.log_evidence = particles.sample.log_evidence;
  result_.effective_sample_size =
      std::min(1.0, particles.sample.effective_size / static_cast<double>(options.particles));
  result_.trusted = result_.tolerance_reached =
      particles.acceptance >= 0.05 && particles.sample.effective_size >= 400;
  if (!result_.trusted) result_.remark = "too few effective particles: raise method.samples";
  result_.maximum_a_posteriori = maximum_a_posteriori(target_, *transform_, result_.mean);
}

void BaselineUpdate::by_chain() {
  sampling::MetropolisOptions options;
  options.samples = options_.samples;
  options.seed = options_.seed;
  const auto chains = sampling::adaptive_metropolis(target_, options);
  set_points(chains.sample.points, chains.sample.weights);
  result_.effective_sample_size =
      std::min(1.0, chains.effective_sizes.minCoeff() / static_cast<double>(chains.sample.points.rows()));
  result_.trusted = result_.tolerance_reached = chains.converged;
  if (!chains.converged) result_.remark = "the chains have not converged: raise method.samples";
  // A little wider than the draws, so that weights stay bounded where the posterior is nearly Gaussian.
  Eigen::MatrixXd z;
  const Eigen::VectorXd weights =
      log_weights(sampling::mean_of(chains.sample), 1.44 * sampling::covariance_of(chains.sample), z);
  result_.log_evidence = log_sum_exp(weights) - std::log(static_cast<double>(weights.size()));
  result_.maximum_a_posteriori = maximum_a_posteriori(target_, *transform_, result_.mean);
}

void BaselineUpdate::set_points(const Eigen::MatrixXd& z, const Eigen::VectorXd& weights) {
  result_.points.resize(z.rows(), z.cols());
  Eigen::MatrixXd unused;
  transform_->evaluate(z, 0, result_.points, unused, unused);
  result_.weights = weights;
  result_.summarise();
  result_.map_mean = result_.mean;
  result_.map_covariance = result_.covariance;
  result_.quantiles = transform_->carry(numerics::weighted_quantiles(z, weights));
}

}  // namespace knothe::assimilation
