#include "knothe/assimilation/population/population.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "knothe/assimilation/population/population_density.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/text.hpp"
#include "knothe/base/threads.hpp"
#include "knothe/numerics/integrate/sobol.hpp"
#include "knothe/numerics/statistics/chi_squared.hpp"
#include "knothe/numerics/statistics/normal_distribution.hpp"
#include "knothe/numerics/statistics/weighted_statistics.hpp"
#include "knothe/posterior/differenced_density.hpp"
#include "knothe/posterior/solve.hpp"
#include "knothe/posterior/trust.hpp"

namespace knothe::assimilation {
namespace {

using Eigen::Index;
using posterior::Posterior;
using posterior::Prior;

constexpr Index k_draws = 8192;        ///< of a new specimen, and of each
constexpr double k_fisher_std = 0.55;  ///< of ζ: correlations of standard deviation 0.45
constexpr double k_min_probability = 0.05;

using Members = std::vector<const SpecimenLikelihood*>;

void require_shared(const std::string& name, std::span<const SharedParameter> shared) {
  std::vector<std::string> names;
  for (const SharedParameter& parameter : shared) names.push_back(parameter.name);
  if (std::find(names.begin(), names.end(), name) == names.end())
    throw UsageError(fmt::format("a prior is stated for \"{}\", but the specimens share {}{}", name,
                                 fmt::join(names, ", "), did_you_mean(name, names)));
}

void require_positive(const std::string& name, double std) {
  if (!(std > 0) || !std::isfinite(std))
    throw UsageError(fmt::format("the prior stated for \"{}\" needs a positive number, not {:g}", name, std));
}

PopulationPriors completed(PopulationPriors priors, std::span<const SharedParameter> shared) {
  for (const auto& [name, mean] : priors.mean) require_shared(name, shared), require_positive(name, mean.std);
  for (const auto& [name, scale] : priors.spread) require_shared(name, shared), require_positive(name, scale);
  for (const SharedParameter& parameter : shared) {
    priors.mean.try_emplace(parameter.name, PopulationPriors::Mean{parameter.mean, parameter.std});
    priors.spread.try_emplace(parameter.name, parameter.std);
  }
  return priors;
}

/// In standardised coordinates, as `PopulationDensity` wants them.
std::vector<Prior> standardised(const PopulationPriors& priors, std::span<const SharedParameter> shared) {
  std::vector<Prior> result;
  for (const SharedParameter& parameter : shared) {
    const PopulationPriors::Mean& mean = priors.mean.at(parameter.name);
    result.push_back(Prior::normal((mean.mean - parameter.mean) / parameter.std, mean.std / parameter.std));
  }
  for (const SharedParameter& parameter : shared)
    result.push_back(Prior::normal(0, priors.spread.at(parameter.name) / parameter.std)
                         .truncated(0, std::numeric_limits<double>::infinity(), parameter.name));
  const Index d = std::ssize(shared);
  result.insert(result.end(), d * (d - 1) / 2, Prior::normal(0, k_fisher_std));
  return result;
}

struct Solution {
  Posterior posterior;
  posterior::Trust trust;
};

/// Of one parameter by quadrature, to all digits that matter; of several by weighted draws.
Solution solve(const Members& members, const std::vector<Prior>& priors, std::uint64_t seed) {
  PopulationDensity density(members, priors);
  posterior::DifferencedDensity target(density, Eigen::VectorXd::Ones(density.dimension()));
  const posterior::ToParameters to_parameters = [&](const Eigen::MatrixXd& z) {
    return density.parameters(z);
  };
  Solution solution;
  Posterior& found = solution.posterior;
  if (density.dimension() == 2) {
    const posterior::QuadratureOptions options{
        .evidence_tolerance = 1e-9, .moment_tolerance = 1e-8, .max_nodes = 500'000};
    solution.trust = posterior::solve_by_grid(target, to_parameters, options, found);
  } else {
    posterior::RecycledImportanceOptions options;
    options.draws = 2000;
    options.max_evaluations = 200'000;
    options.seed = seed;
    const auto draws = posterior::solve_by_draws(target, to_parameters, options, found);
    solution.trust = posterior::trust_of(draws, draws.temperatures.back());
  }
  // The outermost nodes weigh nothing.
  std::vector<Index> rows;
  for (Index i = 0; i < found.weights.size(); ++i)
    if (found.weights[i] > 1e-10 * found.weights.maxCoeff()) rows.push_back(i);
  found.points = found.points(rows, Eigen::all).eval();
  found.weights = found.weights(rows).eval();
  found.weights /= found.weights.sum();
  return solution;
}

std::vector<PopulationNormal> populations_of(const Posterior& p, Index d) {
  std::vector<PopulationNormal> populations;
  for (Index i = 0; i < p.points.rows(); ++i)
    populations.push_back(population_of(p.points.row(i).transpose(), d));
  return populations;
}

/// Draws of mixtures one of which belongs to each of weighted populations: `draw(h, u, normal)` is one of the
/// h-th, of a number u in (0, 1) and d standard normal ones.
template <class Draw>
Eigen::MatrixXd draws_over(const Eigen::VectorXd& weights, Index d, std::uint64_t seed, const Draw& draw) {
  const Eigen::MatrixXd normal = numerics::sobol_normal_points(k_draws, d + 2, seed);
  std::vector<double> cumulative(weights.size());
  std::partial_sum(weights.begin(), weights.end(), cumulative.begin());
  Eigen::MatrixXd draws(k_draws, d);
  for (Index i = 0; i < k_draws; ++i) {
    const double share = numerics::normal_cdf(normal(i, 0)) * cumulative.back();
    const Index h = std::lower_bound(cumulative.begin(), cumulative.end() - 1, share) - cumulative.begin();
    const SmallVector y = normal.row(i).tail(d).transpose();
    draws.row(i) = draw(h, numerics::normal_cdf(normal(i, 1)), y).transpose();
  }
  return draws;
}

/// Of mixtures of Gaussians, each with its weight.
struct MomentSum {
  explicit MomentSum(Index d) : mean(Eigen::VectorXd::Zero(d)), square(Eigen::MatrixXd::Zero(d, d)) {}
  void add(double weight, const SmallVector& m, const SmallMatrix& factor) {
    mean += weight * m;
    square += weight * (factor * factor.transpose() + m * m.transpose());
  }
  [[nodiscard]] Eigen::MatrixXd covariance() const { return square - mean * mean.transpose(); }
  Eigen::VectorXd mean;
  Eigen::MatrixXd square;
};

/// From standardised coordinates back.
class Scale {
 public:
  explicit Scale(std::span<const SharedParameter> shared) : shared_(shared) {}

  [[nodiscard]] Eigen::VectorXd mean(Eigen::VectorXd x) const {
    for (Index k = 0; k < x.size(); ++k) x[k] = at(k).mean + at(k).std * x[k];
    return x;
  }
  [[nodiscard]] Eigen::VectorXd factors() const {
    Eigen::VectorXd s(std::ssize(shared_));
    for (Index k = 0; k < s.size(); ++k) s[k] = at(k).std;
    return s;
  }
  /// Of the parameters themselves, n × d.
  [[nodiscard]] Eigen::MatrixXd parameters(Eigen::MatrixXd x) const {
    for (Index k = 0; k < x.cols(); ++k) {
      x.col(k) = at(k).mean + at(k).std * x.col(k).array();
      if (at(k).coordinate == Coordinate::logarithm) x.col(k) = x.col(k).array().exp();
    }
    return x;
  }
  /// Means and spreads of the population.
  void apply(Posterior& p) const {
    const Index d = std::ssize(shared_);
    Eigen::VectorXd factor = Eigen::VectorXd::Ones(p.mean.size()),
                    shift = Eigen::VectorXd::Zero(p.mean.size());
    factor.head(d) = factor.segment(d, d) = factors();
    shift.head(d) = mean(Eigen::VectorXd::Zero(d));
    const auto carried = [&](const Eigen::MatrixXd& columns) -> Eigen::MatrixXd {
      return (factor.asDiagonal() * columns).colwise() + shift;
    };
    p.points = carried(p.points.transpose()).transpose();
    p.mean = carried(p.mean);
    p.quantiles = carried(p.quantiles);
    p.covariance = factor.asDiagonal() * p.covariance * factor.asDiagonal();
  }

 private:
  [[nodiscard]] const SharedParameter& at(Index k) const { return shared_[k]; }
  std::span<const SharedParameter> shared_;
};

/// Given all data: each population has its part in it, and each part its mass.
void update(const SpecimenLikelihood& likelihood, const Posterior& population,
            const std::vector<PopulationNormal>& populations, const Scale& scale, std::uint64_t seed,
            SpecimenInPopulation& specimen) {
  const Index d = likelihood.dimension();
  MomentSum moments(d);
  for (std::size_t h = 0; h < populations.size(); ++h) {
    const double all = likelihood.log_integral(populations[h]);
    for (const SpecimenLikelihood::Conditional& part : likelihood.given(populations[h]))
      moments.add(population.weights[h] * std::exp(part.log_mass - all), part.mean, part.factor);
  }
  specimen.updated_mean = scale.mean(moments.mean);
  specimen.updated_std =
      moments.covariance().diagonal().cwiseMax(0).cwiseSqrt().cwiseProduct(scale.factors());
  const Eigen::MatrixXd draws =
      draws_over(population.weights, d, seed, [&](Index h, double u, const SmallVector& y) -> SmallVector {
        const std::vector<SpecimenLikelihood::Conditional> given = likelihood.given(populations[h]);
        const double all = likelihood.log_integral(populations[h]);
        auto part = given.begin();
        for (; part + 1 != given.end() && u > std::exp(part->log_mass - all); ++part)
          u -= std::exp(part->log_mass - all);
        return part->mean + part->factor * y;
      });
  specimen.updated_quantiles = numerics::weighted_quantiles(
      scale.parameters(draws), Eigen::VectorXd::Constant(k_draws, 1.0 / k_draws));
}

/// Mean over populations of the probability of a specimen that is farther.
double probability_of(const SpecimenLikelihood& likelihood, const std::vector<PopulationNormal>& populations,
                      const Eigen::VectorXd& weights) {
  double probability = 0;
  for (std::size_t h = 0; h < populations.size(); ++h)
    probability += weights[h] * numerics::chi_squared_upper(likelihood.squared_distance(populations[h]),
                                                            likelihood.dimension());
  return std::min(1.0, probability);
}

/// What the other specimens expect of this one. Their posterior is that of all with this one's likelihood
/// taken out of the weights, or, where that leaves too few of the points, a solution of its own.
double probability_by_others(std::size_t i, const Members& members, const std::vector<Prior>& priors,
                             const Posterior& all, const std::vector<PopulationNormal>& populations,
                             std::uint64_t seed) {
  constexpr double k_enough = 0.3;  // of the effective number of points
  Eigen::VectorXd log_weights(all.weights.size());
  for (std::size_t h = 0; h < populations.size(); ++h)
    log_weights[h] = std::log(all.weights[h]) - members[i]->log_integral(populations[h]);
  const Eigen::VectorXd weights = (log_weights.array() - numerics::log_sum(log_weights)).exp();
  if (all.weights.squaredNorm() >= k_enough * weights.squaredNorm())
    return probability_of(*members[i], populations, weights);
  Members others = members;
  others.erase(others.begin() + i);
  const Posterior without = solve(others, priors, seed).posterior;
  return probability_of(*members[i], populations_of(without, members[i]->dimension()), without.weights);
}

void predict(const Posterior& population, const std::vector<PopulationNormal>& populations,
             const Scale& scale, std::uint64_t seed, PopulationResult& r) {
  const Index d = std::ssize(r.parameters);
  MomentSum moments(d);
  for (std::size_t h = 0; h < populations.size(); ++h)
    moments.add(population.weights[h], populations[h].mean, populations[h].lower);
  r.predictive_mean = scale.mean(moments.mean);
  r.predictive_covariance =
      scale.factors().asDiagonal() * moments.covariance() * scale.factors().asDiagonal();
  r.predictive = scale.parameters(draws_over(population.weights, d, seed,
                                             [&](Index h, double /*u*/, const SmallVector& y) -> SmallVector {
                                               return populations[h].mean + populations[h].lower * y;
                                             }));
  r.predictive_quantiles =
      numerics::weighted_quantiles(r.predictive, Eigen::VectorXd::Constant(k_draws, 1.0 / k_draws));
}

/// Beyond a specimen's own prior its likelihood is not known, only continued.
void warn_of_narrow_priors(std::span<const Specimen> specimens, PopulationResult& r) {
  for (const Specimen& specimen : specimens)
    for (Index k = 0; k < std::ssize(r.parameters); ++k)
      if (r.population.mean[std::ssize(r.parameters) + k] > specimen.prior_std[k])
        r.warnings.push_back(fmt::format(
            "the population of {} is wider than the prior of {}, whose data are known only within that: "
            "repeat its inference with a wider prior",
            r.parameters[k].name, specimen.name));
}

}  // namespace

PopulationResult solve_population(std::span<const Specimen> specimens,
                                  std::span<const SharedParameter> shared, const PopulationOptions& options) {
  PopulationResult r;
  r.parameters.assign(shared.begin(), shared.end());
  r.priors = completed(options.priors, shared);
  const std::vector<Prior> priors = standardised(r.priors, shared);
  Members members;
  for (const Specimen& specimen : specimens) members.push_back(&specimen.likelihood);
  const auto [found, trust] = solve(members, priors, options.seed);
  const std::vector<PopulationNormal> populations = populations_of(found, std::ssize(shared));
  const Scale scale(r.parameters);
  r.specimens.resize(specimens.size());
  parallel_for(specimens.size(), 0, [&, &found = found](std::size_t i) {
    SpecimenInPopulation& specimen = r.specimens[i];
    specimen.name = specimens[i].name, specimen.mean = specimens[i].mean, specimen.std = specimens[i].std;
    update(*members[i], found, populations, scale, options.seed, specimen);
    specimen.probability = probability_by_others(i, members, priors, found, populations, options.seed);
    specimen.belongs = specimen.probability > k_min_probability / std::ssize(specimens);
  });
  predict(found, populations, scale, options.seed, r);
  r.population = found;
  scale.apply(r.population);
  r.log_bayes_factor = found.log_evidence;
  warn_of_narrow_priors(specimens, r);
  r.verdict = posterior::in_words(trust);
  return r;
}

PopulationResult solve_population(std::span<const NamedPosterior> posteriors,
                                  const PopulationOptions& options) {
  for (std::size_t i = 0; i < posteriors.size(); ++i)
    for (std::size_t j = 0; j < i; ++j)
      if (posteriors[i].name == posteriors[j].name)
        throw UsageError(posteriors[i].name + " is given twice: its data would count twice");
  const std::vector<SharedParameter> shared = shared_parameters(posteriors);
  std::vector<Specimen> specimens;
  for (const NamedPosterior& named : posteriors) specimens.push_back(specimen_of(named, shared));
  return solve_population(specimens, shared, options);
}

}  // namespace knothe::assimilation
