#include "knothe/project/priors.hpp"

#include <string>

#include "knothe/base/error.hpp"
#include "knothe/likelihood/step/prior_of_model.hpp"
#include "knothe/posterior/prior/earlier_posteriors.hpp"

namespace knothe::project {
namespace {

constexpr const char* k_of_name_hint = "; where it has another name there, give that as \"of_name\"";

}  // namespace

std::vector<posterior::Prior> priors_of(const Project& project) {
  std::vector<posterior::Prior> priors;
  posterior::EarlierPosteriors earlier;
  for (const NamedPrior& parameter : project.parameters) {
    if (parameter.posterior.empty()) {
      priors.push_back(parameter.prior);
      continue;
    }
    const std::string& there = parameter.name_there;
    try {
      priors.push_back(earlier.prior_of(parameter.posterior, there.empty() ? parameter.name : there));
    } catch (const ProjectError& error) {
      throw project.error_at("parameters." + parameter.name + (there.empty() ? ".of" : ".of_name"),
                             error.what() + std::string(there.empty() ? k_of_name_hint : ""));
    }
  }
  return priors;
}

std::vector<posterior::Prior> priors_of(const Project& project, std::span<const model::Axis> axes) {
  std::vector<posterior::Prior> priors = priors_of(project);
  for (std::size_t k = 0; k < priors.size(); ++k) {
    try {
      priors[k] = likelihood::truncated_to_box(axes.subspan(k), {priors[k]})[0];
    } catch (const ProjectError& error) {
      throw project.error_at("parameters." + project.parameters[k].name, error.what());
    }
  }
  return priors;
}

}  // namespace knothe::project
