#include "knothe/library/transport_map.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "knothe/base/cancellation.hpp"
#include "knothe/library/plain.hpp"
#include "knothe/numerics/statistics/random.hpp"
#include "knothe/numerics/statistics/weighted_statistics.hpp"
#include "knothe/posterior/draws/nested_laplace.hpp"
#include "knothe/posterior/map/map_file.hpp"
#include "knothe/posterior/map/samples/map_distribution.hpp"
#include "knothe/posterior/map/samples/sample_map.hpp"
#include "knothe/posterior/solve.hpp"

namespace knothe {

using library::plain, library::rows_of, library::vector_of;

/// A map of a density goes from the reference to the points, one of samples the other way.
struct TransportMap::Implementation {
  std::variant<posterior::MapDistribution, posterior::SampleMap> map;
  bool trusted = true;
  std::string remark = {};
  [[nodiscard]] std::size_t dimension() const {
    return std::visit([](const auto& m) { return static_cast<std::size_t>(m.dimension()); }, map);
  }
};

TransportMap TransportMap::from_samples(std::span<const double> samples, std::size_t dimension,
                                        const SampleMapOptions& options) {
  posterior::SampleMapOptions settings;
  settings.max_order = options.max_order;
  settings.folds = options.folds;
  settings.seed = options.seed;
  posterior::SampleMap map =
      posterior::map_from_samples(rows_of(samples, dimension, "map from samples"), settings);
  const bool converged = map.converged;
  std::string reason = map.reason;
  return TransportMap(
      std::make_shared<Implementation>(Implementation{std::move(map), converged, std::move(reason)}));
}

std::size_t TransportMap::dimension() const {
  return implementation_->dimension();
}

bool TransportMap::trusted() const {
  return implementation_->trusted;
}

const std::string& TransportMap::remark() const {
  return implementation_->remark;
}

namespace {

/// What `call` gives of the points, block by block: Ctrl-C is heard in between, and no more than a block is
/// copied.
template <class Call>
std::vector<double> by_blocks(std::span<const double> points, std::size_t dimension, const char* what,
                              const Call& call) {
  constexpr std::size_t k_points = 1 << 14;
  if (points.size() % dimension != 0) (void)rows_of(points, dimension, what);  // says so
  std::vector<double> result;
  result.reserve(points.size());
  for (std::size_t at = 0; at < points.size(); at += k_points * dimension) {
    check_cancellation("nothing is kept of the points so far");
    const auto block = points.subspan(at, std::min(k_points * dimension, points.size() - at));
    const std::vector<double> values = plain(call(rows_of(block, dimension, what)));
    result.insert(result.end(), values.begin(), values.end());
  }
  return result;
}

}  // namespace

std::vector<double> TransportMap::evaluate(std::span<const double> reference) const {
  const auto* forward = std::get_if<posterior::MapDistribution>(&implementation_->map);
  return by_blocks(reference, dimension(), "points of the reference", [&](const Eigen::MatrixXd& x) {
    return forward ? forward->map().evaluate(x) : std::get<1>(implementation_->map).map.inverse(x);
  });
}

std::vector<double> TransportMap::inverse(std::span<const double> points) const {
  const auto* forward = std::get_if<posterior::MapDistribution>(&implementation_->map);
  return by_blocks(points, dimension(), "points", [&](const Eigen::MatrixXd& z) {
    return forward ? forward->map().inverse(z) : std::get<1>(implementation_->map).map.evaluate(z);
  });
}

std::vector<double> TransportMap::log_density(std::span<const double> points) const {
  return by_blocks(points, dimension(), "points", [&](const Eigen::MatrixXd& z) {
    return std::visit([&](const auto& map) -> Eigen::VectorXd { return map.log_density(z); },
                      implementation_->map);
  });
}

std::vector<double> TransportMap::sample(std::size_t count, std::uint64_t seed) const {
  return conditional_sample({}, count, seed);
}

std::vector<double> TransportMap::conditional_sample(std::span<const double> given, std::size_t count,
                                                     std::uint64_t seed) const {
  const auto reference = [&](const auto& map) {
    return plain(map.conditional_reference(vector_of(given), count, seed));
  };
  std::vector<double> draws = evaluate(std::visit(reference, implementation_->map));
  for (std::size_t i = 0; i < count; ++i)  // to the bit
    std::copy(given.begin(), given.end(), draws.begin() + i * dimension());
  return draws;
}

namespace {

/// Which way the map of a file goes; files without it, as those of `knothe infer`, hold maps of densities.
constexpr const char* k_direction = "direction";
constexpr const char* k_to_reference = "to the reference";
/// What is said of a map that is not trusted, and of any other that has something to be said.
constexpr const char* k_doubt = "doubt";
constexpr const char* k_remark = "remark";

}  // namespace

void TransportMap::save(const std::string& path) const {
  posterior::MapMetadata metadata;
  if (!trusted() || !remark().empty()) metadata[trusted() ? k_remark : k_doubt] = remark();
  if (const auto* forward = std::get_if<posterior::MapDistribution>(&implementation_->map))
    return posterior::save_map(path, forward->map(), metadata);
  metadata[k_direction] = k_to_reference;
  posterior::save_map(path, std::get<1>(implementation_->map).map, metadata);
}

TransportMap TransportMap::load(const std::string& path) {
  posterior::StoredMap stored = posterior::load_map(path);
  const bool trusted = !stored.metadata.contains(k_doubt);
  const std::string remark = stored.metadata[trusted ? k_remark : k_doubt];
  if (stored.metadata[k_direction] != k_to_reference)
    return TransportMap(std::make_shared<Implementation>(
        Implementation{posterior::MapDistribution(std::move(stored.map)), trusted, remark}));
  posterior::SampleMap map;
  map.map = std::move(stored.map);
  return TransportMap(std::make_shared<Implementation>(Implementation{std::move(map), trusted, remark}));
}

std::string TransportMap::describe() const {
  const auto* forward = std::get_if<posterior::MapDistribution>(&implementation_->map);
  return forward ? forward->map().describe() : std::get<1>(implementation_->map).map.describe();
}

namespace {

/// The caller's functions as the solver wants them: many points at once.
class FunctionDensity final : public posterior::LogDensity {
 public:
  explicit FunctionDensity(const Density& density)
      : density_(&density), point_(density.dimension), slope_(point_) {}
  [[nodiscard]] Eigen::Index dimension() const override { return std::ssize(point_); }
  [[nodiscard]] int available_derivatives() const override { return density_->gradient ? 1 : 0; }
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives,
                posterior::LogDensityBatch& out) override {
    for (Eigen::Index i = 0; i < points.rows(); ++i) {
      for (Eigen::Index k = 0; k < dimension(); ++k) point_[k] = points(i, k);
      out.value[i] = density_->log_value(point_);
      if (derivatives < 1) continue;
      density_->gradient(point_, slope_);
      out.gradient.row(i) = Eigen::Map<const Eigen::RowVectorXd>(slope_.data(), dimension());
    }
  }

 private:
  const Density* density_;
  std::vector<double> point_, slope_;
};

/// By how much a slope differs from central differences of the log-density in steps of 1e-4, 1e-3 and 1e-2;
/// 0 unless all of them differ in the same sense: a noisy or coarsely rounded density is off in any.
double slope_error(const Density& density, std::vector<double>& point, std::size_t k, double slope) {
  double least = INFINITY;
  bool above = false, below = false;
  const double at = point[k];
  for (const double step : {1e-4, 1e-3, 1e-2}) {
    point[k] = at + step;
    const double up = density.log_value(point);
    point[k] = at - step;
    const double error = slope - (up - density.log_value(point)) / (2 * step);
    (error > 0 ? above : below) = true;
    if (!(std::abs(error) >= least)) least = std::abs(error);
  }
  point[k] = at;
  return above != below && std::isfinite(least) ? least : 0;
}

/// A forgotten sign or factor: a wrong gradient is met by no map, after minutes. Asked at five points of
/// N(0, I); wrong where a component is off by a fifth and more at three of them. Errors: UsageError.
void check_gradient(const Density& density) {
  constexpr int k_points = 5, k_wrong = 3;
  constexpr double k_share = 0.2, k_of_steepest = 0.1;
  const Eigen::MatrixXd points = numerics::monte_carlo_normal_points(k_points, density.dimension, 1);
  std::vector<double> point(density.dimension), slope(density.dimension);
  std::vector<int> wrong(density.dimension, 0);
  for (Eigen::Index i = 0; i < k_points; ++i) {
    std::copy(points.row(i).begin(), points.row(i).end(), point.begin());
    if (!std::isfinite(density.log_value(point))) continue;
    density.gradient(point, slope);
    double steepest = 0;
    for (const double s : slope) steepest = std::max(steepest, std::abs(s));
    for (std::size_t k = 0; k < point.size(); ++k) {
      const double error = slope_error(density, point, k, slope[k]);
      if (error > std::max({k_share * std::abs(slope[k]), k_of_steepest * steepest, 1e-6})) ++wrong[k];
      if (wrong[k] == k_wrong)
        throw UsageError(
            fmt::format("the gradient is not that of the log-density: at ({:.4g}) its component {} is "
                        "{:.4g}, off by {:.2g} "
                        "from differences of the log-density",
                        fmt::join(point, ", "), k, slope[k], error));
    }
  }
}

Eigen::MatrixXd as_they_are(const Eigen::MatrixXd& points) {
  return points;
}

/// What no map represents may be nearly Gaussian once a few variables are known: then these answers instead
/// of the map's own, if they are good. `posterior` is not trusted.
void answer_by_few_variables_first(posterior::LogDensity& target, std::uint64_t seed,
                                   posterior::Posterior& r) {
  posterior::NestedLaplaceOptions options;
  options.seed = seed;
  posterior::NestedLaplaceResult draws;
  try {
    draws = posterior::nested_laplace(target, options);
  } catch (const NumericalError&) {  // no mass where it looks: the map's answer stays
    return;
  }
  if (!draws.converged) return;
  const posterior::WeightedSample& sample = draws.sample;
  r.points = sample.points;
  r.weights = sample.weights;
  r.summarise();
  r.quantiles = numerics::weighted_quantiles(sample.points, sample.weights);
  r.log_evidence = sample.log_evidence;
  r.effective_sample_size = sample.effective_size / sample.weights.size();
  r.set_trust(
      {.trusted = true, .figures = {}, .reason = {}},
      fmt::format(
          "the map is not trusted ({}); the posterior is by weighted draws, variable{} {} first: a mean is "
          "off by at most {:.2f} standard deviations, a standard deviation by {:.1f} %",
          r.remark, draws.first.size() > 1 ? "s" : "", fmt::join(draws.first, ", "), draws.mean_error,
          100 * draws.deviation_error));
}

}  // namespace

MapSolution solve_map(const Density& density, const MapOptions& options) {
  if (density.dimension == 0 || !density.log_value)
    throw UsageError("solve_map: a density needs a dimension of at least 1 and the function log_value");
  if (density.gradient && options.standardised) check_gradient(density);
  posterior::MapSolverOptions settings;
  settings.tolerance = options.tolerance;
  settings.max_order = options.max_order;
  settings.seed = options.seed;
  settings.scan = options.standardised ? posterior::ScanReach::near : posterior::ScanReach::wide;
  if (options.triangular) settings.orientation = posterior::Orientation::given;
  posterior::MapSolver solver(settings);
  FunctionDensity target(density);
  const posterior::MapResult solved = solver.solve(target);
  posterior::Posterior r;
  posterior::set_from_map(solved, solver.correct(target, solved), as_they_are, r);
  r.maximum_a_posteriori = solved.mode;
  TransportMap map(std::make_shared<TransportMap::Implementation>(
      TransportMap::Implementation{posterior::MapDistribution(solved.composed()), r.trusted, r.remark}));
  if (!r.trusted && !solved.second_mode_found && density.gradient && density.dimension > 1)
    answer_by_few_variables_first(target, options.seed, r);
  return {std::move(map), plain(r)};
}

}  // namespace knothe
