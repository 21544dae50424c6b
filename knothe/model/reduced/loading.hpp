#pragma once
/// @file What is imposed on a specimen, by which engineers name an instant of a test; else it is named by its
/// time.
#include <optional>
#include <string>
#include <vector>

#include "knothe/model/reduced/separated_model.hpp"

namespace knothe::model {

struct Loading {
  std::string name, units;
  std::vector<double> times,
      values;                   ///< of the model's steps; no values where nothing is known to be imposed
  std::string time_units = {};  ///< empty where the solver states none

  /// At a model time within `times`; nothing where the values do not rise throughout.
  [[nodiscard]] std::optional<double> at(double time) const;
};

/// The output `clock` of a model, its imposed displacement where that is empty, at the parameters nearest to
/// `p` in the model's box; without values where the model does not have it.
[[nodiscard]] Loading loading_of(const SeparatedModel& model, const std::string& clock,
                                 std::vector<double> p);

/// Units of an output; empty where the model does not have it.
[[nodiscard]] inline std::string output_units(const ModelContents& model, const std::string& name) {
  for (const SnapshotOutput& output : model.outputs)
    if (output.name == name) return output.labels.units;
  return "";
}

}  // namespace knothe::model
