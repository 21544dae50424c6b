#pragma once
/// @file A choice of dofs, explained, and set against other choices.
#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "knothe/assimilation/select/data_selection.hpp"
#include "knothe/assimilation/select/sensitivity.hpp"
#include "knothe/base/enum_names.hpp"

namespace knothe::assimilation {

/// What to choose from, and how.
struct SelectionProblem {
  enum class Criterion { product, minimum, maximum, d_optimal, information_gain };
  Criterion criterion = Criterion::d_optimal;
  std::size_t count = 30;
  double min_distance = 0;                             ///< m
  Eigen::Matrix<double, Eigen::Dynamic, 3> positions;  ///< of the candidates, m
  std::vector<posterior::Prior> priors;                ///< truncated
  Eigen::VectorXd at;                                  ///< p where the model is linearised
  std::size_t step = 0;                                ///< model time index of the paper's criteria
  Eigen::Index gain_points = 8;                        ///< draws of the prior for the information gain
  std::uint64_t seed = 1;                              ///< of the random choices compared with
};

constexpr auto names_of(SelectionProblem::Criterion /*criterion*/) {
  using Criterion = SelectionProblem::Criterion;
  return std::to_array<Named<Criterion>>({{Criterion::product, "product"},
                                          {Criterion::minimum, "minimum"},
                                          {Criterion::maximum, "maximum"},
                                          {Criterion::d_optimal, "d-optimal"},
                                          {Criterion::information_gain, "information-gain"}});
}

/// A chosen dof and why.
struct RankedDof {
  Eigen::Index dof = 0;             ///< index among the candidates
  double score = 0;                 ///< of the criterion: |M S| combined (1/m), or nats gained
  Eigen::VectorXd sensitivity;      ///< d: largest |∂y/∂p_j| · prior std over the steps, m
  std::vector<std::size_t> when;    ///< d: the step (of those measured) where it is largest
  Eigen::VectorXd signal_to_noise;  ///< d: that sensitivity over the marginal std of the noise
  Eigen::VectorXd posterior_std;    ///< d: linearised, with this dof and those before it
};

/// Linearised posterior std against the number of dofs, for one way of choosing.
struct SelectionCurve {
  std::string name;
  Eigen::MatrixXd posterior_std;  ///< number of dofs × d
};

struct SelectionStudy {
  std::vector<RankedDof> ranked;
  std::vector<SelectionCurve> curves;  ///< the choice, D-optimal, the paper's product, random (median of 5)
  Eigen::VectorXd prior_std, posterior_std_of_all;  ///< d
  Eigen::MatrixXd sensitivity;                      ///< n × d at `step`: ∂y/∂p_j · prior std, m
  Eigen::VectorXd score;      ///< n, the paper's criterion (product where the choice is greedy)
  double choice_seconds = 0;  ///< the choice itself, comparison apart
};

/// `model` has the steps that are or will be measured; `whole` all steps of the model. Prior stds are those
/// of the truncated priors.
[[nodiscard]] SelectionStudy study_selection(const model::ObservedModel& model,
                                             const model::ObservedModel& whole,
                                             const likelihood::NoiseModel& noise,
                                             const SelectionProblem& problem);

/// "1st of 30: mostly Y0 …": what a chosen dof tells, in words. `names`: of the parameters.
[[nodiscard]] std::string explain(const SelectionStudy& study, std::size_t rank,
                                  const std::vector<std::string>& names);

/// Standard deviation of a (truncated) prior, by quadrature in z.
[[nodiscard]] double standard_deviation(const posterior::Prior& prior);

}  // namespace knothe::assimilation
