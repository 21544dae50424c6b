#include "knothe/posterior/map/solve/map_solver.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/numerics/integrate/sobol.hpp"
#include "knothe/posterior/differenced_density.hpp"
#include "knothe/posterior/map/solve/map_solver_workspace.hpp"

namespace knothe::posterior {

namespace {

void require(const MapSolverOptions& o) {
  if (!(o.tolerance > 0))
    throw UsageError(fmt::format("map solver: tolerance {} is not positive", o.tolerance));
  if (o.min_order < 1 || o.max_order < o.min_order || o.max_order > k_max_order)
    throw UsageError(fmt::format("map solver: orders {} to {} asked for; they must lie in 1 … {}",
                                 o.min_order, o.max_order, k_max_order));
  if (o.nodes_per_axis < 0) throw UsageError(fmt::format("map solver: {} nodes per axis", o.nodes_per_axis));
  if (o.verification_points < 16)
    throw UsageError(
        fmt::format("map solver: {} verification points; at least 16 are needed", o.verification_points));
}

/// Of N(0, L Lᵀ), each variable with all others held.
Eigen::VectorXd conditional_std(const Eigen::MatrixXd& lower) {
  const Eigen::MatrixXd inverse =
      lower.triangularView<Eigen::Lower>().solve(Eigen::MatrixXd::Identity(lower.rows(), lower.cols()));
  return inverse.colwise().norm().cwiseInverse().transpose();
}

}  // namespace

std::size_t MapSolver::Workspace::choose(CheckedDensity& target) {
  // The best by training, then any that training says to be better than what verification says of it.
  std::vector<std::size_t> by_training(tried);
  for (std::size_t i = 0; i < tried; ++i) by_training[i] = i;
  std::stable_sort(by_training.begin(), by_training.end(), [&](std::size_t i, std::size_t j) {
    return candidates[i].training_diagnostic < candidates[j].training_diagnostic;
  });
  std::size_t best = by_training.front();
  verify(target, candidates[best]);
  for (const std::size_t i : by_training) {
    if (!candidates[i].usable || candidates[best].verified_diagnostic <=
                                     std::max(options.tolerance, 1.5 * candidates[i].training_diagnostic))
      break;
    verify(target, candidates[i]);
    if (candidates[i].verified_diagnostic < candidates[best].verified_diagnostic) best = i;
  }
  for (std::size_t i = 0; i < tried; ++i)
    if (candidates[i].usable && candidates[i].verified_diagnostic >= 0 &&
        candidates[i].verified_diagnostic < candidates[best].verified_diagnostic)
      best = i;
  return best;
}

void MapSolver::Workspace::look_at_other_modes(CheckedDensity& target, MapResult& result) {
  MissedModesOptions look;
  look.level = options.search_modes;
  look.mode_mass = options.mode_mass;
  look.reference_spread = options.tempering_spread;
  look.seed = options.seed;
  look.max_moves = 3;  // the known mass is discounted: fewer particles, less far, find the rest
  result.missed = look_for_missed_modes(target, result, mode_search, modes, look);
  result.second_mode_found = result.missed.found;
  result.second_mode = result.missed.mode;
}

MapSolver::MapSolver(MapSolverOptions options) {
  require(options);
  if (!(options.decrease_tolerance > 0)) options.decrease_tolerance = 1e-3 * options.tolerance;
  work_ = std::make_unique<Workspace>(std::move(options));
}
MapSolver::~MapSolver() = default;
MapSolver::MapSolver(MapSolver&&) noexcept = default;
MapSolver& MapSolver::operator=(MapSolver&&) noexcept = default;
const MapSolverOptions& MapSolver::options() const {
  return work_->options;
}

bool MapSolver::Workspace::may_be_long(Index d) const {
  return options.long_first_variable && d >= 2 && d <= k_max_long && !options.family &&
         options.nodes_per_axis == 0 && options.max_order > k_first_long;
}

void MapSolver::prepare(Index dimension) {
  Workspace& work = *work_;
  for (int order = work.options.min_order; order <= work.options.max_order; ++order) {
    MapShape& shape = work.shapes.of_order(dimension, order, work.options.parametrisation);
    if (shape.identity.coefficients().size() > k_last_prepared_size) return;
    work.shapes.prepare(shape, order <= k_last_prepared_broad);
  }
}

MapResult MapSolver::solve(LogDensity& target) {
  MapResult result;
  solve(target, result);
  return result;
}

void MapSolver::solve(LogDensity& user_target, MapResult& result) {
  Workspace& work = *work_;
  const auto& options = work.options;
  if (user_target.dimension() < 1 || user_target.dimension() > numerics::k_sobol_max_dimension)
    throw UsageError(fmt::format("map solver: a density in {} dimensions; 1 to {} are possible",
                                 user_target.dimension(), numerics::k_sobol_max_dimension));
  CheckedDensity searched(user_target);
  work.mode_search.run(searched, options.search_modes != ModeSearchLevel::none, work.modes, options.scan);
  const Mode& main = work.modes.front();
  result.mode = main.point;
  result.mode_log_density = main.value;
  for (const Mode& mode : work.modes)
    if (mode.value > result.mode_log_density) result.mode = mode.point, result.mode_log_density = mode.value;
  AffineMap laplace;
  laplace.shift = main.point;
  laplace.lower = main.lower;
  // By differences a map takes a thousandth of the values that it takes without derivatives.
  std::optional<DifferencedDensity> differenced;
  if (user_target.available_derivatives() == 0 && options.minimiser != MinimiserKind::nelder_mead)
    differenced.emplace(user_target, conditional_std(main.lower));
  LogDensity& trained = differenced ? *differenced : user_target;
  CheckedDensity target(trained);
  result.iterations = 0;
  work.tried = 0;
  work.tempered_evaluations = 0;

  Workspace::Climb climb = work.climb(target, result, laplace, options.parametrisation, options.orientation,
                                      options.min_order, -1);
  if (!climb.reached && work.may_be_long(user_target.dimension())) {
    climb = work.climb_long(target, result,
                            options.orientation == Orientation::given ? laplace : principal_axes(laplace));
  }
  const bool falls_back = !climb.reached && options.fallback;
  if (falls_back) (void)work.fall_back(trained, target, result, laplace);

  auto& candidate = work.candidates[work.choose(target)];
  work.report(candidate, result);
  result.reason.clear();
  if (!result.tolerance_reached)
    result.reason = fmt::format(
        "the variance diagnostic is {:.2g} at order {} on points not used for training, {:.2g} on the "
        "training rule, above "
        "the tolerance {:.2g}; {}",
        result.verified_diagnostic, result.order, result.training_diagnostic, options.tolerance,
        climb.no_longer_falls ? "higher orders no longer lower it"
                              : fmt::format("order {} is the highest allowed", options.max_order));
  result.method = describe_method(result.map.parametrisation(), result.pre_map);
  if (candidate.is_long) result.method += fmt::format(", order {} in the first variable", result.order);
  if (falls_back && work.standard_diagnostic > options.tolerance)
    result.method += fmt::format("; the standard way reached {:.2g}, {}", work.standard_diagnostic,
                                 result.verified_diagnostic < work.standard_diagnostic
                                     ? "this is the best of the others tried"
                                     : "none of the others tried did better");
  work.look_at_other_modes(searched, result);
  result.density_evaluations =
      searched.evaluations() + (differenced ? differenced->evaluations()  // tempered ones too
                                            : target.evaluations() + work.tempered_evaluations);
}

void MapSolver::Workspace::report(Candidate& candidate, MapResult& result) {
  result.pre_map = candidate.pre_map;
  result.map = candidate.shape->identity;
  result.map.set_coefficients(candidate.coefficients);
  result.order = candidate.order;
  result.training_diagnostic = candidate.training_diagnostic;
  result.verified_diagnostic = candidate.verified_diagnostic;
  result.training_objective = candidate.training_objective;
  result.verified_objective = candidate.verified_objective;
  result.tolerance_reached = candidate.verified_diagnostic <= options.tolerance;
  result.diagnostic_by_order.clear();
  result.objective_by_order.clear();
  int next = options.min_order;  // the way to the map chosen: those that do not belong to it are left out
  for (std::size_t i = 0; i < tried; ++i) {
    const Candidate& c = candidates[i];
    const bool same = c.shape->identity.parametrisation() == result.map.parametrisation() && c.usable;
    const auto &here = c.pre_map.rotation, &chosen = result.pre_map.rotation;
    const bool same_axes = c.order == 1 || (here.size() == chosen.size() && here == chosen);
    const bool in_order = c.is_long || c.order == next;
    if (!same || !same_axes || c.is_long != candidate.is_long || !in_order) continue;
    ++next;
    result.diagnostic_by_order.push_back(c.training_diagnostic);
    result.objective_by_order.push_back(c.training_objective);
  }
  std::swap(result.verification, candidate.verification);
  candidate.verified_diagnostic = -1;
}

ComposedMap MapResult::composed() const {
  ComposedMap both(map.dimension());
  both.append(pre_map);
  both.append(map);
  return both;
}

Eigen::MatrixXd MapResult::evaluate(const Eigen::Ref<const Eigen::MatrixXd>& reference) const {
  return composed().evaluate(reference);
}
Eigen::MatrixXd MapResult::inverse(const Eigen::Ref<const Eigen::MatrixXd>& z) const {
  return composed().inverse(z);
}
Eigen::VectorXd MapResult::log_density(const Eigen::Ref<const Eigen::MatrixXd>& z) const {
  return composed().log_density(z);
}

}  // namespace knothe::posterior
