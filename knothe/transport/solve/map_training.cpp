/// One map of a solve: its tables, its minimisation, its verification.
#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/numerics/integrate/sobol.hpp"
#include "knothe/transport/solve/map_solver_workspace.hpp"

namespace knothe::transport {

namespace {

constexpr std::uint64_t k_training_seed = 0x7261696e;  // never that of the verification points
/// Maps with a long first variable: so many times the order of the others, and no more than that.
constexpr int k_longer = 4, k_longer_in_width = 2, k_longest = k_max_order;
/// Nodes along a long variable: what makes it long are features that fewer nodes step over
/// (docs/transport.md, "A long first variable").
constexpr int k_long_nodes = 96;
/// Lighter nodes of a tensor rule only stall the minimiser.
constexpr double k_lightest_node = 1e-11;
/// With more coefficients a Hessian costs more than it saves.
constexpr Eigen::Index k_max_for_hessian = 600;

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

/// Order in each variable: the highest degree in a Φ_c, or one more than that in a Φ_e.
std::vector<int> orders_of(const TriangularMap& map) {
  std::vector<int> orders(static_cast<std::size_t>(map.dimension()), 1);
  for (Eigen::Index k = 0; k < map.dimension(); ++k) {
    for (const MultiIndex& index : map.component(k).constant)
      for (const auto& f : index.factors)
        orders[static_cast<std::size_t>(f.variable)] =
            std::max(orders[static_cast<std::size_t>(f.variable)], f.degree);
    for (const MultiIndex& index : map.component(k).monotone)
      for (const auto& f : index.factors)
        orders[static_cast<std::size_t>(f.variable)] =
            std::max(orders[static_cast<std::size_t>(f.variable)], f.degree + 1);
  }
  return orders;
}

bool less(const Parametrisation& a, const Parametrisation& b) {
  const auto key = [](const Parametrisation& p) {
    return std::tuple(p.rectifier, p.basis, p.tails, p.radii.level, p.radii.bend, p.radii.tangent);
  };
  return key(a) < key(b);
}

}  // namespace

/// The training rule is chosen with the order: 2p + 4 Gauss–Hermite nodes per axis, p the order in that
/// variable, in up to three dimensions; beyond, twelve quasi-random points per coefficient of the largest
/// component.
numerics::PointRule default_training_rule(const MapShape& shape) {
  const Eigen::Index d = shape.identity.dimension();
  if (d <= 3) {
    std::vector<numerics::Quadrature> rules;
    const std::vector<int> orders = orders_of(shape.identity);
    const bool is_long = d > 1 && orders.front() > orders.back();
    for (std::size_t k = 0; k < orders.size(); ++k)
      rules.push_back(numerics::gauss_hermite(k == 0 && is_long ? k_long_nodes : 2 * orders[k] + 4));
    return numerics::tensor_rule(rules, k_lightest_node);
  }
  Eigen::Index most = 0;
  for (const auto& c : shape.layout.components()) most = std::max(most, c.count());
  Eigen::Index n = 1024;
  while (n < 12 * most) n *= 2;
  return quasi_random_rule(n, d);
}

MapSolver::Workspace::Workspace()
    : shapes([](const auto& a, const auto& b) {
        if (std::get<0>(a) != std::get<0>(b)) return std::get<0>(a) < std::get<0>(b);
        if (std::get<1>(a) != std::get<1>(b)) return std::get<1>(a) < std::get<1>(b);
        return less(std::get<2>(a), std::get<2>(b));
      }) {}

MapShape& MapSolver::Workspace::shape(Eigen::Index d, int order, const Parametrisation& parametrisation) {
  auto& shape = shapes[{d, order, parametrisation}];
  if (!shape) {
    MapSpecification specification =
        options.family ? options.family(d, order) : total_order_map(d, order, parametrisation);
    if (specification.dimension() != d)
      throw UsageError(
          fmt::format("map solver: the map family gives a map in {} dimensions for a density in {}",
                      specification.dimension(), d));
    specification.parametrisation = parametrisation;
    shape = std::make_unique<MapShape>(std::move(specification));
  }
  return *shape;
}

MapShape& MapSolver::Workspace::long_shape(Eigen::Index d, int order) {
  auto& shape = long_shapes[{d, order}];
  if (!shape) {
    std::vector<int> orders(static_cast<std::size_t>(d), order);
    orders.front() = std::min(k_longer * order, k_longest);
    MapSpecification specification = per_variable_map(orders, options.parametrisation);
    // How the *width* across the ridge changes along it needs less than where the ridge is, and the pairs of
    // its functions are what costs.
    orders.front() = std::min(k_longer_in_width * order, k_longest);
    const MapSpecification shorter = per_variable_map(orders, options.parametrisation);
    for (std::size_t k = 1; k < orders.size(); ++k)
      specification.components[k].monotone = shorter.components[k].monotone;
    shape = std::make_unique<MapShape>(std::move(specification));
  }
  return *shape;
}

MapShape& MapSolver::Workspace::shape_of(const TriangularMap& map) {
  // Copies of a map share their structure, hence the address tells.
  const auto same = [&](const MapShape& shape) { return &shape.identity.component(0) == &map.component(0); };
  for (auto& [key, shape] : shapes)
    if (same(*shape)) return *shape;
  for (auto& [key, shape] : long_shapes)
    if (same(*shape)) return *shape;
  for (auto& shape : grown)
    if (same(*shape)) return *shape;
  if (!foreign || !same(*foreign)) {
    foreign = std::make_unique<MapShape>(map.specification());
    foreign->identity = map;
  }
  return *foreign;
}

const TrainingTables& MapSolver::Workspace::training_tables(MapShape& shape) {
  if (!shape.training) {
    numerics::PointRule rule;
    if (options.rule) {
      numerics::ReferenceRule choice = *options.rule;
      choice.drop = std::max(choice.drop, k_lightest_node);
      rule = numerics::reference_rule(choice, shape.identity.dimension());
    } else {
      rule = default_training_rule(shape);
    }
    shape.training = std::make_unique<TrainingTables>(std::move(rule), shape.identity);
  }
  return *shape.training;
}

const VerificationTables& MapSolver::Workspace::verification_tables(MapShape& shape, Eigen::Index n,
                                                                    bool is_broad) {
  auto& tables = shape.verification[{n, is_broad}];
  if (tables) return *tables;
  const Eigen::Index d = shape.identity.dimension();
  tables = std::make_unique<VerificationTables>();
  Eigen::MatrixXd& points = tables->reference;
  points.resize(n, d);
  if (is_broad) {
    points.topRows(n / 2) = numerics::sobol_normal_points(n / 2, d, options.seed);
    points.bottomRows(n / 2) = k_broad * numerics::sobol_normal_points(n / 2, d, options.seed + 0x62726f61);
  } else {
    // With matched moments an affine map of a Gaussian target gives mean and covariance exactly.
    points = numerics::sobol_normal_points(n, d, options.seed);
    if (n > d) numerics::match_standard_moments(points);
  }
  tables->log_reference = standard_normal_log_density(points);
  if (is_broad) {
    const Eigen::ArrayXd narrow = tables->log_reference.array();
    const Eigen::ArrayXd wide =
        standard_normal_log_density(points / k_broad).array() - static_cast<double>(d) * std::log(k_broad);
    const Eigen::ArrayXd top = narrow.max(wide);
    tables->log_reference = top + (0.5 * (narrow - top).exp() + 0.5 * (wide - top).exp()).log();
  }
  if (shape.identity.parametrisation().rectifier == Rectifier::square)
    tables->points = PointTables(points, shape.identity, shape.layout);
  return *tables;
}

void MapSolver::Workspace::weigh(sampling::CheckedDensity& target, const AffineMap& pre_map, MapShape& shape,
                                 const Eigen::VectorXd& map_coefficients, Eigen::Index n, WeightedPoints& out,
                                 bool is_broad) {
  const Eigen::Index d = pre_map.dimension();
  const VerificationTables& tables = verification_tables(shape, n, is_broad);
  out.reference = tables.reference;
  map_batch.resize(n, d, 0);
  if (shape.identity.parametrisation().rectifier == Rectifier::square) {
    shape.layout.gather(map_coefficients, coefficients);
    component.resize(static_cast<std::size_t>(d));
    map_batch.log_determinant.setZero();
    for (Eigen::Index k = 0; k < d; ++k) {
      auto& c = component[static_cast<std::size_t>(k)];
      (void)c.evaluate(tables.points, shape.layout, k, coefficients, 0);  // h < 0 here and there is no error
      map_batch.value.col(k) = c.value;
      map_batch.log_determinant += c.log_slope;
    }
  } else {
    TriangularMap map = shape.identity;
    map.set_coefficients(map_coefficients);
    map.evaluate(tables.reference, 0, map_batch);
  }
  const Eigen::MatrixXd matrix = pre_map.matrix();
  out.points.resize(n, d);
  for (Eigen::Index i = 0; i < d; ++i) {
    out.points.col(i).setConstant(pre_map.shift[i]);
    for (Eigen::Index j = 0; j < d; ++j)
      if (matrix(i, j) != 0) out.points.col(i) += matrix(i, j) * map_batch.value.col(j);
  }
  if (!std::isfinite(out.points.sum()))
    throw NumericalError(
        "transport map: the image of a verification point is not finite; scale the parameters");
  target.evaluate(out.points, 0, batch);
  out.log_weight = batch.value.array() + map_batch.log_determinant.array() + pre_map.log_determinant() -
                   tables.log_reference.array();
}

numerics::MinimiserSummary MapSolver::Workspace::minimise(sampling::CheckedDensity& target,
                                                          const MapShape& shape) {
  auto kind = options.minimiser;
  if (kind == MinimiserKind::newton && shape.layout.size() > k_max_for_hessian)
    kind = MinimiserKind::newton_cg;
  if (target.available_derivatives() < 1) kind = MinimiserKind::nelder_mead;
  if ((kind == MinimiserKind::newton || kind == MinimiserKind::newton_cg) &&
      target.available_derivatives() < 2)
    kind = shape.layout.size() > k_max_for_hessian ? MinimiserKind::lbfgs : MinimiserKind::bfgs;
  std::optional<RegularisedObjective> regularised;
  numerics::Objective* function = &objective;
  if (options.regularisation > 0) {
    Eigen::VectorXd centre;
    shape.layout.gather(TriangularMap(shape.identity.specification()).coefficients(), centre);
    function = &regularised.emplace(objective, options.regularisation, std::move(centre));
  }
  switch (kind) {
    case MinimiserKind::newton: {
      numerics::TrustRegionOptions o;
      o.max_iterations = options.max_iterations;
      o.decrease_tolerance = options.decrease_tolerance;
      o.gradient_tolerance = 1e-12;
      o.initial_radius = 2;
      o.decrease_at_border = 0.1 * options.tolerance;
      return newton.minimise(*function, o, coefficients);
    }
    case MinimiserKind::newton_cg: {
      numerics::TrustRegionOptions o;
      o.max_iterations = options.max_iterations;
      o.decrease_tolerance = options.decrease_tolerance;
      o.gradient_tolerance = 1e-12;
      o.initial_radius = 2;
      return newton_cg.minimise(*function, o, coefficients);
    }
    case MinimiserKind::bfgs: {
      numerics::BfgsOptions o;
      o.max_iterations = 10 * options.max_iterations;
      o.decrease_tolerance = options.decrease_tolerance;
      o.gradient_tolerance = 1e-10;
      return bfgs.minimise(*function, o, coefficients);
    }
    case MinimiserKind::lbfgs: {
      numerics::LbfgsOptions o;
      o.max_iterations = 20 * options.max_iterations;
      o.decrease_tolerance = options.decrease_tolerance;
      o.gradient_tolerance = 1e-10;
      return lbfgs.minimise(*function, o, coefficients);
    }
    default:
      break;
  }
  numerics::NelderMeadOptions o;
  o.max_iterations = 1000 * options.max_iterations;
  o.value_tolerance = options.decrease_tolerance;
  o.point_tolerance = 1e-4;
  return nelder_mead.minimise(*function, o, coefficients);
}

MapSolver::Workspace::Candidate& MapSolver::Workspace::train(sampling::CheckedDensity& target,
                                                             MapResult& result, const AffineMap& pre_map,
                                                             MapShape& shape, int order,
                                                             std::ptrdiff_t warm) {
  const TrainingTables& tables = training_tables(shape);
  TriangularMap start = shape.identity;
  if (warm >= 0) {
    const Candidate& from = candidates[static_cast<std::size_t>(warm)];
    TriangularMap lower = from.shape->identity;
    lower.set_coefficients(from.coefficients);
    start.embed(lower);
  }
  tables.layout.gather(start.coefficients(), coefficients);
  objective.begin(tables, OuterMap::of(pre_map), target, result.mode_log_density);
  auto summary = minimise(target, shape);
  if (summary.termination == numerics::Termination::start_infeasible) {
    // h of the lower-order map changes sign at a node of this rule: begin with the affine part of the Laplace
    // map.
    tables.layout.gather(shape.identity.coefficients(), coefficients);
    summary = minimise(target, shape);
  }
  result.iterations += summary.iterations;
  if (candidates.size() <= tried) candidates.emplace_back();
  Candidate& candidate = candidates[tried++];
  candidate.shape = &shape;
  candidate.pre_map = pre_map;
  candidate.order = order;
  candidate.usable = true;
  candidate.is_long = false;
  candidate.training_objective = summary.value;
  candidate.training_diagnostic = objective.variance_diagnostic(coefficients);
  candidate.verified_diagnostic = -1;
  tables.layout.scatter(coefficients, candidate.coefficients);
  return candidate;
}

void MapSolver::Workspace::verify(sampling::CheckedDensity& target, Candidate& candidate) {
  if (candidate.verified_diagnostic >= 0) return;
  weigh(target, candidate.pre_map, *candidate.shape, candidate.coefficients, options.verification_points,
        candidate.verification);
  diagnose(candidate.verification.log_weight, candidate.verified_diagnostic, candidate.verified_objective);
}

void diagnose(const Eigen::VectorXd& log_weight, double& diagnostic, double& objective) {
  const double floor = log_weight.maxCoeff() - 1000;
  const auto clipped = log_weight.array().cwiseMax(floor);
  const double mean = clipped.mean();
  objective = -mean;
  diagnostic = 0.5 * (clipped - mean).square().mean();
}

}  // namespace knothe::transport
