#pragma once
/// @file What an approximation of the model does to the posterior: the error that matters.
#include <memory>
#include <vector>

#include "knothe/assimilation/update/sequential_update.hpp"
#include "knothe/likelihood/noise/noise_model.hpp"
#include "knothe/model/observe/observed_model.hpp"
#include "knothe/posterior/prior/prior.hpp"

namespace knothe::assimilation {

/// Difference of two posteriors after one step, in units of the reference's posterior.
struct PosteriorShift {
  std::size_t step = 0;
  double mean = 0;  ///< largest over the parameters of |mean − mean_reference| / std_reference
  double std = 0;   ///< largest over the parameters of |std / std_reference − 1|
};

/// Assimilates `data` (n_obs × n_t, one column per model time) with both models and compares the posteriors
/// after every step. Both models observe the same dofs at the same times. `kind`: by transport maps (moments
/// good to 0.02 std, a second in all) or by dense quadrature (exact, slow, at most 3 parameters). Beyond
/// three parameters after five steps only, the last among them, by weighted points of the reference's
/// posterior. Interrupted.
[[nodiscard]] std::vector<PosteriorShift> posterior_shift(
    std::shared_ptr<const model::ObservedModel> model, std::shared_ptr<const model::ObservedModel> reference,
    const Eigen::MatrixXd& data, const likelihood::NoiseModel& noise,
    const std::vector<posterior::Prior>& priors, posterior::Method kind = posterior::Method::transport);

/// Largest shift over all steps, and that of the last one.
struct ShiftSummary {
  PosteriorShift worst_mean, worst_std, last;
};
[[nodiscard]] ShiftSummary summarise(const std::vector<PosteriorShift>& shifts);

}  // namespace knothe::assimilation
