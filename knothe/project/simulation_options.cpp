#include "knothe/project/simulation_options.hpp"

#include <fmt/format.h>

#include "knothe/project/option_section.hpp"

namespace knothe::project {
namespace {

using Dofs = likelihood::DofSelection;

const Section<SimulateOptions>& simulate_section() {
  using S = SimulateOptions;
  static const Section<S> k_section(
      "simulate", "Synthetic measurements for `knothe simulate`.", [](Section<S>& s) {
        s.table("truth", "True value of each parameter.", required);
        s.add("truth.*", &S::truth, "True value of the parameter of that name.");
        s.table("dofs", "Which degrees of freedom are observed.");
        s.add("dofs.random", in(&S::dofs, &Dofs::nodes), "Number of nodes, drawn at random.", at_least(1),
              required);
        s.choice("dofs.face", in(&S::dofs, &Dofs::face), k_components, "Outer face on which the nodes lie.");
        s.add("dofs.x", in(&S::dofs, &Dofs::x_range), "Range of x of the nodes, m.", of_shape("[from, to]"));
        s.add("dofs.y", in(&S::dofs, &Dofs::y_range), "Range of y of the nodes, m.", of_shape("[from, to]"));
        s.add("dofs.components", in(&S::dofs, &Dofs::components), "Components observed at each node.",
              of_shape(k_component_words));
        s.add("noise_std", &S::noise_std, "Standard deviation of the noise, m.", positive);
        s.table(
            "noise",
            "Which quantities without a position are measured: those of a model whose dofs have names, or "
            "outputs beside displacements and, in machine.csv, beside pictures.");
        s.add("noise.*", &S::noise,
              "Standard deviation of the noise of the quantity of that name, in the model's unit: SI where "
              "it is known.",
              positive);
        s.add("seed", &S::seed, "Seed of nodes and noise; `--seed` overrides it.");
      });
  return k_section;
}

const Section<CameraSimulation>& camera_section() {
  using C = CameraSimulation;
  static const Section<C> k_section(
      "simulate.camera", "The camera of `knothe simulate --images`; its view is described in [dic].",
      [](Section<C>& s) {
        const auto in_range = [](double v) { return v >= 64 && v <= 20000; };
        s.add("width", &C::width, "Width of the pictures, px.",
              check(in_range, "a picture's width must be from 64 to 20000 px"), required);
        s.add("height", &C::height, "Height of the pictures, px.",
              check(in_range, "a picture's height must be from 64 to 20000 px"), required);
        s.add("bit_depth", &C::bit_depth, "Bits per pixel, 8 to 16.", between(8, 16));
        s.add("noise", &C::noise, "Standard deviation of a pixel's noise, in grey levels of 8 bits.",
              non_negative);
        s.add("dot_radius", &C::dot_radius, "Radius of the speckle's dots, px.", positive);
        s.add("gain", &C::gain, "Brightness of the deformed pictures relative to the reference.", positive);
        s.add("references", &C::references, "Number of pictures of the unloaded surface.", at_least(1));
        s.add("every", &C::every, "A picture every this many model times.", at_least(1));
        s.add("supersampling", &C::supersampling,
              "Points per pixel in each direction, over which its light is integrated.", at_least(1));
      });
  return k_section;
}

const Section<SelectOptions>& select_section() {
  using S = SelectOptions;
  static constexpr auto k_candidates =
      std::to_array<Named<std::optional<bool>>>({{false, "data"}, {true, "model"}});
  static const Section<S> k_section("select", "Which dofs to measure (`knothe select`).", [](Section<S>& s) {
    s.add("criterion", &S::criterion,
          "The paper's criteria on the sensitivity fields (`product`, `minimum`, `maximum`), or greedy "
          "choices: minimum posterior covariance at one point, or maximum expected information over the "
          "prior.");
    s.add("count", &S::count, "Number of dofs to choose.", at_least(1));
    s.add("min_distance", &S::min_distance, "Minimum distance between any two of them, m.", non_negative);
    s.choice("candidates", &S::from_model, k_candidates,
             "The dofs of the data file with their noise (default where the project names data), or those of "
             "the model (on the face and in the range of `[simulate.dofs]`, if given).");
    s.table("at", "Parameters at which the model is linearised; the middle of its box otherwise.");
    s.add("at.*", &S::at, "Value of the parameter of that name.");
    s.add("step", &S::step,
          "Model time step of the sensitivity fields of the paper's criteria; the middle one otherwise. "
          "Greedy choices sum over all steps.");
    s.add("noise_std", &S::noise_std,
          "Standard deviation of the noise of candidates of the model, m; that of `[simulate]`, or 1e-6, "
          "otherwise.",
          positive);
  });
  return k_section;
}

void check_range(Values& values, const std::string& path, const std::optional<std::array<double, 2>>& range) {
  if (range && (*range)[0] > (*range)[1])
    values.complain(path, fmt::format("\"{}\" must be [from, to]", path));
}

}  // namespace

std::vector<Option> simulation_option_table() {
  return joined(simulate_section(), camera_section(), select_section());
}

SimulateOptions read_simulate(Values& values) {
  SimulateOptions s = simulate_section().read(values);
  check_range(values, "simulate.dofs.x", s.dofs.x_range);
  check_range(values, "simulate.dofs.y", s.dofs.y_range);
  if (values.has_table("simulate.camera")) s.camera = camera_section().read(values);
  if (!s.camera && !values.has_table("simulate.dofs") && s.noise.empty())
    values.complain("simulate",
                    "[simulate] lacks \"dofs\": which degrees of freedom are observed; or, for pictures, "
                    "\"camera\"; or \"noise\", for quantities without a place");
  return s;
}

SelectOptions read_select(Values& values) {
  return select_section().read(values);
}

}  // namespace knothe::project
