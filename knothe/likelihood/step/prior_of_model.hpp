#pragma once
/// @file The priors of a model's parameters, on the box on which the model exists.
#include <memory>
#include <span>
#include <vector>

#include "knothe/model/compress/snapshots.hpp"
#include "knothe/model/observe/observed_model.hpp"
#include "knothe/posterior/prior/prior_transform.hpp"

namespace knothe::likelihood {

/// Each prior truncated to the model's box and renormalised there (docs/reference/formats.md), in the order
/// of the model's parameters: on the first axes of a model's file, or on the box of an observed model (as
/// many priors as it has parameters). Errors of Prior::truncated, which name the parameter.
[[nodiscard]] std::vector<posterior::Prior> truncated_to_box(std::span<const model::Axis> axes,
                                                             std::vector<posterior::Prior> priors);
[[nodiscard]] std::shared_ptr<const posterior::PriorTransform> truncated_to_box(
    const model::ObservedModel& model, std::vector<posterior::Prior> priors);

/// The priors' medians, d: a point in the middle of the prior.
[[nodiscard]] Eigen::VectorXd medians(const posterior::PriorTransform& transform);

}  // namespace knothe::likelihood
