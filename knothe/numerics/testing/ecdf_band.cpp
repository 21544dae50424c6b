#include "knothe/numerics/testing/ecdf_band.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "knothe/base/error.hpp"

namespace knothe::numerics {

namespace {

/// Probabilities of the binomial law by a table of logarithms of factorials.
class Binomial {
 public:
  explicit Binomial(int n) : log_factorial_(n + 1, 0.0) {
    for (int k = 2; k <= n; ++k) log_factorial_[k] = log_factorial_[k - 1] + std::log(k);
  }
  [[nodiscard]] double probability(int n, int k, double log_p, double log_1_minus_p) const {
    return std::exp(table(n) - table(k) - table(n - k) + k * log_p + (n - k) * log_1_minus_p);
  }
  /// Smallest k with P(X ≤ k) ≥ level, for 0 < p < 1.
  [[nodiscard]] int quantile(int n, double p, double level) const {
    double cumulative = 0;
    for (int k = 0; k < n; ++k) {
      cumulative += probability(n, k, std::log(p), std::log1p(-p));
      if (cumulative >= level) return k;
    }
    return n;
  }

 private:
  [[nodiscard]] double table(int k) const { return log_factorial_[k]; }
  std::vector<double> log_factorial_;
};

void set_limits(const Binomial& binomial, double pointwise_level, EcdfBand& band) {
  for (Eigen::Index i = 0; i < band.at.size(); ++i) {
    band.lower[i] = binomial.quantile(band.values, band.at[i], 0.5 * pointwise_level);
    // The upper quantile by symmetry, where small probabilities are summed without loss.
    band.upper[i] = band.values - binomial.quantile(band.values, 1 - band.at[i], 0.5 * pointwise_level);
  }
  band.pointwise_level = 1 - pointwise_level;
}

/// P(lower_i ≤ R_i ≤ upper_i for all i): R_{i+1} − R_i given R_i is binomial among the values still above.
double coverage_of(const Binomial& binomial, const EcdfBand& band) {
  const int n = band.values;
  std::vector<double> now(n + 1, 0.0), next;
  now[0] = 1;
  int low = 0, high = 0;
  double at = 0;
  for (Eigen::Index i = 0; i < band.at.size(); ++i) {
    const double share = (band.at[i] - at) / (1 - at);
    const double log_p = std::log(share), log_1_minus_p = std::log1p(-share);
    next.assign(n + 1, 0.0);
    for (int r = low; r <= high; ++r)
      for (int to = std::max(r, band.lower[i]); to <= band.upper[i]; ++to)
        next[to] += now[r] * binomial.probability(n - r, to - r, log_p, log_1_minus_p);
    now.swap(next);
    low = band.lower[i], high = band.upper[i], at = band.at[i];
  }
  double sum = 0;
  for (const double p : now) sum += p;
  return sum;
}

}  // namespace

EcdfBand simultaneous_ecdf_band(int n, int intervals, double level) {
  if (n < 2 || intervals < 2 || !(level > 0 && level < 1))
    throw UsageError(fmt::format(
        "ECDF band for {} values, {} intervals, level {}: at least 2, 2, and a level in (0, 1) are "
        "needed",
        n, intervals, level));
  const Binomial binomial(n);
  EcdfBand band;
  band.values = n;
  band.at = Eigen::VectorXd::LinSpaced(intervals - 1, 1, intervals - 1) / intervals;
  band.lower.resize(intervals - 1);
  band.upper.resize(intervals - 1);
  // Between Bonferroni's level, whose band is wide enough, and that of a single point, which is not.
  double wide = (1 - level) / (intervals - 1), narrow = 1 - level;
  for (int k = 0; k < 30 && narrow - wide > 1e-4 * wide; ++k) {
    const double middle = std::sqrt(wide * narrow);
    set_limits(binomial, middle, band);
    (coverage_of(binomial, band) >= level ? wide : narrow) = middle;
  }
  set_limits(binomial, wide, band);
  band.coverage = coverage_of(binomial, band);
  return band;
}

double EcdfBand::excess(std::span<const double> sample) const {
  if (std::ssize(sample) != values)
    throw UsageError(fmt::format("ECDF band is for {} values, {} are given", values, sample.size()));
  if (!std::all_of(sample.begin(), sample.end(), [](double u) { return u >= 0 && u <= 1; }))
    throw UsageError("ECDF band: a value lies outside [0, 1]");
  std::vector<double> sorted(sample.begin(), sample.end());
  std::sort(sorted.begin(), sorted.end());
  int worst = -values;
  for (Eigen::Index i = 0; i < at.size(); ++i) {
    const int count = std::upper_bound(sorted.begin(), sorted.end(), at[i]) - sorted.begin();
    worst = std::max({worst, lower[i] - count, count - upper[i]});
  }
  return static_cast<double>(worst) / values;
}

}  // namespace knothe::numerics
