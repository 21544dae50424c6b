#include "knothe/transport/map_solver.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>

#include "knothe/base/error.hpp"
#include "knothe/numerics/sobol.hpp"
#include "knothe/transport/map_solver_workspace.hpp"

namespace knothe::transport {

namespace {

constexpr std::uint64_t k_training_seed = 0x7261696e;  // never that of the verification points

/// Symmetric quasi-random points whose mean is exactly 0 and whose covariance is exactly the identity, so
/// that a Gaussian target has exactly its affine map.
numerics::PointRule quasi_random_rule(Eigen::Index n, Eigen::Index d) {
  Eigen::MatrixXd points(n, d);
  points.topRows(n / 2) = numerics::sobol_normal_points(n / 2, d, k_training_seed);
  points.bottomRows(n / 2) = -points.topRows(n / 2);
  const Eigen::MatrixXd covariance = points.transpose() * points / static_cast<double>(n);
  const Eigen::MatrixXd white = covariance.llt().matrixL().solve(points.transpose());
  return {white.transpose(), Eigen::VectorXd::Constant(n, 1.0 / static_cast<double>(n))};
}

/// The training rule is chosen with the order: 2p + 4 Gauss–Hermite nodes per axis in up to three dimensions,
/// nodes of negligible weight dropped (they only stall the minimiser); beyond, twelve quasi-random points per
/// coefficient of the last component.
numerics::PointRule training_rule(Eigen::Index d, int order) {
  if (d <= 3) return numerics::tensor_rule(numerics::gauss_hermite(2 * order + 4), d, 1e-11);
  const auto last =
      total_order_count(static_cast<int>(d) - 1, order) + total_order_count(static_cast<int>(d), order - 1);
  Eigen::Index n = 1024;
  while (n < 12 * last) n *= 2;
  return quasi_random_rule(n, d);
}

void require(const MapSolverOptions& o) {
  if (!(o.tolerance > 0))
    throw UsageError(fmt::format("map solver: tolerance {} is not positive", o.tolerance));
  if (o.min_order < 1 || o.max_order < o.min_order || o.max_order > k_max_order)
    throw UsageError(fmt::format("map solver: orders {} to {} asked for; they must lie in 1 … {}",
                                 o.min_order, o.max_order, k_max_order));
  if (o.verification_points < 16)
    throw UsageError(
        fmt::format("map solver: {} verification points; at least 16 are needed", o.verification_points));
}

}  // namespace

void diagnose(const Eigen::VectorXd& log_weight, double& diagnostic, double& objective) {
  const double floor = log_weight.maxCoeff() - 1000;
  const auto clipped = log_weight.array().cwiseMax(floor);
  const double mean = clipped.mean();
  objective = -mean;
  diagnostic = 0.5 * (clipped - mean).square().mean();
}

const TriangularMap& MapSolver::Workspace::identity(Eigen::Index d, int order) {
  auto [at, made] = identities.try_emplace({d, order});
  if (made) at->second = TriangularMap(d, order, options.radii);
  return at->second;
}

const TrainingTables& MapSolver::Workspace::training_tables(Eigen::Index d, int order) {
  auto& tables = training[{d, order}];
  if (!tables)
    tables = std::make_unique<TrainingTables>(training_rule(d, order), order, TailedHermite(options.radii));
  return *tables;
}

const VerificationTables& MapSolver::Workspace::verification_tables(Eigen::Index n, Eigen::Index d, int order,
                                                                    bool is_broad) {
  auto& tables = (is_broad ? broad : verification)[{n, d, order}];
  if (!tables) {
    Eigen::MatrixXd points(n, d);
    if (is_broad) {
      points.topRows(n / 2) = numerics::sobol_normal_points(n / 2, d, options.seed);
      points.bottomRows(n / 2) = k_broad * numerics::sobol_normal_points(n / 2, d, options.seed + 0x62726f61);
    } else {
      // With matched moments an affine map of a Gaussian target gives mean and covariance exactly.
      points = numerics::sobol_normal_points(n, d, options.seed);
      numerics::match_standard_moments(points);
    }
    Eigen::VectorXd log_reference = standard_normal_log_density(points);
    if (is_broad) {
      const Eigen::ArrayXd narrow = log_reference.array();
      const Eigen::ArrayXd wide =
          standard_normal_log_density(points / k_broad).array() - static_cast<double>(d) * std::log(k_broad);
      const Eigen::ArrayXd top = narrow.max(wide);
      log_reference = top + (0.5 * (narrow - top).exp() + 0.5 * (wide - top).exp()).log();
    }
    tables = std::make_unique<VerificationTables>(VerificationTables{
        MapLayout(d, order), PointTables(std::move(points), order, TailedHermite(options.radii)),
        std::move(log_reference)});
  }
  return *tables;
}

void MapSolver::Workspace::weigh(sampling::CheckedDensity& target, const AffineMap& pre_map, int order,
                                 const Eigen::VectorXd& map_coefficients_in, Eigen::Index n,
                                 WeightedPoints& out, bool is_broad) {
  const Eigen::Index d = pre_map.dimension();
  const VerificationTables& tables = verification_tables(n, d, order, is_broad);
  tables.layout.gather(map_coefficients_in, coefficients);
  component.resize(static_cast<std::size_t>(d));
  scratch.setOnes(n);
  for (Eigen::Index k = 0; k < d; ++k) {
    auto& c = component[static_cast<std::size_t>(k)];
    c.evaluate(tables.points, tables.layout, order, k, coefficients);
    scratch.array() *= c.h.array();
  }
  out.reference = tables.points.points();
  out.points.resize(n, d);
  for (Eigen::Index i = 0; i < d; ++i) {
    out.points.col(i).setConstant(pre_map.shift[i]);
    for (Eigen::Index j = 0; j <= i; ++j)
      out.points.col(i) += pre_map.lower(i, j) * component[static_cast<std::size_t>(j)].value;
  }
  if (!std::isfinite(out.points.sum()))
    throw NumericalError(
        "transport map: the image of a verification point is not finite; scale the parameters");
  target.evaluate(out.points, 0, batch);
  out.log_weight = batch.value.array() + 2 * scratch.array().abs().log() + pre_map.log_determinant() -
                   tables.log_reference.array();
}

numerics::MinimiserSummary MapSolver::Workspace::minimise(sampling::CheckedDensity& target) {
  auto kind = options.minimiser;
  if (target.available_derivatives() < 1) kind = MinimiserKind::nelder_mead;
  if (kind == MinimiserKind::newton && target.available_derivatives() < 2) kind = MinimiserKind::bfgs;
  if (kind == MinimiserKind::newton) {
    numerics::TrustRegionOptions newton_options;
    newton_options.max_iterations = options.max_iterations;
    newton_options.decrease_tolerance = options.decrease_tolerance;
    newton_options.gradient_tolerance = 1e-12;
    newton_options.initial_radius = 2;
    return newton.minimise(objective, newton_options, coefficients);
  }
  if (kind == MinimiserKind::bfgs) {
    numerics::BfgsOptions bfgs_options;
    bfgs_options.max_iterations = 10 * options.max_iterations;
    bfgs_options.decrease_tolerance = options.decrease_tolerance;
    bfgs_options.gradient_tolerance = 1e-10;
    return bfgs.minimise(objective, bfgs_options, coefficients);
  }
  numerics::NelderMeadOptions simplex_options;
  simplex_options.max_iterations = 1000 * options.max_iterations;
  simplex_options.value_tolerance = options.decrease_tolerance;
  simplex_options.point_tolerance = 1e-4;
  return nelder_mead.minimise(objective, simplex_options, coefficients);
}

void MapSolver::Workspace::train(sampling::CheckedDensity& target, MapResult& result, int order) {
  const Eigen::Index d = target.dimension();
  const TrainingTables& tables = training_tables(d, order);
  result.map = identity(d, order);
  if (tried > 0) {  // warm start from the lower order
    TriangularMap lower = identity(d, candidates[tried - 1].order);
    lower.set_coefficients(candidates[tried - 1].coefficients);
    result.map.embed(lower);
  }
  tables.layout.gather(result.map.coefficients(), coefficients);
  objective.begin(tables, result.pre_map, target, result.mode_log_density);
  auto summary = minimise(target);
  if (summary.termination == numerics::Termination::start_infeasible) {
    // h of the lower-order map changes sign at a node of this rule: begin with the affine part of the Laplace
    // map.
    tables.layout.gather(identity(d, order).coefficients(), coefficients);
    summary = minimise(target);
  }
  result.iterations += summary.iterations;
  if (candidates.size() <= tried) candidates.emplace_back();
  Candidate& candidate = candidates[tried++];
  candidate.order = order;
  candidate.training_objective = summary.value;
  candidate.training_diagnostic = objective.variance_diagnostic(coefficients);
  candidate.verified_diagnostic = -1;
  tables.layout.scatter(coefficients, candidate.coefficients);
  result.diagnostic_by_order.push_back(candidate.training_diagnostic);
}

void MapSolver::Workspace::verify(sampling::CheckedDensity& target, const AffineMap& pre_map,
                                  Candidate& candidate) {
  if (candidate.verified_diagnostic >= 0) return;
  weigh(target, pre_map, candidate.order, candidate.coefficients, options.verification_points,
        candidate.verification);
  diagnose(candidate.verification.log_weight, candidate.verified_diagnostic, candidate.verified_objective);
}

std::size_t MapSolver::Workspace::choose(sampling::CheckedDensity& target, const MapResult& result) {
  // The best by training, then any lower order as long as verification says that training was too kind.
  std::size_t best = 0;
  for (std::size_t i = 1; i < tried; ++i)
    if (candidates[i].training_diagnostic < candidates[best].training_diagnostic) best = i;
  verify(target, result.pre_map, candidates[best]);
  for (std::size_t i = best; i-- > 0;) {
    if (candidates[best].verified_diagnostic <=
        std::max(options.tolerance, 1.5 * candidates[i].training_diagnostic))
      break;
    verify(target, result.pre_map, candidates[i]);
    if (candidates[i].verified_diagnostic < candidates[best].verified_diagnostic) best = i;
  }
  for (std::size_t i = 0; i < tried; ++i)
    if (candidates[i].verified_diagnostic >= 0 &&
        candidates[i].verified_diagnostic < candidates[best].verified_diagnostic)
      best = i;
  return best;
}

void MapSolver::Workspace::look_at_other_modes(MapResult& result) {
  result.second_mode_found = false;
  if (modes.size() < 2) return;
  const auto& log_weight = result.verification.log_weight;
  const double top = log_weight.maxCoeff();
  const double log_evidence = top + std::log((log_weight.array() - top).exp().mean());
  for (std::size_t i = 1; i < modes.size(); ++i) {
    if (modes[i].log_mass < modes[0].log_mass + std::log(options.mode_mass)) continue;
    // Not missed if the map puts mass there: its density is compared with the normalised target's.
    const double approximation = result.log_density(modes[i].point.transpose())[0];
    if (modes[i].value - log_evidence > approximation + 1) {
      result.second_mode_found = true;
      result.second_mode = modes[i].point;
      return;
    }
  }
}

MapSolver::MapSolver(MapSolverOptions options) : work_(std::make_unique<Workspace>()) {
  require(options);
  work_->options = options;
  if (!(options.decrease_tolerance > 0)) work_->options.decrease_tolerance = 1e-3 * options.tolerance;
}
MapSolver::~MapSolver() = default;
MapSolver::MapSolver(MapSolver&&) noexcept = default;
MapSolver& MapSolver::operator=(MapSolver&&) noexcept = default;
const MapSolverOptions& MapSolver::options() const {
  return work_->options;
}

void MapSolver::prepare(Eigen::Index dimension) {
  for (int order = work_->options.min_order; order <= work_->options.max_order; ++order) {
    (void)work_->identity(dimension, order);
    (void)work_->training_tables(dimension, order);
    (void)work_->verification_tables(work_->options.verification_points, dimension, order);
    for (const int more : {2, 4}) {
      (void)work_->verification_tables(more * work_->options.verification_points, dimension, order, true);
    }
  }
}

MapResult MapSolver::solve(sampling::LogDensity& target) {
  MapResult result;
  solve(target, result);
  return result;
}

void MapSolver::solve(sampling::LogDensity& user_target, MapResult& result) {
  Workspace& work = *work_;
  const auto& options = work.options;
  if (user_target.dimension() < 1 || user_target.dimension() > numerics::k_sobol_max_dimension)
    throw UsageError(fmt::format("map solver: a density in {} dimensions; 1 to {} are possible",
                                 user_target.dimension(), numerics::k_sobol_max_dimension));
  sampling::CheckedDensity target(user_target);
  work.mode_search.run(target, options.search_modes, work.modes);
  const sampling::Mode& main = work.modes.front();
  result.mode = main.point;
  result.mode_log_density = main.value;
  for (const sampling::Mode& mode : work.modes)
    if (mode.value > result.mode_log_density) result.mode = mode.point, result.mode_log_density = mode.value;
  result.pre_map.shift = main.point;
  result.pre_map.lower = main.lower;
  result.iterations = 0;
  result.diagnostic_by_order.clear();
  work.tried = 0;

  double best = std::numeric_limits<double>::infinity();
  int stalled = 0;
  bool reached = false, no_longer_falls = false;
  for (int order = options.min_order; order <= options.max_order && !reached; ++order) {
    work.train(target, result, order);
    auto& candidate = work.candidates[work.tried - 1];
    if (candidate.training_diagnostic <= options.tolerance) {
      work.verify(target, result.pre_map, candidate);
      reached = candidate.verified_diagnostic <= options.tolerance;
    }
    const double diagnostic = std::max(candidate.training_diagnostic, candidate.verified_diagnostic);
    // Low orders may get worse before they get better: a bent ridge is followed only from order 3 or 4 on.
    stalled = order > 4 && diagnostic > 0.85 * best ? stalled + 1 : 0;
    best = std::min(best, diagnostic);
    if (!reached && stalled >= 1) {
      no_longer_falls = true;
      break;
    }
  }
  const std::size_t chosen = work.choose(target, result);
  auto& candidate = work.candidates[chosen];
  result.map = work.identity(target.dimension(), candidate.order);
  result.map.set_coefficients(candidate.coefficients);
  result.order = candidate.order;
  result.training_diagnostic = candidate.training_diagnostic;
  result.verified_diagnostic = candidate.verified_diagnostic;
  result.training_objective = candidate.training_objective;
  result.verified_objective = candidate.verified_objective;
  std::swap(result.verification, candidate.verification);
  candidate.verified_diagnostic = -1;
  result.density_evaluations = target.evaluations();
  result.tolerance_reached = result.verified_diagnostic <= options.tolerance;
  result.reason.clear();
  if (!result.tolerance_reached)
    result.reason = fmt::format(
        "the variance diagnostic is {:.2g} at order {} on points not used for training, {:.2g} on the "
        "training rule, above "
        "the tolerance {:.2g}; {}",
        result.verified_diagnostic, result.order, result.training_diagnostic, options.tolerance,
        no_longer_falls ? "higher orders no longer lower it"
                        : fmt::format("max_order is {}", options.max_order));
  work.look_at_other_modes(result);
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

}  // namespace knothe::transport
