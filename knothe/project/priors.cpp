#include "knothe/project/priors.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <map>
#include <memory>

#include "knothe/base/error.hpp"
#include "knothe/base/text.hpp"
#include "knothe/likelihood/step/prior_of_model.hpp"
#include "knothe/posterior/prior/joint_prior.hpp"
#include "knothe/posterior/weighted_posterior_file.hpp"

namespace knothe::project {
namespace {

struct Earlier {
  std::vector<std::string> parameters;
  std::shared_ptr<const posterior::JointPrior> joint;
};

Earlier read_earlier(const std::string& path) {
  const posterior::WeightedPosterior found = posterior::read_weighted_posterior(path);
  return {found.parameters, std::make_shared<const posterior::JointPrior>(found.points, found.weights,
                                                                          "the posterior in " + path)};
}

}  // namespace

std::vector<posterior::Prior> priors_of(const Project& project) {
  std::vector<posterior::Prior> priors;
  std::map<std::string, Earlier> of_file;
  for (const NamedPrior& parameter : project.parameters) {
    const std::string& path = parameter.posterior;
    if (path.empty()) {
      priors.push_back(parameter.prior);
      continue;
    }
    if (!of_file.contains(path)) of_file[path] = read_earlier(path);
    const auto& [names, joint] = of_file[path];
    const auto it = std::find(names.begin(), names.end(), parameter.name);
    if (it == names.end())
      throw project.error_at(
          "parameters." + parameter.name + ".of",
          fmt::format("{} holds the posterior of {}, not of \"{}\"{}", path, fmt::join(names, ", "),
                      parameter.name, did_you_mean(parameter.name, names)));
    priors.push_back(posterior::marginal_of(joint, it - names.begin()));
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
