#pragma once
/// @file Sensitivity fields of a separated model and the criteria of Rubio et al. 2019, §5.2, made of them.
#include <Eigen/Core>
#include <vector>

#include "knothe/likelihood/noise/noise_model.hpp"
#include "knothe/model/observe/observed_model.hpp"

namespace knothe::assimilation {

/// S_j = ∂y/∂p_j at the observed dofs (Eq. 28), n × d, at parameters `p` (d, inside the box) and model time
/// index `step`; exact, from the derivatives of the parameter functions.
[[nodiscard]] Eigen::MatrixXd sensitivity_fields(const model::ObservedModel& model, const Eigen::VectorXd& p,
                                                 std::size_t step);

/// √(Σ_t S_j²) over all model times, n × d: what the mean time alone may miss.
[[nodiscard]] Eigen::MatrixXd sensitivity_over_time(const model::ObservedModel& model,
                                                    const Eigen::VectorXd& p);

/// How the sensitivities of several parameters make one number (§5.2; the product is the "cross-sensitivity"
/// S_12 = S_1 × S_2 of §6.5).
enum class SensitivityCriterion { product, minimum, maximum };

/// Score of each dof: the product, minimum or maximum over the parameters of |M S_j|, `weighted` being M S_j
/// (n × d) with M the precision of the noise, the paper's weight.
[[nodiscard]] Eigen::VectorXd sensitivity_score(const Eigen::MatrixXd& weighted,
                                                SensitivityCriterion criterion);

/// The `count` dofs of the highest score, best first (the lower index first where scores are equal), any two
/// of them at least `min_distance` apart; fewer where there are no more. `points`: n × 3, m.
[[nodiscard]] std::vector<Eigen::Index> highest(
    const Eigen::VectorXd& score, std::size_t count,
    const Eigen::Ref<const Eigen::Matrix<double, Eigen::Dynamic, 3>>& points, double min_distance);

}  // namespace knothe::assimilation
