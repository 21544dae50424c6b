#pragma once
/// @file Sequential Bayesian data assimilation with a reduced model (Rubio et al. 2019;
/// docs/explanation/assimilation.md).
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "knothe/library/export.hpp"
#include "knothe/library/posterior.hpp"

namespace knothe {

/// What is measured: n displacements, and series behind them.
struct Sensors {
  std::vector<double> points;   ///< n × 3, m
  std::vector<int> components;  ///< n: 0 x, 1 y, 2 z
  /// Outputs or quantities of the model, by name (a reaction force, a temperature), in their units.
  std::vector<std::string> series = {};
  /// Number of values of a datum.
  [[nodiscard]] std::size_t size() const { return components.size() + series.size(); }
};

/// Gaussian noise of the n values of a datum: independent, or correlated as that of image correlation.
struct Noise {
  std::vector<double> std;  ///< n, m; empty where `precision` is given
  /// Inverse covariance, n × n, both triangles, 1/m²: compressed sparse rows.
  struct Precision {
    std::vector<double> values;
    std::vector<std::int64_t> columns, row_begin;  ///< of each value; n + 1
  } precision = {};
  [[nodiscard]] bool empty() const { return std.empty() && precision.row_begin.empty(); }
};

/// The measurements of all sensors at one time.
struct Datum {
  std::size_t step = 0;        ///< index of its time in the model's
  std::vector<double> values;  ///< n, m; NaN: missing
  Noise noise = {};            ///< of this datum; empty: that of the assimilation
};

/// The prior density of a parameter. Every prior is truncated to the model's parameter box and
/// renormalised.
struct Prior {
  enum class Family { normal, uniform, lognormal, posterior };
  std::string parameter;  ///< the model's name of it
  Family family = Family::normal;
  double first = 0, second = 1;  ///< mean and std; lower and upper; mean and std of the logarithm
  std::string results = {}, name_there = {};  ///< of a posterior

  [[nodiscard]] static Prior normal(std::string parameter, double mean, double std) {
    return {std::move(parameter), Family::normal, mean, std};
  }
  [[nodiscard]] static Prior uniform(std::string parameter, double lower, double upper) {
    return {std::move(parameter), Family::uniform, lower, upper};
  }
  [[nodiscard]] static Prior lognormal(std::string parameter, double mu, double sigma) {
    return {std::move(parameter), Family::lognormal, mu, sigma};
  }
  /// What an earlier test has found of its parameter `name` (empty: the same name): `results` is a folder of
  /// results. Parameters of one folder keep their correlations.
  [[nodiscard]] static Prior posterior(std::string parameter, std::string results, std::string name = "") {
    return {std::move(parameter), Family::posterior, 0, 1, std::move(results), std::move(name)};
  }
};

struct AssimilationOptions {
  double tolerance = 1e-3;  ///< on the variance diagnostic of the maps
  int max_order = 8;        ///< of the maps
  std::uint64_t seed = 1;
};

/// Data in, one by one and in any order; posterior out, each time. It depends on the set of data alone: a
/// datum that is withdrawn leaves no trace, to the bit. One object serves one thread.
class KNOTHE_EXPORT Assimilation {
 public:
  /// `model_file`: a reduced model (HDF5, `knothe offline` or `knothe model import`). `priors`: one for each
  /// of its parameters, in the order in which posteriors give them. Errors: DataError for a file that is
  /// missing or damaged and for sensors outside the model; ProjectError for priors that are not those of the
  /// model's parameters; UsageError for sizes that do not fit.
  Assimilation(const std::string& model_file, const Sensors& sensors, const Noise& noise,
               const std::vector<Prior>& priors, const AssimilationOptions& options = {});
  ~Assimilation();
  Assimilation(Assimilation&&) noexcept;
  Assimilation& operator=(Assimilation&&) noexcept;

  [[nodiscard]] std::vector<double> times() const;       ///< the model's
  [[nodiscard]] std::vector<std::size_t> steps() const;  ///< assimilated, increasing
  /// The noise-free values of the sensors, n, at parameters p (d) and a step. Errors: UsageError outside the
  /// parameter box.
  [[nodiscard]] std::vector<double> predict(std::span<const double> p, std::size_t step) const;

  /// Adds a datum; the posterior given all data so far. Errors: UsageError for a step that has a datum
  /// already or that the model does not have, and where the numbers of values and of sensors differ.
  Posterior assimilate(const Datum& datum);
  /// Removes the datum of this step; the posterior given the others. Errors: UsageError for a step without
  /// one.
  Posterior withdraw(std::size_t step);

 private:
  struct Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace knothe
