#include "knothe/project/simulation.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "knothe/assimilation/data/synthetic_measurements.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/text.hpp"

namespace knothe::project {

std::vector<double> simulated_truth(const Project& project, const std::vector<std::string>& names) {
  project.require(project.simulate.has_value(), "a table [simulate]");
  std::vector<double> truth;
  for (const std::string& name : names) {
    const auto it = project.simulate->truth.find(name);
    if (it == project.simulate->truth.end()) {
      throw project.error_at("simulate.truth",
                             fmt::format("simulate.truth lacks \"{}\", a parameter of the model", name));
    }
    truth.push_back(it->second);
  }
  for (const auto& [name, value] : project.simulate->truth) {
    if (std::find(names.begin(), names.end(), name) == names.end()) {
      throw project.error_at("simulate.truth." + name,
                             fmt::format("simulate.truth.{} is not a parameter of the model{}", name,
                                         did_you_mean(name, names)));
    }
  }
  return truth;
}

void simulate_measurements(const Project& project, const reduction::Dofs& dofs,
                           const std::vector<double>& time, const DisplacementField& field,
                           std::optional<std::uint64_t> seed, const std::string& output) {
  const SimulateOptions& options = *project.simulate;
  project.require(options.dofs.nodes > 0, "[simulate] dofs; for pictures instead give --images");
  const std::uint64_t used_seed = seed.value_or(options.seed);
  std::vector<std::size_t> chosen;
  try {
    chosen = assimilation::choose_dofs(dofs, options.dofs, used_seed);
  } catch (const ProjectError& error) {
    throw project.error_at("simulate.dofs.random", error.what());
  }
  Eigen::MatrixXd exact(static_cast<Eigen::Index>(chosen.size()), static_cast<Eigen::Index>(time.size()));
  for (std::size_t t = 0; t < time.size(); ++t) {
    const std::vector<double> values = field(t, chosen);
    std::copy(values.begin(), values.end(), exact.col(static_cast<Eigen::Index>(t)).data());
  }
  assimilation::Measurements measurements =
      assimilation::add_noise(dofs, chosen, time, exact, options.noise_std, used_seed);
  measurements.truth = options.truth;
  assimilation::write_measurements(output, measurements, project.text, used_seed);
}

}  // namespace knothe::project
