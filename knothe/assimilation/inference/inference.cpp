#include "knothe/assimilation/inference/inference.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
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

void by_transport(PosteriorDensity& posterior, ModelEvaluator& evaluator, const InferenceOptions& options,
                  InferenceResult& r) {
  // z is standardised by the priors: that is where other modes can be.
  posterior::MapSolverOptions map_options = options.map;
  if (!(map_options.tempering_spread > 0)) map_options.tempering_spread = 3;
  posterior::MapSolver solver(map_options);
  MapDetails details;
  posterior::ImportanceCorrection correction;
  {
    const Phase phase("mode search and map", evaluator, r);
    details.map = solver.solve(posterior);
  }
  {
    const Phase phase("importance correction", evaluator, r);
    correction = solver.correct(posterior, details.map);
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
  r.verdict = in_words(
      posterior::solve_by_grid(posterior, in_parameters(posterior),
                               {.axes = posterior::QuadratureOptions::Axes::modes,
                                .coarse_nodes = k_nodes[std::min<Eigen::Index>(posterior.dimension() - 1, 3)],
                                .max_nodes = 150'000},
                               r));
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
    if (!(variance > 0.5)) continue;
    const double third = m[3] - 3 * m[1] * m[2] + 2 * m[1] * m[1] * m[1];
    const double fourth = m[4] - 4 * m[1] * m[3] + 6 * m[1] * m[1] * m[2] - 3 * m[1] * m[1] * m[1] * m[1];
    r.skewness[k] = third / std::pow(variance, 1.5);
    r.kurtosis[k] = fourth / (variance * variance);
  }
}

/// From the best point, in p: where the maximum is at an end of a prior's support, z knows no such place.
Eigen::VectorXd most_probable(PosteriorDensity& posterior, const ModelEvaluator& evaluator,
                              const InferenceResult& r) {
  Eigen::Index best = 0;
  if (!r.map.empty()) {
    const Eigen::MatrixXd start = posterior.parameters(r.map[0].map.mode.transpose());
    return maximum_a_posteriori(
        [&](const auto& p, int derivatives, auto& out) { posterior.log_likelihood(p, derivatives, out); },
        posterior.transform(), start.row(0).transpose(), evaluator.has_hessian() ? 1e-12 : 1e-7);
  }
  posterior::LogDensityBatch batch;
  posterior.log_likelihood(r.points, 0, batch);
  for (Eigen::Index i = 0; i < r.points.rows(); ++i) {
    for (Eigen::Index k = 0; k < r.points.cols(); ++k)
      batch.value[i] += posterior.transform().prior(k).log_density(r.points(i, k));
    if (batch.value[i] > batch.value[best]) best = i;
  }
  return maximum_a_posteriori(
      [&](const auto& p, int derivatives, auto& out) { posterior.log_likelihood(p, derivatives, out); },
      posterior.transform(), r.points.row(best).transpose(), evaluator.has_hessian() ? 1e-12 : 1e-7);
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
      r.verdict +=
          pressed(k < std::ssize(names) ? names[k] : fmt::format("parameter {}", k), r.edge_mass[k], end);
  }
  const auto misfit = posterior.misfit(r.maximum_a_posteriori);
  if (!misfit) return;
  r.fit_probability = numerics::chi_squared_upper(std::max(0.0, misfit->chi_squared), misfit->count);
  if (*r.fit_probability < 3e-5) r.verdict += does_not_fit(misfit->chi_squared, misfit->count);
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

InferenceResult infer(PosteriorDensity& posterior, ModelEvaluator& evaluator,
                      const InferenceOptions& options) {
  InferenceResult r;
  r.method = one_shot(options.method, posterior.dimension(), evaluator.model().is_cheap());
  if (posterior.is_density()) require_finite_integral(posterior, options.names);
  switch (r.method) {
    case posterior::Method::transport:
      by_transport(posterior, evaluator, options, r);
      break;
    case posterior::Method::grid:
      by_grid(posterior, evaluator, r);
      break;
    case posterior::Method::markov_chain: {
      const Phase phase("Markov chains", evaluator, r);
      by_markov_chains(posterior, options, r);
      break;
    }
    case posterior::Method::sequential_monte_carlo: {
      const Phase phase("weighted draws", evaluator, r);
      by_weighted_draws(posterior, evaluator.model(), options, r);
      break;
    }
    default:
      throw UsageError(
          fmt::format("\"{}\" needs sequential data: use `knothe assimilate`", to_text(r.method)));
  }
  const numerics::Moments moments = numerics::moments_of(r.points, r.weights);
  r.skewness = moments.skewness;
  r.kurtosis = moments.kurtosis;
  if (!r.map.empty()) sharpen_higher_moments(posterior, options, r);
  {
    const Phase phase("most probable point", evaluator, r);
    r.maximum_a_posteriori = most_probable(posterior, evaluator, r);
  }
  examine_answer(posterior, options.names, r);
  if (r.draws.size() == 0) {
    const Phase phase("draws", evaluator, r);
    r.draws = draws_of(r, posterior.transform(), options.samples);
  }
  r.distinct_draws = distinct_rows(r.draws);
  r.calls = evaluator.model().calls();
  return r;
}

}  // namespace knothe::assimilation
