#pragma once
/// @file Are the parameters that the data ask for the same before and after a time, and in all of its parts?
#include <Eigen/Core>
#include <cstddef>

#include "knothe/likelihood/step/step_form.hpp"

namespace knothe::assimilation {

struct ParameterChange {
  double probability = 1;  ///< that chance makes as large a difference, at the time where it is least likely
  std::size_t after = 0;   ///< steps before that time
};

/// The score test of a change of the parameters at an unknown time (Andrews, Econometrica 61, 1993; Hansen,
/// J. Policy Modeling 14, 1992). With S_k and I_k the score and the information of the data before time k in
/// the directions of the parameters, both at the posterior mean,
///
///   S_k − I_k I_n⁻¹ S_n ~ N(0, I_k − I_k I_n⁻¹ I_k)
///
/// if they stay the same: χ² of d degrees, the largest over the borders of the blocks, each counted. It has
/// power where tests of the residuals have none: if the parameters change during the test, the misfit appears
/// in only d of the n m directions of the data.
///
/// `w`: posterior mean of the functions, centred as the forms are, r. `tangent`: r × d, where w goes when a
/// parameter increases by a posterior standard deviation. `level`: factor of all variances. Less than
/// `k_min_blocks` blocks: no test. Cost: O(r² d) per block.
[[nodiscard]] ParameterChange find_parameter_change(const likelihood::FormBlocks& blocks,
                                                    const Eigen::VectorXd& w, const Eigen::MatrixXd& tangent,
                                                    double level);

/// What the data of a form say of the parameters at `w`, in the directions of `tangent`: their information,
/// and in the last column their score; d × (d + 1).
[[nodiscard]] Eigen::MatrixXd said_of_parameters(const likelihood::StepForm& form, const Eigen::VectorXd& w,
                                                 const Eigen::MatrixXd& tangent);
/// The same test of a part of the data that is no time: a series, say. The probability that chance makes it
/// ask for parameters so different from what `all` (with that part) ask for.
[[nodiscard]] double probability_of_part(const Eigen::MatrixXd& part, const Eigen::MatrixXd& all,
                                         double level);

inline constexpr std::size_t k_min_blocks = likelihood::FormBlocks::k_max_blocks / 2;

}  // namespace knothe::assimilation
