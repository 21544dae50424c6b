#pragma once
/// @file The posterior of the parameters, as numbers.
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace knothe {

/// Whether an answer may be used (docs/explanation/verdict.md).
struct Verdict {
  enum class Level { ok, caution, reject } level = Level::ok;
  struct Reason {
    std::string code;  ///< computation, fit, range, model, bias, outlier
    Level level = Level::caution;
    std::string message;  ///< what it is, and what to do
  };
  std::vector<Reason> reasons;  ///< none where the level is ok
};

/// A posterior of d parameters: n weighted points and what follows from them. Moments, quantiles and evidence
/// are importance-corrected: correct also where the map is an approximation.
struct Posterior {
  std::vector<double> mean;                  ///< d
  std::vector<double> covariance;            ///< d × d
  std::vector<double> maximum_a_posteriori;  ///< d, maximises the density
  std::vector<double> levels;                ///< of the quantiles
  std::vector<double> quantiles;             ///< d × levels, marginal
  std::vector<double> points;                ///< n × d
  std::vector<double> weights;               ///< n, sum 1

  double log_evidence = 0;  ///< log ∫ density, natural logarithm
  int map_order = 0;        ///< of the transport map; 0: no map
  double variance_diagnostic =
      0;  ///< of the map, on points other than the training ones (Rubio et al. 2019, Eq. 9)
  double effective_sample_size = 1;  ///< of the weights, as a fraction of n
  bool tolerance_reached = true;     ///< variance_diagnostic is within the tolerance asked for
  /// Diagnostic ≤ 0.05, effective sample size ≥ 0.9, no second mode found; or, of draws without a map, an
  /// error of at most 0.1 standard deviations in a mean and 5 % in a standard deviation.
  bool trusted = true;
  std::string remark;  ///< why it, or its map, is not trusted, or the tolerance not reached; else empty
  Verdict verdict;     ///< of an assimilation; it rates the answer, not the map
  std::int64_t evaluations = 0;  ///< of the density of `solve_map`, as its budget counts them

  [[nodiscard]] std::size_t dimension() const { return mean.size(); }
  /// Standard deviation of parameter k.
  [[nodiscard]] double std(std::size_t k) const { return std::sqrt(covariance.at(k * dimension() + k)); }
};

}  // namespace knothe
