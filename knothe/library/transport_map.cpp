#include "knothe/library/transport_map.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <optional>
#include <utility>

#include "knothe/base/cancellation.hpp"
#include "knothe/library/function_density.hpp"
#include "knothe/library/plain.hpp"
#include "knothe/numerics/statistics/weighted_statistics.hpp"
#include "knothe/posterior/budget_spent.hpp"
#include "knothe/posterior/draws/nested_laplace.hpp"
#include "knothe/posterior/map/map_file.hpp"
#include "knothe/posterior/map/samples/map_distribution.hpp"
#include "knothe/posterior/map/samples/sample_map.hpp"
#include "knothe/posterior/solve.hpp"

namespace knothe {

using library::FunctionDensity, library::plain, library::rows_of, library::vector_of;

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

/// Weighted draws of what is left of the budget, around `modes` where draws from N(0, I) do not lead to the
/// mass. Nothing where they come to nothing either.
std::optional<posterior::RecycledImportanceResult> draws_of_the_rest(
    FunctionDensity& target, const std::vector<posterior::Mode>& modes, std::uint64_t seed) {
  posterior::RecycledImportanceOptions options;
  options.max_evaluations = target.budget();
  options.spent = [&] { return target.spent(); };
  options.draws = std::clamp<std::int64_t>((target.budget() - target.spent()) / 3, 1, options.draws);
  options.seed = seed;
  options.modes = modes;
  try {
    return posterior::recycled_importance(target, options);
  } catch (const NumericalError&) {
    return std::nullopt;
  }
}

/// Where ascents lead, as far as the budget goes.
std::vector<posterior::Mode> modes_of(FunctionDensity& target, posterior::ScanReach scan) {
  std::vector<posterior::Mode> modes;
  try {
    posterior::CheckedDensity checked(target);
    posterior::ModeSearch().run(checked, true, modes, scan);
  } catch (const posterior::BudgetSpent&) {
  }
  return modes;
}

posterior::MapResult solve_and_correct(FunctionDensity& target, const posterior::MapSolverOptions& settings,
                                       posterior::Posterior& r) {
  posterior::MapSolver solver(settings);
  posterior::MapResult solved = solver.solve(target);
  posterior::set_from_map(solved, solver.correct(target, solved), as_they_are, r);
  r.maximum_a_posteriori = solved.mode;
  return solved;
}

/// The best map that the budget allows: the calls made are known, and the same way again, less far, asks for
/// few more. What is left is for draws.
std::optional<posterior::MapResult> map_within_budget(FunctionDensity& target,
                                                      posterior::MapSolverOptions settings,
                                                      posterior::Posterior& r) {
  constexpr double k_of_map = 0.66, k_of_lower_orders = 0.83;
  target.limit_to(k_of_map);
  try {
    return solve_and_correct(target, settings, r);
  } catch (const posterior::BudgetSpent&) {
  }
  target.limit_to(k_of_lower_orders);
  settings.search_modes = posterior::ModeSearchLevel::multi_start;
  settings.fallback = settings.long_first_variable = false;
  settings.max_points = 4 * settings.verification_points;
  for (; settings.max_order > 0; settings.max_order /= 2) {
    try {
      return solve_and_correct(target, settings, r);
    } catch (const posterior::BudgetSpent&) {
    }
  }
  return std::nullopt;
}

/// The Gaussian of these moments, as a map.
posterior::ComposedMap gaussian_map(const posterior::Posterior& r) {
  Eigen::MatrixXd covariance = r.covariance;
  covariance.diagonal().array() *= 1 + 1e-10;
  posterior::ComposedMap map(r.mean.size());
  map.append(posterior::AffineMap{r.mean, covariance.llt().matrixL()});
  return map;
}

/// Where the budget was too small for a map, or for a trusted one: weighted draws. `has_map`: it is in `r`.
void answer_by_draws(FunctionDensity& target, const posterior::MapSolverOptions& settings, bool has_map,
                     posterior::Posterior& r) {
  const std::vector<posterior::Mode> modes = modes_of(target, settings.scan);
  const auto draws = draws_of_the_rest(target, modes, settings.seed);
  if (!draws && !has_map)
    throw posterior::BudgetSpent(fmt::format("{}; there is no answer yet", target.in_words()));
  if (!draws || (has_map && !posterior::trust_of(*draws, draws->temperatures.back()).trusted)) return;
  const std::string why =
      has_map ? fmt::format("the map is not trusted ({})", r.remark) : "the budget was too small for a map";
  const Eigen::VectorXd best = has_map ? r.maximum_a_posteriori : Eigen::VectorXd();
  posterior::set_from_draws(*draws, as_they_are, draws->temperatures.back(), r);
  r.maximum_a_posteriori = has_map ? best : modes.empty() ? r.mean : modes.front().point;
  r.remark = fmt::format(
      "{}; the posterior is by weighted draws: a mean is off by at most {:.2f} standard deviations, a "
      "standard deviation by {:.1f} %{}{}",
      why, draws->mean_error, 100 * draws->deviation_error, r.remark.empty() ? "" : "; ", r.remark);
}

}  // namespace

MapSolution solve_map(const Density& density, const MapOptions& options) {
  constexpr std::int64_t k_budget = 100'000;  // as of `infer` by a map
  if (density.dimension == 0 || !density.log_value)
    throw UsageError("solve_map: a density needs a dimension of at least 1 and the function log_value");
  if (options.evaluations < 0 || !(options.seconds >= 0))
    throw UsageError(fmt::format("solve_map: {} evaluations and {} s; neither may be negative",
                                 options.evaluations, options.seconds));
  FunctionDensity target(density, options.evaluations > 0 ? options.evaluations : k_budget, options.seconds);
  if (density.gradient && options.standardised) library::check_gradient(target);
  posterior::MapSolverOptions settings;
  settings.tolerance = options.tolerance;
  settings.max_order = options.max_order;
  settings.seed = options.seed;
  settings.scan = options.standardised ? posterior::ScanReach::near : posterior::ScanReach::wide;
  if (options.triangular) settings.orientation = posterior::Orientation::given;
  posterior::Posterior r;
  const std::optional<posterior::MapResult> solved = map_within_budget(target, settings, r);
  const bool trusted = solved && r.trusted;
  const std::string remark = r.remark;
  target.limit_to(1);
  if (solved && !trusted && !solved->second_mode_found && density.gradient && density.dimension > 1)
    answer_by_few_variables_first(target, options.seed, r);
  if (target.is_spent() && !(solved && r.trusted)) answer_by_draws(target, settings, solved.has_value(), r);
  if (target.is_spent() && !r.trusted) r.remark += "; " + target.in_words();
  TransportMap map(std::make_shared<TransportMap::Implementation>(TransportMap::Implementation{
      posterior::MapDistribution(solved ? solved->composed() : gaussian_map(r)), trusted,
      solved ? remark : "the budget was too small for a map: this is the Gaussian of the draws' moments"}));
  MapSolution solution{std::move(map), plain(r)};
  solution.posterior.evaluations = target.spent();
  return solution;
}

}  // namespace knothe
