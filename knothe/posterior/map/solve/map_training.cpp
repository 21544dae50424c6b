/// One map of a solve: its tables, its minimisation, its verification.
#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/numerics/integrate/sobol.hpp"
#include "knothe/posterior/map/solve/map_solver_workspace.hpp"

namespace knothe::posterior {

namespace {

/// With more coefficients a Hessian costs more than it saves.
constexpr Index k_max_for_hessian = 600;

}  // namespace

void MapSolver::Workspace::weigh(CheckedDensity& target, const AffineMap& pre_map, MapShape& shape,
                                 const Eigen::VectorXd& map_coefficients, Index n, MappedPoints& out,
                                 bool is_broad) {
  const Index d = pre_map.dimension();
  const VerificationTables& tables = shapes.verification_tables(shape, n, is_broad);
  out.reference = tables.reference;
  map_batch.resize(n, d, 0);
  if (shape.identity.parametrisation().rectifier == Rectifier::square) {
    shape.layout.gather(map_coefficients, coefficients);
    component.resize(d);
    map_batch.log_determinant.setZero();
    for (Index k = 0; k < d; ++k) {
      auto& c = component[k];
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
  for (Index i = 0; i < d; ++i) {
    out.points.col(i).setConstant(pre_map.shift[i]);
    for (Index j = 0; j < d; ++j)
      if (matrix(i, j) != 0) out.points.col(i) += matrix(i, j) * map_batch.value.col(j);
  }
  if (!std::isfinite(out.points.sum()))
    throw NumericalError(
        "transport map: the image of a verification point is not finite; scale the parameters");
  target.evaluate(out.points, 0, batch);
  out.log_weight = batch.value.array() + map_batch.log_determinant.array() + pre_map.log_determinant() -
                   tables.log_reference.array();
}

numerics::MinimiserSummary MapSolver::Workspace::minimise(CheckedDensity& target, const MapShape& shape) {
  auto kind = options.minimiser;
  if (kind == MinimiserKind::newton && shape.layout.size() > k_max_for_hessian)
    kind = MinimiserKind::newton_cg;
  if (target.available_derivatives() < 1) kind = MinimiserKind::nelder_mead;
  if ((kind == MinimiserKind::newton || kind == MinimiserKind::newton_cg) &&
      target.available_derivatives() < 2)
    kind = shape.layout.size() > k_max_for_hessian ? MinimiserKind::lbfgs : MinimiserKind::bfgs;
  switch (kind) {
    case MinimiserKind::newton: {
      numerics::TrustRegionOptions o;
      o.max_iterations = options.max_iterations;
      o.decrease_tolerance = options.decrease_tolerance;
      o.gradient_tolerance = 1e-12;
      o.initial_radius = 2;
      o.decrease_at_border = 0.1 * options.tolerance;
      return newton.minimise(objective, o, coefficients);
    }
    case MinimiserKind::newton_cg: {
      numerics::TrustRegionOptions o;
      o.max_iterations = options.max_iterations;
      o.decrease_tolerance = options.decrease_tolerance;
      o.gradient_tolerance = 1e-12;
      o.initial_radius = 2;
      return newton_cg.minimise(objective, o, coefficients);
    }
    case MinimiserKind::bfgs: {
      numerics::BfgsOptions o;
      o.max_iterations = 10 * options.max_iterations;
      o.decrease_tolerance = options.decrease_tolerance;
      o.gradient_tolerance = 1e-10;
      return bfgs.minimise(objective, o, coefficients);
    }
    case MinimiserKind::lbfgs: {
      numerics::LbfgsOptions o;
      o.max_iterations = 20 * options.max_iterations;
      o.decrease_tolerance = options.decrease_tolerance;
      o.gradient_tolerance = 1e-10;
      return lbfgs.minimise(objective, o, coefficients);
    }
    default:
      break;
  }
  numerics::NelderMeadOptions o;
  o.max_iterations = 1000 * options.max_iterations;
  o.value_tolerance = options.decrease_tolerance;
  o.point_tolerance = 1e-4;
  return nelder_mead.minimise(objective, o, coefficients);
}

MapSolver::Workspace::Candidate& MapSolver::Workspace::train(CheckedDensity& target, MapResult& result,
                                                             const AffineMap& pre_map, MapShape& shape,
                                                             int order, std::ptrdiff_t warm) {
  const TrainingTables& tables = shapes.training_tables(shape);
  TriangularMap start = shape.identity;
  if (warm >= 0) {
    const Candidate& from = candidates[warm];
    TriangularMap lower = from.shape->identity;
    lower.set_coefficients(from.coefficients);
    start.embed(lower);
  }
  tables.layout.gather(start.coefficients(), coefficients);
  objective.begin(tables, pre_map, target, result.mode_log_density);
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

void MapSolver::Workspace::verify(CheckedDensity& target, Candidate& candidate) {
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

}  // namespace knothe::posterior
