#include "knothe/assimilation/verdict/edge_pressure.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "knothe/numerics/statistics/normal_distribution.hpp"

namespace knothe::assimilation {
namespace {

using Eigen::Index;

/// The distribution of a parameter's distance from an edge, linear between the points' distances: the nodes
/// of a lattice have few of these, and each stands for what lies half way to its neighbours.
class WayFromEdge {
 public:
  WayFromEdge(const posterior::Posterior& posterior, Index parameter, double edge) {
    const double bins_per_unit =
        k_bins / (k_deviations * std::sqrt(posterior.covariance(parameter, parameter)));
    std::array<double, k_bins + 1> mass{}, moment{};  // what is farther away is in the last
    for (Index i = 0; i < posterior.weights.size(); ++i) {
      const double distance = std::abs(posterior.points(i, parameter) - edge);
      const auto bin = static_cast<std::size_t>(std::min<double>(k_bins, distance * bins_per_unit));
      mass[bin] += posterior.weights[i];
      moment[bin] += posterior.weights[i] * distance;
    }
    double before = 0;
    for (std::size_t bin = 0; bin <= k_bins; ++bin) {
      if (!(mass[bin] > 0)) continue;
      add(moment[bin] / mass[bin], before + 0.5 * mass[bin]);
      before += mass[bin];
    }
    add(distance_.back(), before);
  }
  /// Distance within which that share of the mass is.
  [[nodiscard]] double reach(double share) const { return between(share_, distance_, share); }
  [[nodiscard]] double share_within(double distance) const { return between(distance_, share_, distance); }

 private:
  void add(double distance, double share) {
    distance_.push_back(distance);
    share_.push_back(share);
  }
  static double between(const std::vector<double>& x, const std::vector<double>& y, double at) {
    const std::size_t right = std::upper_bound(x.begin(), x.end() - 1, at) - x.begin();
    if (right == 0) return y[0];
    const double width = x[right] - x[right - 1];
    return width > 0 ? y[right - 1] + (at - x[right - 1]) / width * (y[right] - y[right - 1]) : y[right];
  }
  /// Points are counted in bins; the edge is within 2.5 standard deviations of the mean.
  static constexpr std::size_t k_bins = 512;
  static constexpr double k_deviations = 8;
  std::vector<double> distance_ = {0}, share_ = {0};
};

/// Of the half of the mass next to an edge, the share in the nearer half of the way, at least: 0.55 for a
/// normal density whose mean is half a standard deviation beyond the edge, 0.56 for a whole one, 0.59 for one
/// that only falls. More is asked of a density that is pressed like one of two standard deviations and more.
constexpr double k_half_next_to_it = 0.55, k_half_of_steep = 0.565, k_steep = 0.672;

}  // namespace

double edge_pressure(const posterior::Posterior& posterior, Index a, double edge) {
  // A standard deviation, or 1.3, is where such a density has its mean.
  if (std::abs(posterior.mean[a] - edge) > 2.5 * std::sqrt(posterior.covariance(a, a))) return 0;
  const WayFromEdge way(posterior, a, edge);
  const auto nearer = [&](double share) { return way.share_within(0.5 * way.reach(share)) / share; };
  const double pressure = nearer(0.8);
  return nearer(0.5) < (pressure < k_steep ? k_half_next_to_it : k_half_of_steep) ? 0 : pressure;
}

/// The mean of the data, c standard deviations s beyond the edge, is N(truth, s²): of truths on both sides of
/// the box 2 s/W (φ(c) − c Φ(−c)). c and s follow from the pressure and the truncated standard deviation.
double probability_inside(double pressure, double width) {
  const auto mass = [](double c) { return numerics::normal_cdf(-c); };
  const auto density = [](double c) { return std::exp(-0.5 * c * c) / std::sqrt(2 * std::numbers::pi); };
  const auto pressure_of = [&](double c) {
    const double reach = -numerics::normal_quantile(0.2 * mass(c)) - c;
    return (1 - mass(c + 0.5 * reach) / mass(c)) / 0.8;
  };
  double low = -2, high = 5;  // between which the pressure grows
  if (pressure <= pressure_of(low)) return 1;
  for (int k = 0; k < 40; ++k) {
    const double middle = 0.5 * (low + high);
    (pressure_of(middle) < pressure ? low : high) = middle;
  }
  const double c = low, rise = density(c) / mass(c);
  const double truncated = std::sqrt(1 + c * rise - rise * rise);  // over s
  return std::min(1.0, 2 * width / truncated * (density(c) - c * mass(c)));
}

}  // namespace knothe::assimilation
