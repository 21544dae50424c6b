#pragma once
/// @file What is wrong with data that do not fit: each of the usual mistakes is tried on them, with the
/// parameters fitted again.
#include <Eigen/Core>
#include <memory>
#include <span>
#include <string>

#include "knothe/assimilation/verdict/residual_tests.hpp"
#include "knothe/assimilation/verdict/verdict.hpp"
#include "knothe/posterior/prior/prior_transform.hpp"

namespace knothe::assimilation {

struct Diagnosis {
  MisfitCause cause = MisfitCause::unknown;
  std::string message;  ///< what the data look like, and what to check
  double factor = 1;    ///< of a noise level: true over stated standard deviation
};

/// Of data whose residuals fail `report` (made at the posterior mean `p`, d). Tried are, in this order:
/// values at the end of the sensors' range, single sensors or values, steps in succession, and those of
/// `WhatIfCauses`. Named is the one that explains the data, or else a level of the noise if the residuals are
/// white, or else what takes nearly all of the misfit away. Some fifteen least-squares fits: milliseconds.
[[nodiscard]] Diagnosis diagnose(const model::ObservedModel& model, const ResidualTests& tests,
                                 const posterior::PriorTransform& priors,
                                 std::span<const likelihood::DatumPointer> data, const Eigen::VectorXd& p,
                                 const ResidualReport& report, double limit);

}  // namespace knothe::assimilation
