#pragma once
/// @file The priors of a model's parameters, on the box on which the model exists.
#include <memory>
#include <vector>

#include "knothe/assimilation/update/prior_transform.hpp"
#include "knothe/reduction/observe/observed_model.hpp"

namespace knothe::assimilation {

/// Each prior truncated to the model's box and renormalised there (docs/formats.md), in the order of
/// the model's parameters. As many priors as parameters; errors of Prior::truncated, which name the
/// parameter.
[[nodiscard]] std::shared_ptr<const PriorTransform> truncated_to_box(const reduction::ObservedModel& model,
                                                                     std::vector<Prior> priors);

/// The priors' medians, d: a point in the middle of what is believed.
[[nodiscard]] Eigen::VectorXd medians(const PriorTransform& transform);

}  // namespace knothe::assimilation
