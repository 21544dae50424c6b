#include "knothe/assimilation/population/specimens.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "knothe/base/error.hpp"
#include "knothe/numerics/linear/symmetric_eigen.hpp"
#include "knothe/numerics/statistics/weighted_statistics.hpp"
#include "knothe/posterior/draws/mixture_fit.hpp"

namespace knothe::assimilation {
namespace {

using Eigen::Index;
using posterior::Prior;
using posterior::PriorValues;

/// As many as it has for one that it has not.
std::size_t column_of(const NamedPosterior& named, const std::string& parameter) {
  const auto& names = named.posterior.parameters;
  return std::find(names.begin(), names.end(), parameter) - names.begin();
}

Prior::Family family_of(const NamedPosterior& named, const std::string& parameter) {
  return named.posterior.prior->families[column_of(named, parameter)];
}

/// Mean and standard deviation of a prior in a coordinate: of the logarithm of another than a lognormal one
/// to first order.
struct Width {
  double mean, std;
};
Width width_of(const NamedPosterior& named, const std::string& parameter, Coordinate coordinate) {
  const std::size_t k = column_of(named, parameter);
  const PriorValues& prior = *named.posterior.prior;
  const double mean = prior.mean[k], std = prior.std[k];
  const bool is_there = coordinate == Coordinate::own || prior.families[k] == Prior::Family::lognormal;
  if (is_there) return {mean, std};
  return mean > 0 ? Width{std::log(mean), std / mean} : Width{0, 1};
}

SharedParameter described(std::span<const NamedPosterior> posteriors, const std::string& name) {
  SharedParameter shared{name, Coordinate::own, 0, 0};
  for (const NamedPosterior& named : posteriors)
    if (family_of(named, name) == Prior::Family::lognormal) shared.coordinate = Coordinate::logarithm;
  for (const NamedPosterior& named : posteriors) {
    const Width width = width_of(named, name, shared.coordinate);
    if (width.std > shared.std) shared.mean = width.mean, shared.std = width.std;
    const Eigen::ArrayXd values = named.posterior.points.col(column_of(named, name)).array();
    const double least = (named.posterior.weights.array() > 0).select(values, values.maxCoeff()).minCoeff();
    if (shared.coordinate == Coordinate::logarithm && !(least > 0))
      throw DataError(fmt::format(
          "{}: {} is lognormal in another specimen, and here has the value {:g}, which has no logarithm",
          named.name, name, least));
  }
  return shared;
}

/// log of the prior's density in the specimens' coordinates, at each point: of the shared parameters alone.
Eigen::VectorXd log_prior_of(const NamedPosterior& named, std::span<const SharedParameter> shared) {
  const PriorValues& prior = *named.posterior.prior;
  Eigen::VectorXd sum = Eigen::VectorXd::Zero(named.posterior.weights.size());
  for (const SharedParameter& parameter : shared) {
    const std::size_t k = column_of(named, parameter.name);
    sum += prior.log_density.col(k);
    if (parameter.coordinate == Coordinate::logarithm)
      sum.array() += named.posterior.points.col(k).array().log();
  }
  if (prior.log_dependence.size() == 0) return sum;
  if (shared.size() < named.posterior.parameters.size())
    throw DataError(named.name +
                    ": its prior is the posterior of an earlier test, of more parameters than the specimens "
                    "share: give results whose priors are independent");
  return sum + prior.log_dependence;
}

/// Standardised coordinates of the points, n × d.
Eigen::MatrixXd standardised(const NamedPosterior& named, std::span<const SharedParameter> shared) {
  Eigen::MatrixXd x(named.posterior.points.rows(), std::ssize(shared));
  for (std::size_t k = 0; k < shared.size(); ++k) {
    Eigen::ArrayXd values = named.posterior.points.col(column_of(named, shared[k].name)).array();
    if (shared[k].coordinate == Coordinate::logarithm) values = values.log();
    x.col(k) = (values - shared[k].mean) / shared[k].std;
  }
  return x;
}

/// A normal prior for each shared parameter, in standardised coordinates; flat for a uniform one.
ReferencePrior reference_of(const NamedPosterior& named, std::span<const SharedParameter> shared) {
  ReferencePrior reference{
      Eigen::VectorXd::Zero(std::ssize(shared)),
      Eigen::VectorXd::Constant(std::ssize(shared), std::numeric_limits<double>::infinity())};
  for (std::size_t k = 0; k < shared.size(); ++k) {
    if (family_of(named, shared[k].name) == Prior::Family::uniform) continue;
    const Width width = width_of(named, shared[k].name, shared[k].coordinate);
    reference.mean[k] = (width.mean - shared[k].mean) / shared[k].std;
    reference.std[k] = width.std / shared[k].std;
  }
  return reference;
}

/// log of the reference's density at standardised points, in the units of the coordinates.
Eigen::VectorXd log_density(const ReferencePrior& reference, const Eigen::MatrixXd& x,
                            std::span<const SharedParameter> shared) {
  Eigen::VectorXd sum = Eigen::VectorXd::Zero(x.rows());
  for (Index k = 0; k < x.cols(); ++k) {
    const double std = reference.std[k];
    sum.array() -= std::log(shared[k].std);
    if (!std::isfinite(std)) continue;
    sum.array() -=
        0.5 * ((x.col(k).array() - reference.mean[k]) / std).square() + std::log(std) + 0.5 * k_log_two_pi;
  }
  return sum;
}

/// Weights of the points under the reference prior, and log of their sum: the posterior's mean of its ratio
/// to the prior.
double exchange_prior(const NamedPosterior& named, const Eigen::VectorXd& log_ratio,
                      Eigen::VectorXd& weights) {
  constexpr double k_min_share = 0.1;  // of the effective number of points
  const double largest = log_ratio.maxCoeff();
  Eigen::VectorXd exchanged = weights.array() * (log_ratio.array() - largest).exp();
  const double sum = exchanged.sum();
  exchanged /= sum;
  if (!(weights.squaredNorm() >= k_min_share * exchanged.squaredNorm()))
    throw DataError(fmt::format(
        "{}: its prior cannot be divided out: hardly any point of its posterior would keep a weight. Repeat "
        "its inference with a wider prior",
        named.name));
  weights = exchanged;
  return largest + std::log(sum);
}

/// Few Gaussians: an integral over a population sees no detail of a posterior, and takes as long as they are
/// many.
std::vector<posterior::MixtureComponent> mixture_of(const Eigen::MatrixXd& x, const Eigen::VectorXd& weights,
                                                    const std::string& name) {
  constexpr std::size_t k_components = 8;
  Eigen::VectorXd mean;
  Eigen::MatrixXd covariance;
  numerics::mean_and_covariance(x, weights, mean, covariance);
  const double least = numerics::SymmetricEigen(covariance).eigenvalues()[0];
  if (x.rows() < 2 || !(least > 0)) throw DataError(name + ": the points of its posterior have no spread");
  return posterior::fit_mixture(x, weights, {},
                                {.max_components = k_components,
                                 .max_iterations = 30,
                                 .min_gain = 1e-4,
                                 .min_std = 0.3 * std::sqrt(least)});
}

/// Without the points at an end of a prior's support: they have no weight, nor always a logarithm.
NamedPosterior with_weight(const NamedPosterior& named) {
  NamedPosterior kept = named;
  posterior::WeightedPosterior& p = kept.posterior;
  std::vector<Index> rows;
  for (Index i = 0; i < p.weights.size(); ++i)
    if (p.weights[i] > 0) rows.push_back(i);
  p.points = p.points(rows, Eigen::all).eval();
  p.weights = p.weights(rows).eval();
  p.prior->log_density = p.prior->log_density(rows, Eigen::all).eval();
  if (p.prior->log_dependence.size() > 0) p.prior->log_dependence = p.prior->log_dependence(rows).eval();
  return kept;
}

}  // namespace

NamedPosterior read_posterior(const std::string& path) {
  NamedPosterior named{path, posterior::read_weighted_posterior(path)};
  if (!named.posterior.prior)
    throw DataError(path +
                    ": does not hold the prior of its posterior: results of `knothe assimilate` or `knothe "
                    "infer` of this version do (not those of a model that is a density); run it again");
  return named;
}

std::vector<SharedParameter> shared_parameters(std::span<const NamedPosterior> posteriors) {
  if (posteriors.size() < 2)
    throw UsageError(
        fmt::format("a population needs the results of at least two specimens, not {}", posteriors.size()));
  std::vector<SharedParameter> shared;
  for (const std::string& name : posteriors.front().posterior.parameters)
    if (std::all_of(posteriors.begin(), posteriors.end(), [&](const auto& named) {
          return column_of(named, name) < named.posterior.parameters.size();
        }))
      shared.push_back(described(posteriors, name));
  if (shared.empty())
    throw UsageError(fmt::format("{} and the others have no parameter in common", posteriors.front().name));
  if (std::ssize(shared) > k_max_population_parameters)
    throw UsageError(fmt::format("a population takes at most {} parameters, and the specimens share {}",
                                 k_max_population_parameters, shared.size()));
  return shared;
}

Specimen specimen_of(const NamedPosterior& result, std::span<const SharedParameter> shared) {
  const NamedPosterior named = with_weight(result);
  const Eigen::MatrixXd x = standardised(named, shared);
  const ReferencePrior reference = reference_of(named, shared);
  Eigen::VectorXd mean, weights = named.posterior.weights;
  Eigen::MatrixXd covariance;
  numerics::mean_and_covariance(x, weights, mean, covariance);
  const double log_factor =
      exchange_prior(named, log_density(reference, x, shared) - log_prior_of(named, shared), weights);
  const SpecimenLikelihood likelihood(mixture_of(x, weights, named.name), reference, log_factor);
  Specimen specimen{named.name, likelihood, mean, covariance.diagonal().cwiseSqrt(), mean};
  for (std::size_t k = 0; k < shared.size(); ++k) {
    specimen.mean[k] = shared[k].mean + shared[k].std * specimen.mean[k];
    specimen.std[k] *= shared[k].std;
    specimen.prior_std[k] = width_of(named, shared[k].name, shared[k].coordinate).std;
  }
  return specimen;
}

}  // namespace knothe::assimilation
