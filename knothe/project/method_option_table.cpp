#include "knothe/project/option_table.hpp"

namespace knothe::project {

using K = ValueKind;

std::vector<Option> method_option_table() {
  return {
      {"method", K::table, "", "How the posterior is computed.", {}},
      {"method.kind",
       K::choice,
       "transport",
       "Transport map; dense quadrature on a grid (at most 3 parameters); Markov chain and sequential Monte "
       "Carlo; "
       "for `knothe assimilate` also the extended, unscented and ensemble Kalman filter.",
       {"transport", "grid", "mcmc", "smc", "ekf", "ukf", "enkf"}},
      {"method.likelihood",
       K::choice,
       "gaussian",
       "Noise of each sensor in `knothe assimilate`: Gaussian, or Student-t, to which outliers do little "
       "(independent "
       "noise only).",
       {"gaussian", "student-t"}},
      {"method.degrees_of_freedom", K::positive, "4", "Of the Student-t likelihood.", {}},
      {"method.gate",
       K::non_negative,
       "0",
       "Values whose innovation is more than so many of its standard deviations are rejected; 0: none.",
       {}},
      {"method.noise_level",
       K::choice,
       "known",
       "Whether the noise of the data file is right, or one factor of all its variances is inferred with the "
       "parameters.",
       {"known", "unknown"}},
      {"method.noise_level_shape", K::positive, "2", "Shape a of that factor's inverse-gamma prior.", {}},
      {"method.noise_level_scale", K::positive, "1", "Scale b of it; the prior's mean is b/(a − 1).", {}},
      {"method.offset_std",
       K::non_negative,
       "0",
       "Standard deviation of a constant, unknown offset of each sensor, m; integrated out.",
       {}},
      {"method.forgetting",
       K::positive,
       "1",
       "A structure that changes: before each datum the likelihood of those before it is raised to this "
       "power, at "
       "most 1.",
       {}},
      {"method.change_points",
       K::numbers,
       "[]",
       "Steps before which the structure changed: data before them count by `change_retention` only.",
       {}},
      {"method.change_retention",
       K::non_negative,
       "0",
       "Power to which the likelihood of the data before a change is raised; 0: the posterior begins anew.",
       {}},
      {"method.on_alarm",
       K::choice,
       "none",
       "Whether an alarm of the evidence monitor is taken for a change of the structure, from when it began.",
       {"none", "restart"}},
      {"method.form",
       K::choice,
       "collapsed",
       "All data in one quadratic form, or a composition of low-order maps.",
       {"collapsed", "composed"}},
      {"method.tolerance", K::positive, "1e-3", "Tolerance on the verified variance diagnostic.", {}},
      {"method.max_order", K::integer, "8", "Highest order of the map, 1 to 23.", {}},
      {"method.minimiser",
       K::choice,
       "newton",
       "Minimiser of the Kullback-Leibler divergence.",
       {"newton", "bfgs", "nelder-mead"}},
      {"method.bias_correction",
       K::choice,
       "off",
       "Correction of model bias: never, at every step, or from when the evidence monitor finds that the "
       "model "
       "does not explain the data until it does again.",
       {"off", "on", "auto"}},
      {"method.bias_extrapolation",
       K::choice,
       "joint",
       "How the bias goes on to the next time: unknown together with the parameters and integrated out "
       "(`joint`), or as the last residual, its time modes along a polynomial (`linear`), a damped trend, a "
       "Gaussian process; or each sensor by itself along a line through its last two residuals.",
       {"joint", "linear", "damped-trend", "gaussian-process", "pointwise"}},
      {"method.bias_memory",
       K::positive,
       "20",
       "`joint`: number of steps after which the bias has forgotten itself.",
       {}},
      {"method.bias_rank", K::integer, "2", "Modes of the bias that are kept, 1 to 20 (not `joint`).", {}},
      {"method.bias_order", K::integer, "1", "Degree of the polynomial, 0 to 3.", {}},
      {"method.bias_window",
       K::integer,
       "2",
       "Number of last steps that the polynomial is fitted to, 1 to 32; at least `bias_order` + 1 are used.",
       {}},
      {"method.samples", K::integer, "10000", "Draws that `knothe infer` leaves, at least 100.", {}},
      {"method.verification_points",
       K::integer,
       "1024",
       "`knothe infer`: points on which a map is verified and corrected, at least 64; each is an evaluation "
       "of the model.",
       {}},
      {"method.truncation_error",
       K::choice,
       "off",
       "Whether the reduced model's own error, whose covariance is in the model's file, is added to the "
       "noise "
       "of the measurements.",
       {"off", "on"}},
      {"method.mode_search",
       K::choice,
       "tempered",
       "How far `knothe infer` looks for mass that its map misses: particles that come from three times the "
       "priors' width "
       "(some thousands of evaluations of the model), or ascents from several starts alone (hundreds).",
       {"tempered", "multi-start"}},
      {"method.seed", K::integer, "1", "Seed of quasi-random points, chains and particles.", {}},
  };
}

}  // namespace knothe::project
