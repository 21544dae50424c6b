#include "knothe/posterior/prior/prior_values.hpp"

#include <algorithm>

#include "knothe/posterior/prior/prior_transform.hpp"

namespace knothe::posterior {

using Eigen::Index;

PriorValues prior_values(std::span<const Prior> priors, const Eigen::MatrixXd& points) {
  constexpr double k_log_of_zero = -1e6;
  const Index n = points.rows(), d = std::ssize(priors);
  PriorValues values;
  values.mean.resize(d), values.std.resize(d), values.log_density.resize(n, d);
  for (Index k = 0; k < d; ++k) {
    values.families.push_back(priors[k].family());
    values.mean[k] = priors[k].mean(), values.std[k] = priors[k].std();
    for (Index i = 0; i < n; ++i)
      values.log_density(i, k) = std::max(k_log_of_zero, priors[k].log_density(points(i, k)));
  }
  const PriorTransform transform({priors.begin(), priors.end()});
  if (transform.is_independent()) return values;
  LogDensityBatch batch;
  batch.value.setZero(n);
  transform.add_dependence(points, 0, batch);
  values.log_dependence = batch.value.cwiseMax(k_log_of_zero);
  return values;
}

}  // namespace knothe::posterior
