#include "knothe/project/method_options.hpp"

#include <tuple>

#include "knothe/posterior/map/solve/solver_names.hpp"
#include "knothe/project/option_section.hpp"

namespace knothe::project {
namespace {

using M = MethodOptions;
using U = assimilation::UpdateOptions;
using Map = posterior::MapSolverOptions;
using Bias = likelihood::BiasOptions;

void add_noise_options(Section<M>& s) {
  s.choice("likelihood", &M::student_t, "gaussian", "student-t",
           "Noise of each sensor in `knothe assimilate`: Gaussian, or Student-t, which is robust to outliers "
           "(independent noise only).");
  s.add("degrees_of_freedom", &M::degrees_of_freedom, "Degrees of freedom of the Student-t likelihood.",
        positive);
  s.add("gate", &M::gate,
        "Values whose innovation exceeds this many of its standard deviations are rejected; 0: none.",
        non_negative);
  s.choice("noise_level", &M::unknown_noise_level, "known", "unknown",
           "Whether the noise of the data file is known, or a common factor of all its variances is inferred "
           "with the parameters.");
  s.add("noise_level_shape", &M::noise_level_shape, "Shape a of that factor's inverse-gamma prior.",
        positive);
  s.add("noise_level_scale", &M::noise_level_scale, "Scale b of it; the prior's mean is b/(a − 1).",
        positive);
  s.add("offset_std", &M::offset_std,
        "Standard deviation of a constant, unknown offset of each sensor, m; integrated out.", non_negative);
  s.choice("truncation_error", &M::truncation_error, "off", "on",
           "Whether the reduced model's own error, whose covariance is in the model's file, is added to the "
           "noise of the measurements.");
}

void add_verification_options(Section<M>& s) {
  s.add("verify", &M::verify,
        "Whether the full-order model of [offline] is run at the posterior and the reduced model refined "
        "there, by `knothe assimilate` and, beside the updates, by `knothe serve`.");
  s.add("verify_runs", &M::verify_runs, "Maximum number of full-order runs for this, at least 1.",
        at_least(1));
}

void add_change_options(Section<M>& s) {
  s.add("forgetting", in(&M::update, &U::forgetting),
        "For a structure that changes: before each datum the likelihood of the earlier data is raised to "
        "this power, at most 1.",
        positive, at_most(1, ", which forgets nothing"));
  s.add("change_points", in(&M::update, &U::change_points),
        "Steps before which the structure changed: earlier data count only to the power `change_retention`.",
        of_shape("steps, 0, 1, 2 …"));
  s.add("change_retention", in(&M::update, &U::change_retention),
        "Power to which the likelihood of the data before a change is raised; 0: the posterior restarts from "
        "the prior.",
        non_negative, between(0, 1));
  s.choice(
      "on_alarm", in(&M::update, &U::restart_on_alarm), "none", "restart",
      "Whether an alarm of the evidence monitor is treated as a change of the structure, from its onset.");
}

void add_bias_options(Section<M>& s) {
  s.add("bias_correction", in(&M::update, &U::bias_correction),
        "Correction of model bias: never; at every step; or from the step at which the evidence monitor "
        "finds that the model does not explain the data, until it does again.");
  s.add("bias_extrapolation", in(&M::update, &U::bias, &Bias::way),
        "How the bias is extrapolated to the next time: inferred together with the parameters and integrated "
        "out (`joint`); or from the last residuals, whose time modes go on as a polynomial: with the recent "
        "errors of these modes added to the covariance (`linear`), or without, as in the paper "
        "(`published`).");
  s.add("bias_memory", in(&M::update, &U::bias, &Bias::memory),
        "`joint`: correlation length of the bias, in steps.", positive);
  s.add("bias_rank", in(&M::update, &U::bias, &Bias::rank),
        "Number of modes of the bias that are kept, 1 to 20 (not `joint`).", between(1, 20));
  s.add("bias_order", in(&M::update, &U::bias, &Bias::order), "Degree of the polynomial, 0 to 3.",
        between(0, 3));
  s.add("bias_window", in(&M::update, &U::bias, &Bias::window),
        "Number of last steps that the polynomial is fitted to, 1 to 32; at least `bias_order` + 1 are used.",
        between(1, 32));
}

void add_map_options(Section<M>& s) {
  s.add("form", in(&M::update, &U::form),
        "All data in one quadratic form, or a composition of low-order maps.");
  s.add("tolerance", in(&M::update, &U::map, &Map::tolerance),
        "Tolerance on the verified variance diagnostic.", positive);
  s.add("max_order", in(&M::update, &U::map, &Map::max_order), "Highest order of the map, 1 to 23.",
        at_least(1), at_most(23));
  s.add("minimiser", in(&M::update, &U::map, &Map::minimiser),
        "Minimiser of the Kullback-Leibler divergence.");
  s.add("samples", &M::samples, "Number of draws that `knothe infer` writes, at least 100.", at_least(100));
  s.add("evaluations", &M::evaluations,
        "Budget of `knothe infer`: calls that the model may be asked for, a gradient counting four. Every "
        "method ends within it with its best answer; with a larger one the same command goes on. 0: 20,000, "
        "or twice `samples` if that is more; 100,000 for `transport`; no limit for `grid`, `mcmc` and a "
        "separated "
        "model.",
        at_least(0));
  s.add(
      "seconds", &M::seconds,
      "Time limit of `knothe infer`, s, kept like `evaluations`: what was asked by then is the answer. 0: no "
      "limit.",
      non_negative);
  s.add("verification_points", &M::verification_points,
        "`knothe infer`: points on which a map is verified and corrected, at least 64; each is an evaluation "
        "of the model.",
        at_least(64));
  s.add("mode_search", &M::mode_search,
        "How `knothe infer` searches for probability mass that its map misses: by particles that start from "
        "three times the priors' width (a few thousand model evaluations), or only by ascents from several "
        "starting points (hundreds).");
  s.add("seed", &M::seed, "Seed of quasi-random points, chains and particles.");
}

const Section<M>& method_section() {
  static const Section<M> k_section("method", "How the posterior is computed.", [](Section<M>& s) {
    s.add("kind", &M::kind,
          "`auto`: the cheapest method whose accuracy is verified: quadrature around the modes (up to 3 "
          "parameters), weighted draws (3 to 8), otherwise the transport map, which is always used with "
          "`form = \"composed\"`; for `knothe infer` weighted draws, but the map for a reduced model with up "
          "to 3 parameters. Transport map; dense quadrature on a grid (at most 3 parameters); Markov chain "
          "and sequential Monte Carlo; for `knothe assimilate` also the extended, unscented and ensemble "
          "Kalman filter.");
    add_map_options(s);
    add_noise_options(s);
    add_verification_options(s);
    add_change_options(s);
    add_bias_options(s);
  });
  return k_section;
}

}  // namespace

std::vector<Option> method_option_table() {
  return joined(method_section());
}

MethodOptions read_method(Values& values) {
  return method_section().read(values);
}

}  // namespace knothe::project
