#include "knothe/project/option_table.hpp"

namespace knothe::project {

using K = ValueKind;

std::vector<Option> offline_option_table() {
  return {
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
      {"offline.latin.start",
       K::path,
       "",
       "Reduced model to start from, of the same mesh, steps and material, e.g. one of snapshots on a "
       "coarser "
       "grid of parameters (hybrid); otherwise the elastic solution.",
       {}},
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
      {"offline.sparse_level",
       K::integer,
       "",
       "Full-order runs at the points of a sparse grid of this level only (for four parameters and more); "
       "the "
       "others of the tensor grid are interpolated. Default: all points.",
       {}},
      {"offline.adaptive", K::table, "", "Sizes of the reduced model found by its error, not given.", {}},
      {"offline.adaptive.error",
       K::positive,
       "",
       "Modes are added until no observed dof is off by more at any grid point and step, m; `modes` is not "
       "used.",
       {}},
      {"offline.adaptive.posterior_shift",
       K::positive,
       "",
       "Modes are added until the posterior mean of synthetic data moves by less at every step, in its "
       "standard "
       "deviation, at three truths (needs [parameters] and [simulate]); `modes` is not used.",
       {}},
      {"offline.adaptive.grid_error",
       K::positive,
       "",
       "The level of a sparse grid rises, then nodes are added to the parameter grid, until it meets four "
       "full-order runs off the grid to this on "
       "the "
       "observed dofs, m.",
       {}},
      {"offline.adaptive.runs", K::integer, "400", "Largest number of grid points then.", {}},
      {"offline.crack_lengths",
       K::integer,
       "80",
       "Elastic crack solutions, 1 mm apart from 0; 0 for none.",
       {}},
      {"offline.parameters",
       K::table,
       "",
       "One table per parameter: `Y0` and `Ad` of the damage law; `E`, `support_stiffness`, `load_offset` if "
       "wanted.",
       {}},
      {"offline.parameters.*", K::table, "", "Axis of the parameter grid.", {}},
      {"offline.parameters.*.reference",
       K::positive,
       "",
       "Physical value of 1.0 (Y0: J/m³, Ad: m³/J, E: Pa, support_stiffness: N/m of each support, "
       "load_offset: m, at "
       "most 0.01 in all).",
       {},
       true},
      {"offline.parameters.*.lower",
       K::number,
       "",
       "Lower end of the axis, dimensionless; positive but for load_offset.",
       {},
       true},
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
  };
}

}  // namespace knothe::project
