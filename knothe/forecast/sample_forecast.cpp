#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <numeric>

#include "knothe/base/error.hpp"
#include "knothe/forecast/scalar_forecast.hpp"

namespace knothe::forecast {
namespace {

constexpr Eigen::Index k_density_points = 161;

/// Sorted samples with their shares of the weight.
struct Sorted {
  Eigen::ArrayXd value;
  Eigen::ArrayXd weight;      ///< sums to 1
  Eigen::ArrayXd cumulative;  ///< up to the middle of each sample's own share
};

Sorted sort(const Eigen::Ref<const Eigen::VectorXd>& values,
            const Eigen::Ref<const Eigen::VectorXd>& weights) {
  const double total = weights.sum();
  if (values.size() == 0 || values.size() != weights.size() || !(total > 0.0) || !std::isfinite(total) ||
      weights.minCoeff() < 0.0 || !values.allFinite())
    throw NumericalError("forecast: samples must be finite, their weights non-negative with a positive sum");
  std::vector<Eigen::Index> order(static_cast<std::size_t>(values.size()));
  std::iota(order.begin(), order.end(), Eigen::Index{0});
  // Ties by index, so that the order of summation is fixed.
  std::sort(order.begin(), order.end(), [&](Eigen::Index a, Eigen::Index b) {
    return values[a] < values[b] || (values[a] == values[b] && a < b);
  });
  Sorted sorted{values(order), weights(order) / total, {}};
  sorted.cumulative.resize(values.size());
  double below = 0.0;
  for (Eigen::Index i = 0; i < values.size(); ++i) {
    sorted.cumulative[i] = below + 0.5 * sorted.weight[i];
    below += sorted.weight[i];
  }
  return sorted;
}

double quantile(const Sorted& sorted, double level) {
  const double* begin = sorted.cumulative.data();
  const double* end = begin + sorted.cumulative.size();
  const auto i = static_cast<Eigen::Index>(std::lower_bound(begin, end, level) - begin);
  if (i == 0) return sorted.value[0];
  if (i == sorted.value.size()) return sorted.value[i - 1];
  const double width = sorted.cumulative[i] - sorted.cumulative[i - 1];
  const double part = width > 0.0 ? (level - sorted.cumulative[i - 1]) / width : 0.5;
  return sorted.value[i - 1] + part * (sorted.value[i] - sorted.value[i - 1]);
}

/// Silverman's rule of thumb with the effective sample size; never zero, so that equal samples make a narrow
/// bell instead of an infinite one.
double kernel_width(const Sorted& sorted, double mean, double std) {
  const double effective = 1.0 / sorted.weight.square().sum();
  const double middle_half = (quantile(sorted, 0.75) - quantile(sorted, 0.25)) / 1.349;
  const double spread = middle_half > 0.0 ? std::min(std, middle_half) : std;
  return std::max(0.9 * spread * std::pow(effective, -0.2), 1e-9 * std::max(std::abs(mean), 1e-9));
}

class KernelDensity {
 public:
  KernelDensity(const Sorted& sorted, double width)
      : sorted_(sorted), width_(width), scale_(1.0 / (width * std::sqrt(2.0 * M_PI))) {}

  /// Only samples within nine widths count: beyond, the kernel is below 1e-17 of its top.
  [[nodiscard]] double operator()(double x) const {
    const double* begin = sorted_.value.data();
    const double* end = begin + sorted_.value.size();
    const double* first = std::lower_bound(begin, end, x - 9.0 * width_);
    const double* last = std::upper_bound(first, end, x + 9.0 * width_);
    const auto start = static_cast<Eigen::Index>(first - begin);
    const auto count = static_cast<Eigen::Index>(last - first);
    const auto distance = (sorted_.value.segment(start, count) - x) / width_;
    return scale_ * (sorted_.weight.segment(start, count) * (-0.5 * distance.square()).exp()).sum();
  }

 private:
  const Sorted& sorted_;
  double width_, scale_;
};

/// Top of the density near its largest point, by golden section.
double most_probable(const KernelDensity& density, const ScalarForecast& forecast) {
  const auto best =
      std::max_element(forecast.density.begin(), forecast.density.end()) - forecast.density.begin();
  const auto last = static_cast<std::ptrdiff_t>(forecast.points.size()) - 1;
  double low = forecast.points[static_cast<std::size_t>(std::max<std::ptrdiff_t>(best - 1, 0))];
  double high = forecast.points[static_cast<std::size_t>(std::min(best + 1, last))];
  constexpr double golden = 0.6180339887498949;
  for (int k = 0; k < 30; ++k) {
    const double x1 = high - golden * (high - low), x2 = low + golden * (high - low);
    if (density(x1) > density(x2)) {
      high = x2;
    } else {
      low = x1;
    }
  }
  return 0.5 * (low + high);
}

}  // namespace

ScalarForecast forecast_of_samples(const Eigen::Ref<const Eigen::VectorXd>& values,
                                   const Eigen::Ref<const Eigen::VectorXd>& weights, double threshold) {
  const Sorted sorted = sort(values, weights);
  ScalarForecast result;
  result.mean = (sorted.weight * sorted.value).sum();
  result.std = std::sqrt((sorted.weight * (sorted.value - result.mean).square()).sum());
  for (std::size_t k = 0; k < k_levels.size(); ++k) result.values[k] = quantile(sorted, k_levels[k]);
  const double above = (sorted.value > threshold).select(sorted.weight, 0.0).sum();
  result.probability_above_threshold = std::min(1.0, above);

  const double width = kernel_width(sorted, result.mean, result.std);
  const KernelDensity density(sorted, width);
  const double low = sorted.value[0] - 3.5 * width, high = sorted.value[values.size() - 1] + 3.5 * width;
  for (Eigen::Index k = 0; k < k_density_points; ++k) {
    const double x = low + (high - low) * static_cast<double>(k) / static_cast<double>(k_density_points - 1);
    result.points.push_back(x);
    result.density.push_back(density(x));
  }
  result.maximum_a_posteriori = most_probable(density, result);
  return result;
}

}  // namespace knothe::forecast
