#include "knothe/likelihood/step/prior_of_model.hpp"

#include <fmt/format.h>

#include <cassert>

namespace knothe::likelihood {

std::vector<posterior::Prior> truncated_to_box(std::span<const model::Axis> axes,
                                               std::vector<posterior::Prior> priors) {
  assert(priors.size() <= axes.size());
  for (std::size_t k = 0; k < priors.size(); ++k)
    priors[k] = priors[k].truncated(axes[k].nodes.front(), axes[k].nodes.back(), axes[k].name);
  return priors;
}

std::shared_ptr<const posterior::PriorTransform> truncated_to_box(const model::ObservedModel& model,
                                                                  std::vector<posterior::Prior> priors) {
  const Eigen::VectorXd lower = model.functions->lower(), upper = model.functions->upper();
  assert(std::ssize(priors) == lower.size());
  for (std::size_t k = 0; k < priors.size(); ++k) {
    const Eigen::Index i = k;
    const std::string name = k < model.parameters.size() ? model.parameters[k] : fmt::format("{}", k);
    priors[k] = priors[k].truncated(lower[i], upper[i], name);
  }
  return std::make_shared<const posterior::PriorTransform>(std::move(priors));
}

Eigen::VectorXd medians(const posterior::PriorTransform& transform) {
  Eigen::VectorXd p(transform.dimension());
  for (Eigen::Index k = 0; k < p.size(); ++k) p[k] = transform.prior(k).from_standard_normal(0).value;
  return p;
}

}  // namespace knothe::likelihood
