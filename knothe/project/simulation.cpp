#include "knothe/project/simulation.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "knothe/base/error.hpp"
#include "knothe/base/text.hpp"
#include "knothe/likelihood/data/synthetic_measurements.hpp"

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

std::vector<std::string> truth_outside_box(const Project& project) {
  std::vector<std::string> warnings;
  if (!project.simulate || !project.offline) return warnings;
  for (const OfflineParameter& p : project.offline->parameters)
    if (const auto it = project.simulate->truth.find(p.name); it != project.simulate->truth.end())
      if (it->second < p.lower || it->second > p.upper)
        warnings.push_back(fmt::format(
            "simulate.truth.{} = {:g} is outside the model's bounds {:g} ... {:g}: no posterior can reach it",
            p.name, it->second, p.lower, p.upper));
  return warnings;
}

MeasuredQuantities measured_quantities(const Project& project, const std::vector<std::string>& names) {
  MeasuredQuantities measured;
  for (const auto& [name, std] : project.simulate->noise) {
    const auto found = std::find(names.begin(), names.end(), name);
    if (found == names.end())
      throw project.error_at("simulate.noise." + name,
                             fmt::format("simulate.noise.{} is no quantity or output of the model{}", name,
                                         did_you_mean(name, names)));
    measured.dofs.push_back(found - names.begin());
    measured.std.push_back(std);
  }
  return measured;
}

MeasuredQuantities measured_quantities(const Project& project,
                                       const std::vector<model::Quantity>& quantities) {
  std::vector<std::string> names;
  for (const model::Quantity& quantity : quantities) names.push_back(quantity.name);
  MeasuredQuantities measured = measured_quantities(project, names);
  project.require(!measured.dofs.empty(),
                  "[simulate.noise] with a standard deviation for each quantity that is measured");
  return measured;
}

namespace {

Eigen::MatrixXd exact_values(const SimulatedField& simulated, const std::vector<std::size_t>& chosen) {
  Eigen::MatrixXd exact(std::ssize(chosen), std::ssize(simulated.time));
  for (std::size_t t = 0; t < simulated.time.size(); ++t) {
    const std::vector<double> values = simulated.field(t, chosen);
    std::copy(values.begin(), values.end(), exact.col(t).data());
  }
  return exact;
}

likelihood::Measurements measured_dofs(const Project& project, const SimulatedField& simulated,
                                       std::uint64_t seed) {
  const SimulateOptions& options = *project.simulate;
  project.require(options.dofs.nodes > 0, "[simulate] dofs; for pictures instead give --images");
  try {
    const auto chosen = likelihood::choose_dofs(simulated.dofs, options.dofs, seed);
    likelihood::Measurements measured = likelihood::add_noise(
        simulated.dofs, chosen, simulated.time, exact_values(simulated, chosen), options.noise_std, seed);
    measured.series = simulated_series(project, simulated, seed);
    return measured;
  } catch (const ProjectError& error) {
    throw project.error_at("simulate.dofs.random", error.what());
  }
}

using SeriesByName = std::map<std::string, likelihood::MeasuredSeries>;

/// `exact`: a row for each of `quantities`.
SeriesByName with_noise(const std::vector<double>& time, const Eigen::MatrixXd& exact,
                        const std::vector<model::Quantity>& quantities, const std::vector<double>& std,
                        std::uint64_t seed) {
  const likelihood::Measurements noisy = likelihood::add_noise(
      time, exact, Eigen::Map<const Eigen::VectorXd>(std.data(), std::ssize(std)), seed);
  SeriesByName found;
  for (Eigen::Index i = 0; i < exact.rows(); ++i) {
    const Eigen::VectorXd series = noisy.values.row(i);
    found[quantities[i].name] = {{series.begin(), series.end()}, std[i], {}, quantities[i].units, {}, {}};
  }
  return found;
}

/// Quantities without a place, beside no displacements.
likelihood::Measurements measured_alone(const Project& project, const SimulatedField& simulated,
                                        std::uint64_t seed) {
  const auto [chosen, std] = measured_quantities(project, simulated.quantities);
  std::vector<model::Quantity> quantities;
  for (const std::size_t dof : chosen) quantities.push_back(simulated.quantities[dof]);
  likelihood::Measurements m;
  m.time = simulated.time;
  m.series = with_noise(m.time, exact_values(simulated, chosen), quantities, std, seed);
  m.values.resize(0, std::ssize(m.time));
  m.noise = likelihood::NoiseModel::independent(Eigen::VectorXd());
  return m;
}

}  // namespace

SeriesByName simulated_series(const Project& project, const SimulatedField& simulated, std::uint64_t seed) {
  std::vector<std::string> names;
  for (const model::SnapshotOutput& output : simulated.outputs) names.push_back(output.name);
  const auto [chosen, std] = measured_quantities(project, names);
  if (chosen.empty()) return {};
  std::vector<model::Quantity> quantities;
  Eigen::MatrixXd exact(std::ssize(chosen), std::ssize(simulated.time));
  for (std::size_t i = 0; i < chosen.size(); ++i) {
    const model::SnapshotOutput& output = simulated.outputs[chosen[i]];
    quantities.push_back({output.name, output.labels.units});
    exact.row(i) = Eigen::Map<const Eigen::RowVectorXd>(output.values.data(), exact.cols());
  }
  return with_noise(simulated.time, exact, quantities, std,
                    seed + 1);  // not the numbers of the displacements
}

void simulate_measurements(const Project& project, const SimulatedField& simulated,
                           std::optional<std::uint64_t> seed, const std::string& output) {
  const std::uint64_t used_seed = seed.value_or(project.simulate->seed);
  likelihood::Measurements measurements =
      (simulated.quantities.empty() ? measured_dofs : measured_alone)(project, simulated, used_seed);
  measurements.truth = project.simulate->truth;
  likelihood::write_measurements(output, measurements, project.text, used_seed);
}

}  // namespace knothe::project
