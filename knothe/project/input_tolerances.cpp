#include "knothe/project/input_tolerances.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <string_view>

#include "knothe/base/text.hpp"

namespace knothe::project {
namespace {

using assimilation::InputError;

constexpr const char *k_displacements = "displacements", *k_clock = "clock", *k_modulus = "youngs_modulus";

/// How a parameter of the built-in beam must change for a larger E to change nothing but forces: all but
/// lengths are energies or forces. 0: not known.
double exponent_of_modulus(std::string_view parameter) {
  if (parameter == "Ad") return 1;
  return parameter == "Y0" || parameter == "Gf" || parameter == "support_stiffness" ? -1 : 0;
}

std::optional<InputError> error_of_modulus(const Project& project, const model::Sensors& sensors) {
  if (!project.offline || !project.offline->is_beam() || !project.known.empty()) return std::nullopt;
  InputError error{k_modulus};
  error.parameters.resize(std::ssize(project.parameters));
  for (Eigen::Index a = 0; a < error.parameters.size(); ++a) {
    const std::string& name = project.parameters[a].name;
    error.parameters[a] = exponent_of_modulus(name);
    if (error.parameters[a] == 0 && name != "load_offset") return std::nullopt;
  }
  error.readings.setZero(std::ssize(sensors));
  for (std::size_t k = 0; k < sensors.scalars.size(); ++k)
    if (sensors.scalars[k] == "reaction_force") error.readings[sensors.displacement_count() + k] = -1;
  return error;
}

}  // namespace

std::vector<InputError> input_errors(const Project& project, const UpdateSetup& setup) {
  const model::Sensors& sensors = setup.measurements.sensors;
  const Eigen::Index n = setup.problem.model->observations(), displacements = sensors.displacement_count();
  std::vector<InputError> errors;
  if (displacements > 0) {
    InputError& error = errors.emplace_back(k_displacements);
    error.readings.setZero(n);
    error.readings.head(displacements).setOnes();
  }
  if (setup.problem.model->time.size() > 1) {
    errors.emplace_back(k_clock).clock = 1;
    if (displacements > 0) {
      errors.push_back(errors.front());
      errors.back().name = "displacements and clock";
      errors.back().clock = 1;
    }
  }
  for (std::size_t k = 0; k < sensors.scalars.size(); ++k)
    errors.emplace_back(sensors.scalars[k]).readings = Eigen::VectorXd::Unit(n, displacements + k);
  if (auto error = error_of_modulus(project, sensors)) errors.push_back(std::move(*error));

  std::vector<std::string> names;
  for (const InputError& error : errors) names.push_back(error.name);
  for (const auto& [name, share] : project.tolerances) {
    const auto found = std::find(names.begin(), names.end(), name);
    if (found == names.end())
      throw project.error_at("tolerances." + name,
                             fmt::format("\"{}\" is no input of this test{}; its inputs are {}", name,
                                         did_you_mean(name, names), fmt::join(names, ", ")));
    errors[found - names.begin()].relative = share;
  }
  std::erase_if(errors, [](const InputError& error) { return error.relative == 0; });
  return errors;
}

}  // namespace knothe::project
