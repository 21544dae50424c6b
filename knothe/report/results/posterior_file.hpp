#pragma once
/// @file posterior.nc: the sequence of posteriors as NetCDF-4 in ArviZ's groups, and its reading back for
/// forecasts.
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "knothe/assimilation/data/measurements.hpp"
#include "knothe/assimilation/update/sequential_update.hpp"
#include "knothe/reduction/model/separated_model.hpp"
#include "knothe/reduction/observe/observed_model.hpp"

namespace knothe::report {

/// What goes into the file; pointers are to one entry per step.
struct PosteriorFile {
  std::vector<std::string> parameters;
  std::string project;
  std::uint64_t seed = 1;
  std::vector<const assimilation::UpdateResult*> results;
  std::vector<std::size_t> time_indices;  ///< model time of each step, of `observed`
  /// The model at the observed dofs (its first rows) and times; null: the model's own times.
  std::shared_ptr<const reduction::ObservedModel> observed;
};

/// Groups: `posterior` (equally weighted draws, [chain, draw, step]), `posterior_predictive` (displacements
/// at the observed dofs under some of the draws, [chain, draw, step, observation]), `observed_data`,
/// `constant_data`, `sample_stats` ([step]), and `weighted_posterior` (points [step, point, parameter] and
/// weights [step, point], from which forecasts are made). Atomic; IoError.
void write_posterior_file(const std::string& path, const PosteriorFile& file,
                          const reduction::SeparatedModel& model,
                          const assimilation::Measurements& measurements);

/// Reads the weighted points of the last step, its number and time; `parameters` must be those of the file,
/// in this order. Errors: DataError.
[[nodiscard]] assimilation::UpdateResult read_last_posterior(const std::string& path,
                                                             const std::vector<std::string>& parameters);

}  // namespace knothe::report
