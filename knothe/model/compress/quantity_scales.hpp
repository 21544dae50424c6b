#pragma once
/// @file Quantities of several units (Snapshots::quantities) before and after separation.
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "knothe/model/compress/compression.hpp"
#include "knothe/model/reduced/separated_model.hpp"

namespace knothe::model {

/// What each quantity is divided by, so that a norm over all of them means something: the root mean square,
/// over grid and times, of how it varies with the parameters; of its values, where it does not vary.
class QuantityScales {
 public:
  explicit QuantityScales(const Snapshots& snapshots);
  /// The same, of what a model says at the nodes of its grid; ones for a model whose dofs have places.
  explicit QuantityScales(const SeparatedModel& model);
  [[nodiscard]] Snapshots scaled(Snapshots snapshots) const;
  [[nodiscard]] std::vector<OffGridSolution> scaled(std::span<const OffGridSolution> solutions) const;
  [[nodiscard]] ModelContents scaled(ModelContents model) const;
  /// A model of scaled snapshots becomes one of the quantities themselves; its errors stay relative to the
  /// scales.
  void restore(ModelContents& model) const;
  /// Rows of n_dof values each, in the quantities' own units again.
  void restore(std::vector<double>& rows) const;

 private:
  std::vector<double> scales_;  ///< [n_dof]
};

/// `off_grid_error`, of quantities relative to their scales in the snapshots that the model is made of, as
/// `max_error_m` is.
[[nodiscard]] ModelError off_grid_error_in_scales(const Snapshots& snapshots, const ModelContents& model,
                                                  std::size_t count,
                                                  const std::function<OffGridSolution(std::size_t)>& solution,
                                                  std::size_t threads = 0);

/// "at most 0.12 µm on any dof", or in terms of the quantities' scales. `error`: in m, or relative to them.
[[nodiscard]] std::string largest_error(double error, const std::vector<Quantity>& quantities);

}  // namespace knothe::model
