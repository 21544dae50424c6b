#include "knothe/posterior/prior/earlier_posteriors.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "knothe/base/error.hpp"
#include "knothe/base/text.hpp"
#include "knothe/posterior/prior/joint_prior.hpp"
#include "knothe/posterior/weighted_posterior_file.hpp"

namespace knothe::posterior {

Prior EarlierPosteriors::prior_of(const std::string& path, const std::string& name) {
  if (!of_file_.contains(path)) {
    const WeightedPosterior found = read_weighted_posterior(path);
    of_file_[path] = {found.parameters, std::make_shared<const JointPrior>(found.points, found.weights,
                                                                           "the posterior in " + path)};
  }
  const auto& [names, joint] = of_file_[path];
  const auto it = std::find(names.begin(), names.end(), name);
  if (it == names.end())
    throw ProjectError(fmt::format("{} holds the posterior of {}, not of \"{}\"{}", path,
                                   fmt::join(names, ", "), name, did_you_mean(name, names)));
  return marginal_of(joint, it - names.begin());
}

}  // namespace knothe::posterior
