#pragma once
/// @file Specimens of a population, each with the posterior of its own test.
#include <Eigen/Core>
#include <span>
#include <string>
#include <vector>

#include "knothe/assimilation/population/specimen_likelihood.hpp"
#include "knothe/base/enum_names.hpp"
#include "knothe/posterior/weighted_posterior_file.hpp"

namespace knothe::assimilation {

/// In which a parameter is normal over the population.
enum class Coordinate { own, logarithm };

constexpr auto names_of(Coordinate /*coordinate*/) {
  return std::to_array<Named<Coordinate>>({{Coordinate::own, "own"}, {Coordinate::logarithm, "logarithm"}});
}

/// A parameter that all specimens have.
struct SharedParameter {
  std::string name;
  Coordinate coordinate = Coordinate::own;
  double mean = 0, std = 1;  ///< of the widest of the specimens' priors, in this coordinate
};

struct Specimen {
  std::string name;
  SpecimenLikelihood likelihood;  ///< of (x − mean)/std, x the parameters in their coordinates
  Eigen::VectorXd mean, std;      ///< of its own posterior, in these coordinates
  Eigen::VectorXd prior_std;      ///< of its own prior: how far its data were asked
};

/// A result with its name in messages.
struct NamedPosterior {
  std::string name;
  posterior::WeightedPosterior posterior;
};

/// Reads a folder of results. Errors: DataError for one without the values of its prior.
[[nodiscard]] NamedPosterior read_posterior(const std::string& path);

/// The parameters of all; in the logarithm where any prior is lognormal. Errors: UsageError for fewer than
/// two results, or none shared or too many; DataError for a value that has no logarithm.
[[nodiscard]] std::vector<SharedParameter> shared_parameters(std::span<const NamedPosterior> posteriors);

/// Its posterior as a mixture of Gaussians with its prior divided out. A prior that is not normal is first
/// replaced, by weights, by a normal one of its mean and standard deviation, or, where it is uniform, left
/// out. Errors: DataError where that leaves too few points, or the prior of what is shared cannot be told
/// from that of the rest.
[[nodiscard]] Specimen specimen_of(const NamedPosterior& result, std::span<const SharedParameter> shared);

}  // namespace knothe::assimilation
