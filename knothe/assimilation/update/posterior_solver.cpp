#include "knothe/assimilation/update/posterior_solver.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "knothe/assimilation/update/maximum_a_posteriori.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/monotonic_time.hpp"
#include "knothe/likelihood/step/posterior_functions.hpp"
#include "knothe/numerics/statistics/weighted_statistics.hpp"
#include "knothe/posterior/draws/adaptive_importance.hpp"
#include "knothe/posterior/quadrature/filled_quadrature.hpp"
#include "knothe/posterior/solve.hpp"
#include "knothe/posterior/trust.hpp"

namespace knothe::assimilation {
namespace {

/// Below this effective sample size (fraction) weighted points give way to quadrature, where the parameters
/// are few enough: it costs less than the points that would be needed, and finds the modes that a map may
/// miss.
constexpr double k_quadrature_below = 0.98;
/// Of the log-evidence, of means and standard deviations in standard deviations; and of the mass left out at
/// the border of the grid, which costs moments a few times as much.
constexpr double k_converged = 0.01, k_border_mass = 1e-3;
/// Beyond this many nodes another method is cheaper.
constexpr Eigen::Index k_max_quadrature_nodes = 60'000, k_max_nodes_of_three = 600'000;
/// Beyond these particles do not find the mass; and of so many a posterior consists at most.
constexpr Eigen::Index k_max_particle_parameters = 8, k_max_particles = 4096;
/// Of the log-evidence, of a posterior by quadrature alone: quantiles to 1e-3 std.
constexpr double k_grid_tolerance = 1e-8;

/// A datum comes every few milliseconds: where the standard way does not reach the tolerance, the importance
/// correction answers for it, not a search among other parametrisations.
posterior::MapSolverOptions online(const UpdateOptions& options) {
  posterior::MapSolverOptions map = options.map;
  map.fallback = false;
  map.search_modes = options.search_modes;
  // A mixture over the sizes of a discrepancy has tails that no order of a map follows: a low one, and the
  // correction or quadrature.
  const bool mixture =
      (options.learn_bias || options.bias_correction != likelihood::BiasCorrectionMode::off) &&
      options.bias.way == likelihood::BiasOptions::Way::joint;
  if (mixture) {
    map.max_order = std::min(map.max_order, 2);
    map.long_first_variable = false;
  }
  return map;
}

posterior::MapFigures figures_of(const posterior::Posterior& r) {
  return {r.variance_diagnostic, r.effective_sample_size, r.second_mode_found, ""};
}

/// Of a map whose solve said `why_missed` where the tolerance was missed.
void set_map_trust(posterior::Posterior& r, const std::string& why_missed) {
  r.set_trust(posterior::trust_of(figures_of(r)), why_missed);
}

void set_map_moments(const Eigen::MatrixXd& p, posterior::Posterior& r) {
  r.map_mean = p.colwise().mean();
  const Eigen::MatrixXd centred = p.rowwise() - r.map_mean.transpose();
  r.map_covariance.noalias() = centred.transpose() * centred / p.rows();
}

}  // namespace

PosteriorSolver::PosteriorSolver(const model::ObservedModel& model,
                                 std::shared_ptr<const posterior::PriorTransform> transform,
                                 const Eigen::VectorXd& central, const UpdateOptions& options)
    : kind_(options.kind),
      samples_(options.samples),
      functions_(model.functions),
      central_(central),
      transform_(std::move(transform)),
      target_(model.functions, transform_, central),
      solver_(online(options)) {
  if (kind_ == posterior::Method::grid && transform_->dimension() > 3)
    throw ProjectError("method.kind = \"grid\" takes 1 to 3 parameters; use \"transport\" for more");
  if (options.noise_level) target_.infer_noise_level(*options.noise_level);
  if (posterior::is_filter(kind_)) {
    make_filter();
  } else if (options.form == UpdateOptions::Form::composed) {
    composition_.emplace(model, transform_, central);
  }
  // Where maps are the usual way, what they need is made beforehand: tenths of a second.
  const Eigen::Index d = transform_->dimension();
  if (composition_ || kind_ == posterior::Method::transport ||
      (kind_ == posterior::Method::automatic && d > k_max_particle_parameters))
    solver_.prepare(d);
}

void PosteriorSolver::make_filter() {
  filter_.emplace(kind_, functions_, transform_, central_, std::max<Eigen::Index>(samples_ / 50, 20),
                  solver_.options().seed);
  filter_log_evidence_ = 0;
}

Eigen::MatrixXd PosteriorSolver::parameters(const Eigen::MatrixXd& z) const {
  Eigen::MatrixXd p(z.rows(), z.cols()), none;
  transform_->evaluate(z, 0, p, none, none);
  return p;
}

void PosteriorSolver::set(const likelihood::FormSums& sums, const Eigen::VectorXd& shares) {
  if (sums.levels.empty()) return target_.set_form(sums.form);
  std::vector<const likelihood::StepForm*> forms = {&sums.form};
  for (const likelihood::StepForm& sum : sums.levels) forms.push_back(&sum);
  const std::vector<double> weights(forms.size(), -std::log(forms.size()));
  target_.set_mixture(forms, weights, std::span(shares.data(), shares.size()));
}

void PosteriorSolver::solve(const likelihood::StepForm& last, posterior::Posterior& posterior,
                            UpdateTimes& times) {
  if (filter_) return by_filter(last, posterior, times);
  if (composes()) {
    shares_.reset();
    by_composed_maps(last, posterior, times);
  } else {
    solve_collapsed(posterior, times);
  }
  const auto start = monotonic_now();
  posterior.maximum_a_posteriori = maximum_a_posteriori(target_, *transform_, posterior.mean);
  times.correction += microseconds_since(start);
  if (target_.noise_level()) posterior.noise_level = expected_noise_level(posterior);
}

bool PosteriorSolver::composes() const {
  return composition_ && (kind_ == posterior::Method::automatic || kind_ == posterior::Method::transport);
}

void PosteriorSolver::solve_widened(double power, posterior::Posterior& posterior, UpdateTimes& times) {
  if (filter_) {
    filter_->raise(power);
    return set_from_filter(posterior);
  }
  if (!composes()) return solve_collapsed(posterior, times);
  by_collapsed_map(posterior, times);
  compose_anew();
}

void PosteriorSolver::solve_collapsed(posterior::Posterior& posterior, UpdateTimes& times) {
  shares_.reset();
  posterior.few = {};
  posterior.method = posterior::Method::transport;
  if (kind_ == posterior::Method::grid) return by_grid(posterior, times);
  if (kind_ == posterior::Method::markov_chain || kind_ == posterior::Method::sequential_monte_carlo) {
    const auto start = monotonic_now();
    draw(target_, kind_, posterior);
    times.map = microseconds_since(start);
    return;
  }
  if (kind_ == posterior::Method::automatic) {
    if (by_quadrature(posterior, times)) return;
    const Eigen::Index d = transform_->dimension();
    if (d > posterior::k_max_quadrature_parameters && d <= k_max_particle_parameters)
      return by_particles(posterior, times);
  }
  by_collapsed_map(posterior, times);
}

Eigen::VectorXd PosteriorSolver::component_shares(const posterior::Posterior& posterior) {
  return shares_ ? *shares_ : target_.component_shares(posterior.points, posterior.weights);
}

void PosteriorSolver::restart() {
  if (composition_) composition_->map = posterior::ComposedMap(transform_->dimension());
  if (filter_) make_filter();
}

double PosteriorSolver::expected_noise_level(const posterior::Posterior& posterior) {
  posterior::LogDensityBatch batch;
  batch.resize(posterior.points.rows(), posterior.points.cols(), 0);
  target_.evaluate_likelihood(posterior.points, 0, batch);
  double mean = 0;
  for (Eigen::Index i = 0; i < batch.value.size(); ++i)
    mean += posterior.weights[i] * target_.noise_level()->expected(batch.value[i]);
  return mean;
}

/// False, and nothing has been set, where it would take too many nodes.
bool PosteriorSolver::by_quadrature(posterior::Posterior& r, UpdateTimes& times) {
  if (transform_->dimension() > 3) return false;
  const auto start = monotonic_now();
  posterior::QuadratureOptions options{.evidence_tolerance = k_converged, .moment_tolerance = k_converged};
  const bool three = transform_->dimension() == 3;
  options.max_nodes = three ? k_max_nodes_of_three : k_max_quadrature_nodes;
  const posterior::QuadraturePosterior quadrature =
      three ? quadrature_of_parts(options) : posterior::tensor_quadrature(target_, options, search_);
  times.map = microseconds_since(start);
  if (!quadrature.resolved()) return false;
  set_from(quadrature, r);
  r.map_mean = r.mean;
  r.map_covariance = r.covariance;
  r.log_evidence_lower_bound = r.log_evidence;
  r.by_quadrature = true;
  set_few_points(quadrature, r);
  if (three) posterior::thin(r.points, r.weights, k_max_particles, solver_.options().seed);
  times.map = microseconds_since(start);
  return true;
}

/// Parts of a mixture each on a lattice of its own; as they are once one is not resolved.
posterior::QuadraturePosterior PosteriorSolver::quadrature_of_parts(
    const posterior::QuadratureOptions& options) {
  std::vector<posterior::QuadraturePosterior> parts;
  for (std::size_t k = 0; k < target_.component_count(); ++k) {
    if (!target_.is_felt(k)) continue;
    target_.single_out(k);
    parts.push_back(posterior::filled_quadrature(target_, options, search_));
    target_.single_out({});
    if (!parts.back().resolved()) return std::move(parts.back());
  }
  if (parts.size() == 1) return std::move(parts.front());
  posterior::QuadraturePosterior all = posterior::joined(parts);
  const Eigen::Index count = target_.component_count();
  shares_ = Eigen::VectorXd::Zero(count);
  for (const posterior::QuadraturePosterior& part : parts) {
    target_.set_grid(part.lattice.axes);
    *shares_ += std::exp(part.log_evidence - all.log_evidence) *
                target_.component_shares(part.lattice.runs, part.lattice.weights);
  }
  return all;
}

void PosteriorSolver::by_particles(posterior::Posterior& r, UpdateTimes& times) {
  const auto start = monotonic_now();
  posterior::AdaptiveImportanceOptions options;
  options.seed = solver_.options().seed;
  options.variables = [this](Eigen::MatrixXd& z) {
    turned_ = z;
    transform_->evaluate(turned_, 0, z, no_derivatives_, no_derivatives_);
  };
  posterior::set_from_draws(
      posterior::adaptive_importance(target_, options),
      [this](const Eigen::MatrixXd& z) { return parameters(z); }, 1, r);
  thin_draws(r);
  times.map = microseconds_since(start);
  times.correction = 0;
}

void PosteriorSolver::draw(posterior::LogDensity& target, posterior::Method kind, posterior::Posterior& r) {
  const posterior::ToParameters to_parameters = [this](const Eigen::MatrixXd& z) { return parameters(z); };
  const std::uint64_t seed = solver_.options().seed;
  if (kind == posterior::Method::markov_chain) {
    posterior::solve_by_chains(target, to_parameters, {.samples = samples_, .seed = seed}, r);
    return;
  }
  posterior::RecycledImportanceOptions options;
  options.max_evaluations = std::max<std::int64_t>(options.max_evaluations, 2 * samples_);
  options.seed = seed;
  posterior::solve_by_draws(target, to_parameters, options, r);
  // Who asks for draws gets all of them: their moments are the answer's.
  if (kind_ == posterior::Method::sequential_monte_carlo) {
    posterior::sort_along_curve(r.points, r.weights);
  } else {
    thin_draws(r);
  }
}

void PosteriorSolver::thin_draws(posterior::Posterior& r) const {
  posterior::thin(r.points, r.weights, k_max_particles, solver_.options().seed);
  posterior::sort_along_curve(r.points, r.weights);  // the alarm predicts from some of them
}

/// The filter's own Gaussian of z: moments, quantiles and evidence are its, uncorrected. Importance weights
/// from it to the exact posterior say how far that is off, so that `trusted` means what it means for a map.
void PosteriorSolver::by_filter(const likelihood::StepForm& last, posterior::Posterior& r,
                                UpdateTimes& times) {
  const auto start = monotonic_now();
  filter_log_evidence_ += filter_->update(last);
  set_from_filter(r);
  times.map = microseconds_since(start);
}

void PosteriorSolver::set_from_filter(posterior::Posterior& r) {
  constexpr Eigen::Index k_reference_points = 1024;
  const Eigen::Index d = transform_->dimension();
  const Eigen::MatrixXd reference = standardised_points(k_reference_points, d, solver_.options().seed);
  const Eigen::MatrixXd root = filter_->covariance().llt().matrixL();
  Eigen::MatrixXd z = (reference * root.transpose()).rowwise() + filter_->mean().transpose();
  posterior::LogDensityBatch batch;
  batch.resize(z.rows(), d, 0);
  target_.evaluate(z, 0, batch);
  const Eigen::VectorXd log_weight = batch.value + 0.5 * reference.rowwise().squaredNorm();
  if (filter_->members().rows() > 0) z = filter_->members();
  const Eigen::VectorXd weights = Eigen::VectorXd::Constant(z.rows(), 1.0 / z.rows());
  set_from(z, weights, numerics::weighted_quantiles(z, weights), r);
  r.method = kind_;
  r.map_mean = r.mean;
  r.map_covariance = r.covariance;
  r.log_evidence = r.log_evidence_lower_bound = filter_log_evidence_;
  r.effective_sample_size = numerics::effective_share(log_weight);
  r.variance_diagnostic = 0.5 * (log_weight.array() - log_weight.mean()).square().mean();
  const posterior::Trust trust = posterior::trust_of_gaussian(figures_of(r));
  r.set_trust(trust);
  r.tolerance_reached = trust.trusted;
  r.maximum_a_posteriori = parameters(filter_->mean().transpose()).row(0).transpose();
}

/// Every other node, whose rule has the moments and the evidence of all to 1 %; but those that carry little,
/// together less than that.
void PosteriorSolver::set_few_points(const posterior::QuadraturePosterior& quadrature,
                                     posterior::Posterior& r) {
  std::vector<Eigen::Index> kept;
  const double floor = 0.01 / r.weights.size();
  for (const Eigen::Index i : quadrature.every_other)
    if (r.weights[i] > floor) kept.push_back(i);
  if (kept.empty() || std::ssize(kept) > likelihood::k_prediction_points) return;
  r.few.points = r.points(kept, Eigen::all);
  r.few.weights = r.weights(kept);
  r.few.weights /= r.few.weights.sum();
  const auto width = [](const Eigen::MatrixXd& quantiles) -> Eigen::VectorXd {
    return quantiles.rightCols<1>() - quantiles.leftCols<1>();
  };
  r.few.cell = width(r.quantiles).cwiseQuotient(width(quadrature.quantiles)).asDiagonal() * quadrature.cell;
}

void PosteriorSolver::by_grid(posterior::Posterior& r, UpdateTimes& times) {
  const auto start = monotonic_now();
  // The plain answer: a first look that no ridge of a crack's run slips through.
  using Axes = posterior::QuadratureOptions::Axes;
  static constexpr Eigen::Index k_nodes[] = {257, 301, 25};
  const Eigen::Index d = transform_->dimension();
  const posterior::QuadraturePosterior grid =
      posterior::tensor_quadrature(target_, {.axes = d < 3 ? Axes::parameters : Axes::modes,
                                             .evidence_tolerance = k_grid_tolerance,
                                             .coarse_nodes = k_nodes[d - 1],
                                             .whole_range = d < 3});
  set_from(grid, r);
  r.map_mean = r.mean;
  r.map_covariance = r.covariance;
  r.log_evidence_lower_bound = grid.log_evidence;
  r.set_trust(posterior::trust_of(grid.figures()));
  r.tolerance_reached = r.trusted;
  times.map = microseconds_since(start);
}

void PosteriorSolver::by_collapsed_map(posterior::Posterior& r, UpdateTimes& times) {
  const auto start = monotonic_now();
  solver_.solve(target_, map_);
  times.map = microseconds_since(start);
  const auto correction_start = monotonic_now();
  const double ess = numerics::effective_share(map_.verification.log_weight);
  set_from(map_, r);
  // A second mode may be nearly as heavy as the map's, whose points cover it badly.
  const bool may_integrate = transform_->dimension() <= posterior::k_max_quadrature_parameters;
  bool by_quadrature = may_integrate && (ess < k_quadrature_below || map_.second_mode_found);
  if (!by_quadrature) {
    solver_.correct(target_, map_, correction_);
    // The points of the correction may find what those of the verification have missed.
    by_quadrature = may_integrate && correction_.ess < k_quadrature_below;
  }
  if (by_quadrature) {
    r.effective_sample_size = ess;
    r.log_evidence_lower_bound = map_.map_log_evidence();
    integrate(target_, r);
    set_map_trust(r, map_.reason);
    r.remark += fmt::format("{}moments, quantiles and evidence are by quadrature at {} points",
                            r.remark.empty() ? "" : "; ", r.weights.size());
  } else {
    r.effective_sample_size = correction_.ess;
    r.log_evidence = correction_.log_evidence;
    r.log_evidence_lower_bound = correction_.map_log_evidence;
    set_from(correction_.points, correction_.weights, correction_.quantiles, r);
    set_map_trust(r, map_.reason);
  }
  times.correction = microseconds_since(correction_start);
}

void PosteriorSolver::integrate(posterior::LogDensity& target, posterior::Posterior& r) {
  const posterior::QuadraturePosterior quadrature = posterior::tensor_quadrature(target, {}, search_);
  set_from(quadrature, r);
  r.by_quadrature = quadrature.evidence_change <= k_converged && quadrature.moment_change <= k_converged &&
                    quadrature.mass_at_border <= k_border_mass;
  r.trusted = r.by_quadrature;
}

void PosteriorSolver::compose_anew() {
  restart();
  composition_->map.append(map_.pre_map);
  composition_->map.append(map_.map);
}

void PosteriorSolver::by_composed_maps(const likelihood::StepForm& last, posterior::Posterior& r,
                                       UpdateTimes& times) {
  const auto start = monotonic_now();
  likelihood::MapComposition& composition = *composition_;
  composition.density.set(composition.map, last);
  solver_.solve(composition.density, map_);
  composition.map.append(map_.pre_map);
  composition.map.append(map_.map);

  // The composition as a whole is judged, and corrected, against the whole posterior.
  const auto correction_start = monotonic_now();
  composition.batch.resize(map_.verification.reference.rows(), transform_->dimension(), 0);
  composition.map.evaluate(map_.verification.reference, 0, composition.batch);
  const likelihood::PushedPoints pushed =
      likelihood::push_forward(target_, map_.verification.reference, composition.batch);
  if (pushed.effective_sample_size < 0.9) {
    // Errors of a hundred maps add up: begin again with one map of the whole posterior, which is at hand.
    by_collapsed_map(r, times);
    compose_anew();
    r.remark +=
        fmt::format("{}the composition was restarted: its effective sample size had fallen to {:.0f} %",
                    r.remark.empty() ? "" : "; ", 100 * pushed.effective_sample_size);
    return;
  }
  r.map_order = map_.order;
  r.tolerance_reached = map_.tolerance_reached;
  r.second_mode_found = map_.second_mode_found;
  r.variance_diagnostic = pushed.variance_diagnostic;
  r.effective_sample_size = pushed.effective_sample_size;
  r.log_evidence = pushed.log_evidence;
  r.log_evidence_lower_bound = pushed.log_evidence_lower_bound;
  set_from(composition.batch.value, pushed.weights,
           numerics::weighted_quantiles(composition.batch.value, pushed.weights), r);
  set_map_moments(r.points, r);
  set_map_trust(r, map_.reason);
  times.correction = microseconds_since(correction_start);
  times.map = microseconds_since(start) - times.correction;
}

void PosteriorSolver::set_from(const posterior::MapResult& map, posterior::Posterior& r) {
  map_points_.resize(map.verification.points.rows(), transform_->dimension());
  transform_->evaluate(map.verification.points, 0, map_points_, no_derivatives_, no_derivatives_);
  set_map_moments(map_points_, r);
  r.map_order = map.order;
  r.variance_diagnostic = map.verified_diagnostic;
  r.tolerance_reached = map.tolerance_reached;
  r.second_mode_found = map.second_mode_found;
}

void PosteriorSolver::set_from(const posterior::QuadraturePosterior& quadrature, posterior::Posterior& r) {
  const posterior::QuadraturePosterior::Lattice& lattice = quadrature.lattice;
  if (lattice.runs.empty()) {
    set_from(quadrature.turned_points, quadrature.weights, quadrature.quantiles, r);
  } else {  // p(z) goes axis by axis
    Eigen::MatrixXd axes(lattice.axes.rows(), lattice.axes.cols());
    transform_->evaluate(lattice.axes, 0, axes, no_derivatives_, no_derivatives_);
    r.points = lattice.points_on(axes);
    r.weights = quadrature.weights;
    r.summarise();
    r.quantiles = transform_->carry(quadrature.quantiles);
    if (target_.component_count() > 1) shares_ = target_.component_shares(lattice.runs, lattice.weights);
  }
  r.method = posterior::Method::grid;
  r.log_evidence = quadrature.log_evidence;
}

void PosteriorSolver::set_from(const Eigen::MatrixXd& z, const Eigen::VectorXd& weights,
                               const Eigen::MatrixXd& z_quantiles, posterior::Posterior& r) {
  r.points.resize(z.rows(), z.cols());
  transform_->evaluate(z, 0, r.points, no_derivatives_, no_derivatives_);
  r.weights = weights;
  r.summarise();
  r.quantiles = transform_->carry(z_quantiles);
}

}  // namespace knothe::assimilation
