#include "knothe/project/option_table.hpp"

#include <fmt/format.h>

namespace knothe::project {
namespace {

using K = ValueKind;

const std::vector<Option>& options() {
  static const std::vector<Option> k_options = {
      {"model",
       K::table,
       "",
       "The reduced model; `model = \"M.h5\"` is short for `[model] separated = \"M.h5\"`.",
       {}},
      {"model.separated",
       K::path,
       "",
       "Reduced model file made by `knothe offline` or `knothe model import`.",
       {}},
      {"model.candidates",
       K::texts,
       "[]",
       "Further reduced models that `knothe assimilate` runs side by side with it on the same data: how "
       "probable "
       "each is comes with every step.",
       {}},
      {"model.umbridge",
       K::text,
       "",
       "Address of a UM-Bridge 1.0 server, `\"http://HOST:PORT\"` (`knothe infer`).",
       {}},
      {"model.name", K::text, "", "Name of the server's model; not needed if it has only one.", {}},
      {"model.config", K::free_table, "{}", "Passed through to the server with every request.", {}},
      {"model.timeout", K::positive, "30", "Longest time that a request may take, s.", {}},
      {"model.connections", K::integer, "1", "Requests made side by side, 1 to 64.", {}},
      {"model.kind",
       K::choice,
       "forward",
       "Predictions of the observations, or one number: the complete log posterior density.",
       {"forward", "density"}},
      {"model.derivatives",
       K::choice,
       "all",
       "Derivatives to ask the server for, of those that it says it has.",
       {"all", "first", "none"}},
      {"model.difference_step",
       K::positive,
       "1e-4",
       "Step of central differences, in units of the prior's scale, where the server has no derivatives.",
       {}},
      {"data",
       K::table,
       "",
       "The measurements; `data = \"D.h5\"` is short for `[data] file = \"D.h5\"`.",
       {}},
      {"data.file", K::path, "", "Measurements, HDF5 (`.h5`) or CSV (`.csv`).", {}},
      {"data.pictures",
       K::path,
       "",
       "Folder of pictures instead of measurements (`knothe dic`, `knothe assimilate`); those whose names "
       "begin "
       "with `reference` are the references, else the first is; a table `pictures.csv` (`time,file`) in it "
       "gives "
       "the times.",
       {}},
      {"data.times", K::numbers, "", "Model time of each deformed picture.", {}},
      {"results", K::path, "results/", "Folder for results; `-o` overrides it.", {}},

      {"observations", K::table, "", "What was observed of the model's outputs (`knothe infer`).", {}},
      {"observations.values",
       K::numbers,
       "",
       "Observed values, in the order of the model's outputs.",
       {},
       true},
      {"observations.std", K::numbers, "", "Standard deviation of the noise of each value.", {}},
      {"observations.covariance",
       K::matrix,
       "",
       "Covariance of the noise instead: symmetric, positive definite.",
       {}},
      {"observations.dofs",
       K::numbers,
       "",
       "Separated model: indices of the dofs observed, all of them at each step.",
       {}},
      {"observations.steps",
       K::numbers,
       "",
       "Separated model: indices of the time steps observed; the values are ordered step by step.",
       {}},
      {"observations.output",
       K::text,
       "",
       "Separated model: observe this output of the model instead of dofs.",
       {}},

      {"parameters",
       K::table,
       "",
       "One table per parameter of the model; their order is the order everywhere.",
       {}},
      {"parameters.*", K::table, "", "Prior of the parameter of that name.", {}},
      {"parameters.*.prior", K::choice, "", "Family of the prior.", {"normal", "uniform", "lognormal"}, true},
      {"parameters.*.mean",
       K::number,
       "",
       "Mean of a normal prior, before truncation to the model's box.",
       {}},
      {"parameters.*.std", K::positive, "", "Standard deviation of a normal prior, before truncation.", {}},
      {"parameters.*.lower", K::number, "", "Lower end of a uniform prior.", {}},
      {"parameters.*.upper", K::number, "", "Upper end of a uniform prior.", {}},
      {"parameters.*.mu", K::number, "", "Mean of the logarithm, lognormal prior.", {}},
      {"parameters.*.sigma", K::positive, "", "Standard deviation of the logarithm, lognormal prior.", {}},

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
      {"method.mode_search",
       K::choice,
       "tempered",
       "How far `knothe infer` looks for mass that its map misses: particles that come from three times the "
       "priors' width "
       "(tens of thousands of evaluations of the model), or ascents from several starts alone (a few "
       "hundred).",
       {"tempered", "multi-start"}},
      {"method.seed", K::integer, "1", "Seed of quasi-random points, chains and particles.", {}},

      {"offline", K::table, "", "How the reduced model is made.", {}},
      {"offline.method",
       K::choice,
       "snapshots",
       "Full-order runs on a grid of parameters, or LATIN-PGD, which solves for the whole grid at once.",
       {"snapshots", "latin"}},
      {"offline.latin", K::table, "", "Options of LATIN-PGD.", {}},
      {"offline.latin.accuracy",
       K::positive,
       "1e-7",
       "Largest displacement that the out-of-balance forces left may be worth, m.",
       {}},
      {"offline.latin.window", K::integer, "2", "Load steps that are iterated together.", {}},
      {"offline.mesh", K::table, "", "Mesh of the beam.", {}},
      {"offline.mesh.element", K::positive, "0.005", "Element size near the notch, m.", {}},
      {"offline.mesh.layers", K::integer, "1", "Layers of elements over the half thickness.", {}},
      {"offline.mesh.gmsh", K::path, "", "Mesh file of Gmsh (hexahedra, named groups) instead.", {}},
      {"offline.damage", K::table, "", "What makes the damage law independent of the mesh.", {}},
      {"offline.damage.regularisation",
       K::choice,
       "none",
       "The law as it is (the element size is then a material parameter); inelastic strain scaled by "
       "reference "
       "size / element size, which keeps stress against opening; or a strain averaged over an internal "
       "length "
       "(slower; not with LATIN-PGD).",
       {"none", "crack-band", "gradient"}},
      {"offline.damage.reference_size",
       K::positive,
       "0.005",
       "Crack band: element size that Y0 and Ad belong to, m.",
       {}},
      {"offline.damage.internal_length",
       K::positive,
       "0.01",
       "Gradient: length over which strain is averaged, m; at least two elements.",
       {}},
      {"offline.steps", K::integer, "100", "Number of load steps.", {}},
      {"offline.displacement", K::positive, "4e-4", "Final imposed displacement, m.", {}},
      {"offline.young_modulus", K::positive, "30e9", "Young's modulus, Pa.", {}},
      {"offline.poisson_ratio", K::number, "0.23", "Poisson's ratio.", {}},
      {"offline.left_support",
       K::choice,
       "line",
       "Where u_x = 0: the line support, or the whole left face.",
       {"line", "face"}},
      {"offline.processes", K::integer, "2", "Processes that compute full-order runs side by side.", {}},
      {"offline.form", K::choice, "tree", "Form of the separated model.", {"tree", "canonical"}},
      {"offline.modes", K::integer, "30", "Number of modes (tree: r, canonical: m).", {}},
      {"offline.crack_lengths",
       K::integer,
       "80",
       "Elastic crack solutions, 1 mm apart from 0; 0 for none.",
       {}},
      {"offline.parameters", K::table, "", "One table per parameter of the damage law: `Y0`, `Ad`.", {}},
      {"offline.parameters.*", K::table, "", "Axis of the parameter grid.", {}},
      {"offline.parameters.*.reference",
       K::positive,
       "",
       "Physical value of 1.0 (Y0: J/m³, Ad: m³/J).",
       {},
       true},
      {"offline.parameters.*.lower", K::positive, "", "Lower end of the axis, dimensionless.", {}, true},
      {"offline.parameters.*.upper", K::positive, "", "Upper end of the axis, dimensionless.", {}, true},
      {"offline.parameters.*.nodes", K::integer, "7", "Nodes of the axis, evenly spaced, at least 2.", {}},

      {"simulate", K::table, "", "Synthetic measurements for `knothe simulate`.", {}},
      {"simulate.truth", K::table, "", "True value of each parameter.", {}, true},
      {"simulate.truth.*", K::number, "", "True value of the parameter of that name.", {}},
      {"simulate.dofs", K::table, "", "Which degrees of freedom are observed.", {}},
      {"simulate.dofs.random", K::integer, "", "Number of nodes, drawn at random.", {}, true},
      {"simulate.dofs.face", K::choice, "z", "Outer face on which the nodes lie.", {"x", "y", "z"}},
      {"simulate.dofs.x", K::numbers, "", "Range of x of the nodes, m.", {}},
      {"simulate.dofs.y", K::numbers, "", "Range of y of the nodes, m.", {}},
      {"simulate.dofs.components", K::texts, "[\"x\", \"y\"]", "Components observed at each node.", {}},
      {"simulate.noise_std", K::positive, "1e-6", "Standard deviation of the noise, m.", {}},
      {"simulate.seed", K::integer, "1", "Seed of nodes and noise; `--seed` overrides it.", {}},

      {"select", K::table, "", "Which dofs to measure (`knothe select`).", {}},
      {"select.criterion",
       K::choice,
       "d-optimal",
       "The paper's criteria on the sensitivity fields (`product`, `minimum`, `maximum`), or greedy choices: "
       "least "
       "posterior covariance at one point, or most expected information over the prior.",
       {"product", "minimum", "maximum", "d-optimal", "information-gain"}},
      {"select.count", K::integer, "30", "Number of dofs to choose.", {}},
      {"select.min_distance", K::non_negative, "0", "Least distance between any two of them, m.", {}},
      {"select.candidates",
       K::choice,
       "",
       "The dofs of the data file with their noise (default where the project names data), or those of the "
       "model "
       "(on the face and in the range of `[simulate.dofs]`, if given).",
       {"data", "model"}},
      {"select.at",
       K::table,
       "",
       "Parameters at which the model is linearised; the middle of its box otherwise.",
       {}},
      {"select.at.*", K::number, "", "Value of the parameter of that name.", {}},
      {"select.step",
       K::integer,
       "",
       "Model time step of the sensitivity fields of the paper's criteria; the middle one otherwise. Greedy "
       "choices "
       "sum over all steps.",
       {}},
      {"select.noise_std",
       K::positive,
       "",
       "Standard deviation of the noise of candidates of the model, m; that of `[simulate]`, or 1e-6, "
       "otherwise.",
       {}},

      {"forecast", K::table, "", "One table per quantity of interest.", {}},
      {"forecast.*", K::table, "", "A forecast of that name.", {}},
      {"forecast.*.quantity",
       K::choice,
       "",
       "What is forecast.",
       {"crack_length", "displacement", "output"},
       true},
      {"forecast.*.horizon", K::number, "", "Model time for which it is forecast.", {}, true},
      {"forecast.*.threshold", K::number, "", "P(q > threshold) is reported (unit of q).", {}},
      {"forecast.*.prior", K::table, "", "Prior of a crack length: `{ mean = …, std = … }`, m.", {}},
      {"forecast.*.prior.mean", K::number, "", "Prior mean of the crack length, m.", {}, true},
      {"forecast.*.prior.std", K::positive, "", "Prior standard deviation of the crack length, m.", {}, true},
      {"forecast.*.discrepancy_std",
       K::positive,
       "1e-6",
       "Discrepancy between damage model and elastic crack, m.",
       {}},
      {"forecast.*.point", K::numbers, "", "Where a displacement is forecast: x, y, z, m.", {}},
      {"forecast.*.component", K::choice, "", "Component of a displacement.", {"x", "y", "z"}},
      {"forecast.*.output", K::text, "", "Name of a model's output, e.g. `reaction_force`.", {}},

      {"serve", K::table, "", "The online service (`knothe serve`, docs/service.md).", {}},
      {"serve.address",
       K::text,
       "127.0.0.1",
       "Address to listen at; anything but loopback needs both tokens.",
       {}},
      {"serve.port", K::integer, "8080", "Port to listen at, 0 for a free one; `--port` overrides it.", {}},
      {"serve.site", K::text, "", "Name of the structure; without it, that of the project file.", {}},
      {"serve.others", K::texts, "[]", "Project files of further structures, served beside this one.", {}},
      {"serve.journal", K::path, "", "The journal; without it, NAME.journal beside NAME.toml.", {}},
      {"serve.window",
       K::integer,
       "3",
       "By how many places a datum may come late and still be put in its place; later, it is quarantined.",
       {}},
      {"serve.period",
       K::positive,
       "",
       "Time between two data, s; without it, the median of the last ones.",
       {}},
      {"serve.budget",
       K::positive,
       "",
       "Time that an update may take, s; without it, a tenth of the period.",
       {}},
      {"serve.stale_after",
       K::positive,
       "",
       "Age of the last datum from which the state is STALE, s; without it, 5 periods.",
       {}},
      {"serve.read_token", K::path, "", "File with the bearer token that reading needs.", {}},
      {"serve.ingest_token", K::path, "", "File with the bearer token that sending measurements needs.", {}},
      {"serve.max_body", K::integer, "8388608", "Largest body of a request, bytes.", {}},
      {"serve.max_connections", K::integer, "1024", "Connections open at a time.", {}},
      {"serve.timeout", K::positive, "30", "Time that a request may take to arrive, s.", {}},
      {"serve.log",
       K::choice,
       "events",
       "What is logged on stderr: starts, stops, errors and states, or every step too.",
       {"events", "steps"}},
      {"serve.mqtt", K::table, "", "Measurements by MQTT too, at topic knothe/v1/SITE/SOURCE/data.", {}},
      {"serve.mqtt.broker", K::text, "", "The broker, `\"HOST\"` or `\"HOST:PORT\"`.", {}, true},
      {"serve.mqtt.user", K::text, "", "User name at the broker.", {}},
      {"serve.mqtt.password", K::path, "", "File with the password.", {}},
      {"serve.mqtt.ca",
       K::path,
       "",
       "File with the certificates that the broker is checked by; with it, TLS is spoken.",
       {}},
  };
  static const std::vector<Option> k_all = [] {
    std::vector<Option> all = k_options;
    const std::vector<Option> pictures = picture_option_table();
    all.insert(all.end(), pictures.begin(), pictures.end());
    return all;
  }();
  return k_all;
}

}  // namespace

std::span<const Option> option_table() {
  return options();
}

std::string describe(ValueKind kind) {
  switch (kind) {
    case K::text:
      return "a text";
    case K::path:
      return "a path";
    case K::integer:
      return "a non-negative whole number";
    case K::number:
      return "a finite number";
    case K::positive:
      return "a positive number";
    case K::non_negative:
      return "a number that is not negative";
    case K::boolean:
      return "true or false";
    case K::choice:
      return "one of the words given";
    case K::numbers:
      return "an array of finite numbers";
    case K::texts:
      return "an array of texts";
    case K::matrix:
      return "an array of rows of finite numbers, all of the same length";
    case K::table:
    case K::free_table:
      return "a table";
  }
  return {};
}

std::string option_reference() {
  std::string out =
      "# Project file: all options\n\n"
      "Made by `knothe check --options` from the table in `knothe/project/option_table.cpp`; do not edit. "
      "The format is TOML; paths are relative to the file; `*` stands for a name.\n\n"
      "| option | value | default | meaning |\n| --- | --- | --- | --- |\n";
  for (const Option& option : options()) {
    std::string value = describe(option.kind);
    if (option.kind == K::choice) {
      value.clear();
      for (const std::string& choice : option.choices)
        value += (value.empty() ? "`\"" : ", `\"") + choice + "\"`";
    }
    out += fmt::format("| `{}` | {} | {} | {} |\n", option.path, value,
                       option.default_value.empty() ? (option.required ? "required" : "–")
                                                    : "`" + option.default_value + "`",
                       option.meaning);
  }
  return out;
}

}  // namespace knothe::project
