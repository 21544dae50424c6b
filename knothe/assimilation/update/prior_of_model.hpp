#pragma once
/// @file The priors of a model's parameters, on the box on which the model exists.
#include <memory>
#include <span>
#include <vector>

#include "knothe/assimilation/update/prior_transform.hpp"
#include "knothe/reduction/compress/snapshots.hpp"
#include "knothe/reduction/observe/observed_model.hpp"

namespace knothe::assimilation {

/// Each prior truncated to the model's box and renormalised there (docs/reference/formats.md), in the order
/// of the model's parameters: on the first axes of a model's file, or on the box of an observed model (as
/// many priors as it has parameters). Errors of Prior::truncated, which name the parameter.
[[nodiscard]] std::vector<Prior> truncated_to_box(std::span<const reduction::Axis> axes,
                                                  std::vector<Prior> priors);
[[nodiscard]] std::shared_ptr<const PriorTransform> truncated_to_box(const reduction::ObservedModel& model,
                                                                     std::vector<Prior> priors);

/// The priors' medians, d: a point in the middle of the prior.
[[nodiscard]] Eigen::VectorXd medians(const PriorTransform& transform);

}  // namespace knothe::assimilation
