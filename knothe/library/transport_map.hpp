#pragma once
/// @file Transport maps: of a density given as a function, and of samples (docs/explanation/transport.md).
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "knothe/library/export.hpp"
#include "knothe/library/posterior.hpp"

namespace knothe {

/// A probability density on R^d, known by its logarithm up to a constant.
struct Density {
  std::size_t dimension = 0;
  /// log density at a point (d); −∞ where the density is zero.
  std::function<double(std::span<const double> point)> log_value;
  /// Its gradient, into d numbers. May be empty; the solver then needs more evaluations.
  std::function<void(std::span<const double> point, std::span<double> gradient)> gradient = {};
};

struct MapOptions {
  double tolerance = 1e-3;  ///< on the variance diagnostic
  int max_order = 8;        ///< 1 … 23
  std::uint64_t seed = 1;
  /// The parameters are standardised: roughly N(0, I) before the data. If false, nothing is assumed about
  /// their scale.
  bool standardised = true;
  /// The map is triangular in the given order of the variables: `conditional_sample` needs that. If
  /// false, it may be rotated to the principal axes, where a lower order is often enough.
  bool triangular = false;
  /// Budget: values of the density that may be asked for, a gradient counting as four. 0: 100,000.
  std::int64_t evaluations = 0;
  double seconds = 0;  ///< time limit, kept like `evaluations`; 0: none
};

struct SampleMapOptions {
  int max_order = 5;       ///< of each component, chosen below that by cross-validation
  int folds = 5;           ///< of the cross-validation; 0: every component gets max_order
  std::uint64_t seed = 1;  ///< shuffles samples into folds
};

/// A distribution as an invertible function T of a standard normal variable: T(x), x ~ N(0, I).
/// Points are m × d, point after point. Errors of all functions: UsageError for sizes that do not fit.
class KNOTHE_EXPORT TransportMap {
 public:
  /// From samples (m × dimension): maximum likelihood, component by component. Errors: UsageError for options
  /// that make no sense, DataError for values that are not finite, a coordinate without spread, too few
  /// samples.
  [[nodiscard]] static TransportMap from_samples(std::span<const double> samples, std::size_t dimension,
                                                 const SampleMapOptions& options = {});

  [[nodiscard]] std::size_t dimension() const;
  [[nodiscard]] std::vector<double> evaluate(std::span<const double> reference) const;  ///< T(x), m × d
  [[nodiscard]] std::vector<double> inverse(std::span<const double> points) const;      ///< T⁻¹(z), m × d
  [[nodiscard]] std::vector<double> log_density(std::span<const double> points) const;  ///< of T(x) at z, m
  /// `count` independent draws, count × d.
  [[nodiscard]] std::vector<double> sample(std::size_t count, std::uint64_t seed) const;
  /// `count` draws of all coordinates with the first ones equal to `given`. From samples of (data,
  /// parameters) and measured data: samples of the posterior, without a likelihood. Errors: UsageError for a
  /// map that is not triangular.
  [[nodiscard]] std::vector<double> conditional_sample(std::span<const double> given, std::size_t count,
                                                       std::uint64_t seed) const;
  /// Writes the map to a file (HDF5, docs/reference/formats.md), whole or not at all. Errors: IoError.
  void save(const std::string& path) const;
  /// The map of such a file, bit-identical. Errors: DataError, naming file and data set, for a file that is
  /// missing, damaged or of another kind.
  [[nodiscard]] static TransportMap load(const std::string& path);
  /// Whether its computation ended as it should: from samples, every fit converged; of a density, as its
  /// `Posterior`. `save` keeps the answer; true for files of `knothe infer`, which says it elsewhere.
  [[nodiscard]] bool trusted() const;
  [[nodiscard]] const std::string& remark() const;  ///< why not, or the tolerance not reached; else empty
  /// For people: the parts of the map, their orders and numbers of coefficients.
  [[nodiscard]] std::string describe() const;

  struct Implementation;
  explicit TransportMap(std::shared_ptr<const Implementation> implementation)
      : implementation_(std::move(implementation)) {}

 private:
  std::shared_ptr<const Implementation> implementation_;
};

/// The result of `solve_map`: the map, and the posterior computed with it.
struct MapSolution {
  TransportMap map;
  Posterior posterior;
};

/// Finds the mode, then maps of rising order until one is good on points that were not used to train it, then
/// weights its points. If no map is accurate enough and a gradient exists, the solver samples a few variables
/// and treats the others as Gaussian given those; `remark` then says so. In many variables a low `max_order`
/// saves time then. Where the budget ends before a map is trusted, the answer is that of the best map so far
/// or of weighted draws, and `remark` says with what budget the same call goes on. The density need not be
/// normalised; its integral is the evidence. Errors: UsageError for a density without dimension or value, or,
/// if it is `standardised`, with a gradient that is not its own, and for a negative budget; NumericalError
/// for one that gives NaN or is zero wherever it was tried, and for a budget too small for any answer.
[[nodiscard]] KNOTHE_EXPORT MapSolution solve_map(const Density& density, const MapOptions& options = {});

}  // namespace knothe
