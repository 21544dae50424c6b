#include "knothe/posterior/quadrature/marginal_density.hpp"

#include <algorithm>
#include <cmath>

#include "knothe/numerics/statistics/normal_distribution.hpp"

namespace knothe::posterior {

namespace {

/// Weights at equidistant bins, each value's shared by the two bins beside it in proportion to how near they
/// are: exact for the mean, and the variance grows by spacing²/6 (Jones and Lotwick, Appl. Stat. 33, 1984).
class Bins {
 public:
  Bins(double from, double to, double spacing)
      : from_(from), spacing_(spacing), weights_(static_cast<std::size_t>((to - from) / spacing) + 2, 0.0) {}

  /// Nothing where the value is outside.
  void add(double value, double weight) {
    const double place = (value - from_) / spacing_;
    if (!(place >= 0) || place >= weights_.size() - 1) return;
    const auto bin = static_cast<std::size_t>(place);
    const double share = place - bin;
    weights_[bin] += (1 - share) * weight;
    weights_[bin + 1] += share * weight;
  }

  /// Density at `point` by the kernel φ − φ″/2 of this width (Silverman 1986, Eq. 3.52: fourth order), less
  /// what the bins have added.
  [[nodiscard]] double density(double point, double width) const {
    const double kernel = std::sqrt(width * width - spacing_ * spacing_ / 6);
    const double half_square = 0.5 * (width / kernel) * (width / kernel);
    const double place = (point - from_) / spacing_, reach = 6 * width / spacing_;
    const double last = weights_.size() - 1;
    const std::size_t begin = std::max(0.0, std::ceil(place - reach));
    const std::size_t end = std::min(last, std::floor(place + reach));
    double sum = 0;
    for (std::size_t bin = begin; bin <= end; ++bin)
      if (weights_[bin] > 0) {
        const double u = (bin - place) * spacing_ / kernel;
        sum += weights_[bin] * (1 + half_square * (1 - u * u)) * numerics::normal_pdf(u);
      }
    return std::max(0.0, sum / kernel);
  }

 private:
  double from_, spacing_;
  std::vector<double> weights_;
};

}  // namespace

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
  // However many values there are; one that lies between two bins changes its kernel by 5/(36 · 24²) = 2e-4.
  Bins bins(from - 6 * width, to + 6 * width, width / 24);
  for (Eigen::Index i = 0; i < values.size(); ++i) {
    const double weight = weights[i] / total;
    bins.add(values[i], weight);
    if (std::isfinite(prior.lower())) bins.add(2 * prior.lower() - values[i], weight);
    if (std::isfinite(prior.upper())) bins.add(2 * prior.upper() - values[i], weight);
  }
  MarginalDensity result;
  for (int k = 0; k < points; ++k) {
    result.points.push_back(from + (to - from) * k / (points - 1));
    result.density.push_back(bins.density(result.points.back(), width));
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

}  // namespace knothe::posterior
