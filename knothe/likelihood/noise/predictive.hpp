#pragma once
/// @file What would be measured: noise to add to predictions, and how probable a datum is under them.
#include <Eigen/Core>
#include <cstdint>

#include "knothe/likelihood/noise/gaussian_noise.hpp"

namespace knothe::likelihood {

/// `count` independent draws from N(0, R) in its first `rows` dofs (of which the others are independent),
/// rows × count, m; NaN for a dof that is not measured. `noise` is not restricted
/// (`GaussianNoise::precision`).
[[nodiscard]] Eigen::MatrixXd noise_draws(const GaussianNoise& noise, Eigen::Index rows, Eigen::Index count,
                                          std::uint64_t seed);

/// log N(values; prediction, R) for each column of `predictions` (rows × count), of the values that are there
/// (not NaN, and measured by that noise): natural logarithm, all constants included; 0 where there is none.
/// The noise may have further dofs behind these, which are independent of them.
[[nodiscard]] Eigen::VectorXd log_likelihoods(const Eigen::Ref<const Eigen::MatrixXd>& predictions,
                                              const Eigen::Ref<const Eigen::VectorXd>& values,
                                              const GaussianNoise& noise);

/// log p(value i | the other values, prediction), rows × count: what leave-one-out cross-validation needs of
/// values whose errors are correlated (Vehtari, Gelman, Gabry, Stat. Comput. 27, 2017; Bürkner et al.,
/// Comput. Stat. 36, 2021), and of independent ones the density of each. 0 where nothing was measured: such a
/// value says nothing. With correlated noise all dofs that it measures must be there (`can_be_split`).
[[nodiscard]] Eigen::MatrixXd pointwise_log_likelihoods(const Eigen::Ref<const Eigen::MatrixXd>& predictions,
                                                        const Eigen::Ref<const Eigen::VectorXd>& values,
                                                        const GaussianNoise& noise);
[[nodiscard]] bool can_be_split(const Eigen::Ref<const Eigen::VectorXd>& values, const GaussianNoise& noise);

/// E[F z | residual], n: what the error F z of a step (`NoiseModel::with_step_error`), z ~ N(0, I), explains
/// of the step's residual beside its noise. NaN in the residual: not measured.
[[nodiscard]] Eigen::VectorXd expected_step_error(const Eigen::Ref<const Eigen::VectorXd>& residual,
                                                  const GaussianNoise& noise, const Eigen::MatrixXd& factor);

}  // namespace knothe::likelihood
