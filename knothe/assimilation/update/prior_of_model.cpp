#include "knothe/assimilation/update/prior_of_model.hpp"

#include <fmt/format.h>

#include <cassert>

namespace knothe::assimilation {

std::vector<Prior> truncated_to_box(std::span<const reduction::Axis> axes, std::vector<Prior> priors) {
  assert(priors.size() <= axes.size());
  for (std::size_t k = 0; k < priors.size(); ++k)
    priors[k] = priors[k].truncated(axes[k].nodes.front(), axes[k].nodes.back(), axes[k].name);
  return priors;
}

std::shared_ptr<const PriorTransform> truncated_to_box(const reduction::ObservedModel& model,
                                                       std::vector<Prior> priors) {
  const Eigen::VectorXd lower = model.functions->lower(), upper = model.functions->upper();
  assert(std::ssize(priors) == lower.size());
  for (std::size_t k = 0; k < priors.size(); ++k) {
    const auto i = static_cast<Eigen::Index>(k);
    const std::string name = k < model.parameters.size() ? model.parameters[k] : fmt::format("{}", k);
    priors[k] = priors[k].truncated(lower[i], upper[i], name);
  }
  return std::make_shared<const PriorTransform>(std::move(priors));
}

Eigen::VectorXd medians(const PriorTransform& transform) {
  Eigen::VectorXd p(transform.dimension());
  for (Eigen::Index k = 0; k < p.size(); ++k) p[k] = transform.prior(k).from_standard_normal(0).value;
  return p;
}

}  // namespace knothe::assimilation
