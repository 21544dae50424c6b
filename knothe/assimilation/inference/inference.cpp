#include "knothe/assimilation/inference/inference.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <numeric>

#include "knothe/assimilation/inference/finite_integral.hpp"
#include "knothe/assimilation/inference/sampled_inference.hpp"
#include "knothe/assimilation/inference/verdict.hpp"
#include "knothe/assimilation/update/maximum_a_posteriori.hpp"
#include "knothe/base/error.hpp"
#include "knothe/numerics/integrate/sobol.hpp"
#include "knothe/numerics/statistics/chi_squared.hpp"
#include "knothe/numerics/statistics/distinct_draws.hpp"
#include "knothe/numerics/statistics/weighted_statistics.hpp"
#include "knothe/posterior/draws/outward_walks.hpp"
#include "knothe/posterior/mode_search.hpp"
#include "knothe/posterior/solve.hpp"

namespace knothe::assimilation {
namespace {

using Clock = std::chrono::steady_clock;

/// Times what is done between its construction and its end as one phase.
class Phase {
 public:
  Phase(std::string name, const ModelEvaluator& evaluator, InferenceResult& result)
      : name_(std::move(name)), evaluator_(evaluator), result_(result), model_before_(evaluator.seconds()) {}
  ~Phase() {
    result_.phases.push_back({name_, std::chrono::duration<double>(Clock::now() - start_).count(),
                              evaluator_.seconds() - model_before_});
  }
  Phase(const Phase&) = delete;
  Phase& operator=(const Phase&) = delete;

 private:
  std::string name_;
  const ModelEvaluator& evaluator_;
  InferenceResult& result_;
  double model_before_;
  Clock::time_point start_ = Clock::now();
};

posterior::ToParameters in_parameters(const PosteriorDensity& posterior) {
  return [&](const Eigen::MatrixXd& z) { return posterior.parameters(z); };
}

/// As long as one lives, `spent` must not come above this budget, and no call is made after this moment.
class Limit {
 public:
  Limit(ModelEvaluator& evaluator, std::int64_t budget, double deadline)
      : evaluator_(evaluator), budget_(evaluator.budget()), deadline_(evaluator.deadline) {
    evaluator_.set_budget(std::min(budget_, budget));
    evaluator_.deadline = std::min(deadline_, deadline);
  }
  ~Limit() {
    evaluator_.set_budget(budget_);
    evaluator_.deadline = deadline_;
  }
  Limit(const Limit&) = delete;
  Limit& operator=(const Limit&) = delete;

 private:
  ModelEvaluator& evaluator_;
  std::int64_t budget_;
  double deadline_;
};

/// This share of the calls and of the time that are left now; no limit of none.
Limit limit_to_share(ModelEvaluator& evaluator, double share) {
  std::int64_t budget = evaluator.budget();
  if (budget != ModelEvaluator::k_no_budget)
    budget = evaluator.spent() + std::llround(share * (budget - evaluator.spent()));
  return {evaluator, budget, evaluator.now() + share * (evaluator.deadline - evaluator.now())};
}

std::int64_t budget_of(const InferenceOptions& options, const InferenceResult& r,
                       const ModelEvaluator& evaluator) {
  constexpr std::int64_t k_default = 20'000, k_of_map = 100'000;
  if (options.evaluations > 0) return options.evaluations;
  if (r.method == Method::transport && !evaluator.model().is_cheap()) return k_of_map;
  const bool is_by_draws = r.method == Method::sequential_monte_carlo;
  if (!is_by_draws || evaluator.model().is_cheap()) return ModelEvaluator::k_no_budget;
  return std::max<std::int64_t>(k_default, 2 * options.samples);
}

/// A map says nothing of what its points never reach: the end of a funnel. And moments of a tail that it has
/// right may be infinite.
void look_beyond(PosteriorDensity& posterior, const posterior::MapResult& map, std::uint64_t seed,
                 posterior::ImportanceCorrection& correction) {
  // Less than this, as at a hard end of a prior, is what weights are for; and an end near the mean has little
  // mass.
  constexpr double k_hardly_any = 30;  // times as much mass as the map has there
  constexpr double k_far = 3;          // standard deviations
  // Where the map is right, one of its few points may move a moment by all that is tolerated, not a third.
  constexpr double k_tolerated = 3;
  constexpr Eigen::Index k_draws = 20'000;
  if (!correction.trust.trusted) return;
  const Eigen::MatrixXd draws =
      posterior.parameters(map.evaluate(numerics::sobol_normal_points(k_draws, posterior.dimension(), seed)));
  correction.trust.reason = posterior::heavy_tail_in_words(
      posterior::tail_shape_of(draws, Eigen::VectorXd::Constant(k_draws, 1.0 / k_draws)));
  correction.trust.trusted = correction.trust.reason.empty();
  if (!correction.trust.trusted) return;
  posterior::CheckedDensity target(posterior);
  const posterior::CheckedDensity::Leniency lenient(target);
  const Eigen::MatrixXd variables = posterior.parameters(correction.points);
  const double log_n = std::log(correction.weights.size());
  const Eigen::RowVectorXd mean = correction.weights.transpose() * variables;
  const Eigen::Array<double, 1, Eigen::Dynamic> deviation =
      (correction.weights.transpose() * (variables.rowwise() - mean).cwiseAbs2()).array().sqrt();
  const posterior::MassBeyond beyond = posterior::walk_outwards(
      target,
      {correction.points, variables, correction.weights,
       [&](const Eigen::MatrixXd& z, const Eigen::VectorXd& log_density) -> Eigen::VectorXd {
         const Eigen::ArrayXd ratio = (log_density - map.log_density(z)).array() - correction.log_evidence;
         const Eigen::ArrayXXd distance =
             (posterior.parameters(z).rowwise() - mean).array().abs().rowwise() / deviation;
         const auto is_missing = ratio > std::log(k_hardly_any) && distance.rowwise().maxCoeff() > k_far;
         return is_missing.select(ratio, ratio.min(0.0) - std::log(k_tolerated)) - log_n;
       },
       in_parameters(posterior)},
      {.seed = seed});
  correction.trust.trusted = !beyond.found();
  if (beyond.found())
    correction.trust.reason =
        "walks from the outermost points find mass that hardly any point of the map stands for";
}

void solve_by_map(PosteriorDensity& posterior, ModelEvaluator& evaluator,
                  const posterior::MapSolverOptions& map_options, MapDetails& details,
                  posterior::ImportanceCorrection& correction, InferenceResult& r) {
  posterior::MapSolver solver(map_options);
  {
    const Phase phase("mode search and map", evaluator, r);
    details.map = solver.solve(posterior);
  }
  const Phase phase("importance correction", evaluator, r);
  correction = solver.correct(posterior, details.map);
  look_beyond(posterior, details.map, map_options.seed, correction);
}

void by_transport(PosteriorDensity& posterior, ModelEvaluator& evaluator, const InferenceOptions& options,
                  InferenceResult& r) {
  // z is standardised by the priors: that is where other modes can be.
  posterior::MapSolverOptions map_options = options.map;
  if (!(map_options.tempering_spread > 0)) map_options.tempering_spread = 3;
  MapDetails details;
  posterior::ImportanceCorrection correction;
  try {
    solve_by_map(posterior, evaluator, map_options, details, correction, r);
  } catch (const BudgetSpent&) {
    // The calls made are known: the same way again, less far, asks for few more.
    map_options.search_modes = std::min(map_options.search_modes, posterior::ModeSearchLevel::multi_start);
    map_options.fallback = map_options.long_first_variable = false;
    map_options.max_points = 4 * map_options.verification_points;
    solve_by_map(posterior, evaluator, map_options, details, correction, r);
    r.budget_spent = true;
  }
  posterior::set_from_map(details.map, correction, in_parameters(posterior), r);
  r.verdict = verdict(details.map, correction, posterior.transform());
  const Phase phase("draws of the map", evaluator, r);
  details.pulled_back = details.map.verification.reference;
  const Eigen::VectorXd& log_weight = details.map.verification.log_weight;
  details.weights = (log_weight.array() - log_weight.maxCoeff()).exp();
  details.weights /= details.weights.sum();
  details.draws_of_map = posterior.parameters(details.map.evaluate(
      numerics::sobol_normal_points(2000, posterior.dimension(), options.seed + 0x6d6170)));
  r.map.push_back(std::move(details));
}

void by_grid(PosteriorDensity& posterior, ModelEvaluator& evaluator, InferenceResult& r) {
  const Phase phase("grid", evaluator, r);
  // A model may take seconds a point: 150,000 nodes are all that it is asked for.
  static constexpr Eigen::Index k_nodes[] = {257, 65, 25, 0};  // more dimensions are refused
  static constexpr Eigen::Index k_max_nodes = 150'000;
  const Eigen::Index d = posterior.dimension(), nodes = k_nodes[std::min<Eigen::Index>(d - 1, 3)];
  const std::int64_t left = evaluator.budget() - evaluator.spent();
  const Eigen::Index affordable = std::floor(std::pow(0.5 * left, 1.0 / d));
  const posterior::Trust trust = posterior::solve_by_grid(
      posterior, in_parameters(posterior),
      {.axes = posterior::QuadratureOptions::Axes::modes,
       .coarse_nodes = std::min(nodes, std::max<Eigen::Index>(9, affordable - (affordable + 1) % 2)),
       .max_nodes = std::min<std::int64_t>(k_max_nodes, left)},
      r);
  r.budget_spent = !trust.trusted && left < k_max_nodes;
  r.verdict = in_words(trust);
}

/// Skewness and kurtosis with the map as a control variate: E_π f = E_ρ f∘T + Σ (w_i − 1/n) f(T(x_i)). The
/// first term costs no evaluation of the model and is taken on many points; the second is small if the map is
/// good, and so is its error. Only where the weights belong to the verification points themselves.
void sharpen_higher_moments(const PosteriorDensity& posterior, const InferenceOptions& options,
                            InferenceResult& r) {
  constexpr Eigen::Index k_free_points = 32768;
  const posterior::MapResult& map = r.map.front().map;
  const Eigen::Index n = r.points.rows();
  if (map.verification.points.rows() != n) return;
  const Eigen::MatrixXd free = posterior.parameters(map.evaluate(
      numerics::sobol_normal_points(k_free_points, posterior.dimension(), options.seed + 0x6d6f6d)));
  const Eigen::ArrayXd change = r.weights.array() - 1.0 / n;
  for (Eigen::Index k = 0; k < free.cols(); ++k) {
    const double unit = std::sqrt(std::max(r.covariance(k, k), 1e-300));
    const Eigen::ArrayXd x = (free.col(k).array() - r.mean[k]) / unit,
                         y = (r.points.col(k).array() - r.mean[k]) / unit;
    double m[5];  // moments about the mean of the weights, made central below
    for (int power = 1; power <= 4; ++power) m[power] = x.pow(power).mean() + (change * y.pow(power)).sum();
    const double variance = m[2] - m[1] * m[1];
    const double third = m[3] - 3 * m[1] * m[2] + 2 * m[1] * m[1] * m[1];
    const double fourth = m[4] - 4 * m[1] * m[3] + 6 * m[1] * m[1] * m[2] - 3 * m[1] * m[1] * m[1] * m[1];
    if (!(variance > 0.5) || !std::isfinite(variance + third + fourth)) continue;
    r.skewness[k] = third / std::pow(variance, 1.5);
    r.kurtosis[k] = fourth / (variance * variance);
  }
}

/// The best of all points.
Eigen::VectorXd best_point(PosteriorDensity& posterior, const InferenceResult& r) {
  if (!r.map.empty()) return posterior.parameters(r.map[0].map.mode.transpose()).row(0).transpose();
  Eigen::Index best = 0;
  posterior::LogDensityBatch batch;
  posterior.log_likelihood(r.points, 0, batch);
  posterior.transform().add_log_density(r.points, 0, batch);
  batch.value.maxCoeff(&best);
  return r.points.row(best).transpose();
}

/// From the best point, in p: where the maximum is at an end of a prior's support, z knows no such place.
Eigen::VectorXd most_probable(PosteriorDensity& posterior, const ModelEvaluator& evaluator,
                              const Eigen::VectorXd& start) {
  return maximum_a_posteriori(
      [&](const auto& p, int derivatives, auto& out) { posterior.log_likelihood(p, derivatives, out); },
      posterior.transform(), start, evaluator.has_hessian() ? 1e-12 : 1e-7);
}

/// An extra that fails is left out: the answer stays.
template <class Function>
void try_extra(const char* what, InferenceResult& r, const Function& function) {
  try {
    function();
  } catch (const Interrupted&) {
    throw;
  } catch (const BudgetSpent&) {
    r.warnings.push_back(fmt::format("{} ended with the budget", what));
  } catch (const Error& error) {
    r.warnings.push_back(fmt::format("{} failed: {}", what, error.what()));
  }
}

void add_higher_moments(const PosteriorDensity& posterior, const InferenceOptions& options,
                        InferenceResult& r) {
  const numerics::Moments moments = numerics::moments_of(r.points, r.weights);
  r.skewness = moments.skewness;
  r.kurtosis = moments.kurtosis;
  if (!r.map.empty()) sharpen_higher_moments(posterior, options, r);
}

/// Whether the observations fit at all, and whether the posterior is pressed against an end of a prior.
void examine_answer(PosteriorDensity& posterior, const std::vector<std::string>& names, InferenceResult& r) {
  r.edge_mass = Eigen::VectorXd::Zero(r.points.cols());
  for (Eigen::Index k = 0; k < r.points.cols(); ++k) {
    const double lower = posterior.transform().prior(k).lower(),
                 upper = posterior.transform().prior(k).upper();
    if (!std::isfinite(upper - lower)) continue;
    const double outer = 0.02 * (upper - lower);
    const auto share = [&](const auto& inside) {
      return r.weights.dot(inside.template cast<double>().matrix());
    };
    const double low = share(r.points.col(k).array() < lower + outer),
                 high = share(r.points.col(k).array() > upper - outer);
    r.edge_mass[k] = std::max(low, high);
    const double end = low > high ? lower : upper;
    if (r.edge_mass[k] > 0.5 && std::abs(r.mean[k] - end) < 3 * std::sqrt(r.covariance(k, k)))
      r.doubts.push_back(
          pressed(k < std::ssize(names) ? names[k] : fmt::format("parameter {}", k), r.edge_mass[k], end));
  }
  const auto misfit = posterior.misfit(r.maximum_a_posteriori);
  if (!misfit) return;
  r.predicted = misfit->predicted;
  r.fit_probability = numerics::chi_squared_upper(std::max(0.0, misfit->chi_squared), r.predicted.size());
  if (*r.fit_probability < 3e-5) r.doubts.push_back(does_not_fit(misfit->chi_squared, r.predicted.size()));
}

/// `samples` that weigh the same, of the weighted points.
Eigen::MatrixXd draws_of(const InferenceResult& r, const posterior::PriorTransform& transform,
                         Eigen::Index samples) {
  Eigen::VectorXd lower(r.points.cols()), upper(r.points.cols());
  for (Eigen::Index k = 0; k < r.points.cols(); ++k) {
    lower[k] = transform.prior(k).lower();
    upper[k] = transform.prior(k).upper();
  }
  return numerics::distinct_draws(r.points, r.weights, samples, lower, upper);
}

Eigen::Index distinct_rows(const Eigen::MatrixXd& m) {
  std::vector<Eigen::Index> order(m.rows());
  std::iota(order.begin(), order.end(), Eigen::Index{0});
  std::sort(order.begin(), order.end(), [&](Eigen::Index a, Eigen::Index b) {
    return std::lexicographical_compare(m.row(a).begin(), m.row(a).end(), m.row(b).begin(), m.row(b).end());
  });
  const auto end = std::unique(order.begin(), order.end(),
                               [&](Eigen::Index a, Eigen::Index b) { return m.row(a) == m.row(b); });
  return end - order.begin();
}

}  // namespace

posterior::Method method_from(const std::string& text) {
  const std::optional<posterior::Method> method = from_text<posterior::Method>(text);
  if (method && is_one_shot(*method)) return *method;
  throw UsageError(fmt::format(
      "\"{}\" is not a method of inference: there are auto, transport, mcmc, smc and grid", text));
}

double InferenceResult::seconds() const {
  double sum = 0;
  for (const PhaseTime& phase : phases) sum += phase.seconds;
  return sum;
}

namespace {

void solve(PosteriorDensity& posterior, ModelEvaluator& evaluator, const InferenceOptions& options,
           const std::vector<posterior::Mode>& modes, InferenceResult& r) {
  switch (r.method) {
    case Method::transport:
      return by_transport(posterior, evaluator, options, r);
    case Method::grid:
      return by_grid(posterior, evaluator, r);
    case Method::markov_chain: {
      const Phase phase("Markov chains", evaluator, r);
      return by_markov_chains(posterior, evaluator, options, r);
    }
    case Method::sequential_monte_carlo: {
      const Phase phase("weighted draws", evaluator, r);
      return by_weighted_draws(posterior, evaluator, options, modes, r);
    }
    default:
      throw UsageError(
          fmt::format("\"{}\" needs sequential data: use `knothe assimilate`", to_text(r.method)));
  }
}

/// By weighted draws where the method asked for comes to nothing.
void solve_somehow(PosteriorDensity& posterior, ModelEvaluator& evaluator, const InferenceOptions& options,
                   const std::vector<posterior::Mode>& modes, InferenceResult& r) {
  const Method asked = r.method;
  if (asked == Method::sequential_monte_carlo) return solve(posterior, evaluator, options, modes, r);
  try {
    // What is left is for the draws, should there be no answer.
    constexpr double k_share = 0.8;
    const Limit limit = limit_to_share(evaluator, k_share);
    return solve(posterior, evaluator, options, modes, r);
  } catch (const NumericalError& error) {
    InferenceResult by_draws;
    by_draws.phases = std::move(r.phases);
    r = std::move(by_draws);
    r.method = Method::sequential_monte_carlo;
    InferenceOptions others = options;  // draws of their own, should `smc` be what this is compared with
    ++others.seed;
    solve(posterior, evaluator, others, modes, r);
    const std::string why = fmt::format("method {} gave no answer ({}), and weighted draws were made",
                                        to_text(asked), error.what());
    r.remark = r.remark.empty() ? why : why + "; " + r.remark;
    r.verdict += fmt::format(" Beforehand {}.", why);
  }
}

/// Of a density given by its logarithm, which is looked at before it is solved: whether it has an integral,
/// and where its modes are; for a tenth of the budget at most: where that does not tell, the draws will.
std::vector<posterior::Mode> modes_of_integrable(PosteriorDensity& posterior, ModelEvaluator& evaluator,
                                                 const InferenceOptions& options) {
  const Limit limit = limit_to_share(evaluator, 0.1);
  std::vector<posterior::Mode> modes;
  try {
    posterior::CheckedDensity target(posterior);
    const posterior::CheckedDensity::Leniency lenient(target);
    posterior::ModeSearch().run(target, true, modes);
    require_finite_integral(posterior, modes.front(), options.names);
  } catch (const BudgetSpent&) {
  }
  return modes;
}

}  // namespace

InferenceResult infer(PosteriorDensity& posterior, ModelEvaluator& evaluator,
                      const InferenceOptions& options) {
  InferenceResult r;
  r.method = one_shot(options.method, posterior.dimension(), evaluator.model().is_cheap());
  const Limit limit(evaluator, budget_of(options, r, evaluator),
                    options.seconds > 0 ? evaluator.now() + options.seconds : ModelEvaluator::k_no_deadline);
  std::vector<posterior::Mode> modes;
  if (posterior.is_density()) modes = modes_of_integrable(posterior, evaluator, options);
  solve_somehow(posterior, evaluator, options, modes, r);
  add_higher_moments(posterior, options, r);
  {
    const Phase phase("most probable point", evaluator, r);
    try_extra("the search for the most probable point", r, [&] {
      r.maximum_a_posteriori = best_point(posterior, r);
      r.maximum_a_posteriori = most_probable(posterior, evaluator, r.maximum_a_posteriori);
    });
    if (r.maximum_a_posteriori.size() == 0) r.maximum_a_posteriori = r.mean;
  }
  try_extra("the look at the fit", r, [&] { examine_answer(posterior, options.names, r); });
  if (r.budget_spent)
    r.verdict += evaluator.is_out_of_time()
                     ? fmt::format(" The time of {} s is over: seconds = {} goes on from here.",
                                   options.seconds, 2 * options.seconds)
                     : fmt::format(" The budget of {} calls is spent: evaluations = {} goes on from here.",
                                   evaluator.budget(), 2 * evaluator.budget());
  r.computation = r.verdict;
  for (const std::string& doubt : r.doubts) r.verdict += " But " + doubt;
  if (r.draws.size() == 0 && options.makes_draws) {
    const Phase phase("draws", evaluator, r);
    r.draws = draws_of(r, posterior.transform(), options.samples);
  }
  r.distinct_draws = r.draws.size() > 0 ? distinct_rows(r.draws) : options.samples;
  r.calls = evaluator.model().calls();
  return r;
}

}  // namespace knothe::assimilation
