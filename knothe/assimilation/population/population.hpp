#pragma once
/// @file Several specimens as draws from one population: its mean and spread, each specimen in the light of
/// the others, and what to expect of the next.
#include <Eigen/Core>
#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "knothe/assimilation/population/specimens.hpp"
#include "knothe/posterior/posterior.hpp"

namespace knothe::assimilation {

/// Priors of the population, in the parameters' coordinates. Those that are not stated are the widest of the
/// specimens' own: the mean is distributed like it, and the spread is half normal with its standard
/// deviation.
struct PopulationPriors {
  struct Mean {
    double mean, std;
  };
  std::map<std::string, Mean> mean;
  std::map<std::string, double> spread;  ///< scale of the half-normal prior
};

struct PopulationOptions {
  PopulationPriors priors;
  std::uint64_t seed = 1;
};

/// A specimen and what the others say of it.
struct SpecimenInPopulation {
  std::string name;
  Eigen::VectorXd mean, std;                  ///< d, coordinates, of its own posterior
  Eigen::VectorXd updated_mean, updated_std;  ///< d, coordinates, of its posterior by all specimens
  Eigen::MatrixXd updated_quantiles;          ///< d × levels, of the parameters themselves
  /// Of a specimen of the population that the others are of, to be as far from them as this one.
  double probability = 1;
  bool belongs = true;  ///< `probability` is above 0.05 over the number of specimens
};

struct PopulationResult {
  std::vector<SharedParameter> parameters;  ///< d
  PopulationPriors priors;                  ///< complete
  /// Means (d), spreads (d) in the coordinates, correlations by rows of the lower triangle.
  posterior::Posterior population;
  std::vector<SpecimenInPopulation> specimens;
  Eigen::MatrixXd predictive;       ///< n × d: draws of the parameters of a new specimen, of equal weight
  Eigen::VectorXd predictive_mean;  ///< d, coordinates
  Eigen::MatrixXd predictive_covariance;  ///< d × d
  Eigen::MatrixXd predictive_quantiles;   ///< d × levels, of the parameters themselves
  /// log of p(all data | one population) / Π p(data of a specimen | its own prior).
  double log_bayes_factor = 0;
  std::vector<std::string> warnings;
  std::string verdict;  ///< trusted or not, and why
};

/// Errors: UsageError for a stated prior of a parameter that the specimens do not share, or a standard
/// deviation that is not positive.
[[nodiscard]] PopulationResult solve_population(std::span<const Specimen> specimens,
                                                std::span<const SharedParameter> shared,
                                                const PopulationOptions& options = {});
/// Of results: `shared_parameters`, `specimen_of` each, and this.
[[nodiscard]] PopulationResult solve_population(std::span<const NamedPosterior> posteriors,
                                                const PopulationOptions& options = {});

}  // namespace knothe::assimilation
