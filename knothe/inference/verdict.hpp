#pragma once
/// @file The sentence at the end: trusted or not, and why.
#include <string>

#include "knothe/assimilation/update/prior_transform.hpp"
#include "knothe/assimilation/update/tensor_quadrature.hpp"
#include "knothe/sampling/adaptive_metropolis.hpp"
#include "knothe/sampling/recycled_importance.hpp"
#include "knothe/transport/solve/map_solver.hpp"

namespace knothe::inference {

[[nodiscard]] std::string verdict(const transport::MapResult& map,
                                  const transport::ImportanceCorrection& answer,
                                  const assimilation::PriorTransform& transform);
[[nodiscard]] std::string verdict(const assimilation::QuadraturePosterior& grid);
[[nodiscard]] std::string verdict(const sampling::MetropolisResult& chains);
[[nodiscard]] std::string verdict(const sampling::RecycledImportanceResult& draws);

}  // namespace knothe::inference
