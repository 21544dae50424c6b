#include "knothe/assimilation/update/marginal_density.hpp"

#include <algorithm>
#include <cmath>

#include "knothe/numerics/statistics/normal_distribution.hpp"

namespace knothe::assimilation {

MarginalDensity marginal_density(const Eigen::Ref<const Eigen::VectorXd>& values,
                                 const Eigen::Ref<const Eigen::VectorXd>& weights, const Prior& prior,
                                 int points) {
  const double total = weights.sum();
  const double mean = weights.dot(values) / total;
  const double variance = weights.dot((values.array() - mean).square().matrix()) / total;
  const double std = std::sqrt(std::max(variance, 1e-300));
  const double effective = total * total / weights.squaredNorm();
  const double width = 1.06 * std * std::pow(effective, -0.2);  // Silverman 1986, Eq. 3.28
  const double from = std::max(prior.lower(), mean - 5 * std), to = std::min(prior.upper(), mean + 5 * std);
  MarginalDensity result;
  result.points.resize(points);
  result.density.assign(points, 0.0);
  for (int k = 0; k < points; ++k) result.points[k] = from + (to - from) * k / (points - 1);
  const double spacing = (to - from) / (points - 1);
  const auto add_kernel = [&](double centre, double weight) {
    const int first = std::max(0, static_cast<int>(std::ceil((centre - 6 * width - from) / spacing)));
    const int last =
        std::min(points - 1, static_cast<int>(std::floor((centre + 6 * width - from) / spacing)));
    for (int k = first; k <= last; ++k) {
      result.density[k] += weight * numerics::normal_pdf((result.points[k] - centre) / width) / width;
    }
  };
  for (Eigen::Index i = 0; i < values.size(); ++i) {
    const double weight = weights[i] / total;
    add_kernel(values[i], weight);
    if (std::isfinite(prior.lower())) add_kernel(2 * prior.lower() - values[i], weight);
    if (std::isfinite(prior.upper())) add_kernel(2 * prior.upper() - values[i], weight);
  }
  return result;
}

MarginalDensity marginal_density(const Prior& prior, int points) {
  const double from = std::isfinite(prior.lower()) ? prior.lower() : prior.from_standard_normal(-4).value;
  const double to = std::isfinite(prior.upper()) ? prior.upper() : prior.from_standard_normal(4).value;
  MarginalDensity result;
  for (int k = 0; k < points; ++k) {
    result.points.push_back(from + (to - from) * k / (points - 1));
    result.density.push_back(std::exp(prior.log_density(result.points.back())));
  }
  return result;
}

}  // namespace knothe::assimilation
