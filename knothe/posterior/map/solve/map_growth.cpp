/// How a solve goes from a map that is not good enough to a better one: orders, orientation, the
///  tempered sequence, and the ways tried when all that is not enough.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "knothe/base/index.hpp"
#include "knothe/numerics/linear/symmetric_eigen.hpp"
#include "knothe/posterior/map/solve/map_solver_workspace.hpp"

namespace knothe::posterior {

namespace {

/// Beyond so many variables a second order-2 map, for the orientation alone, costs more than it is likely to
/// bring.
constexpr Index k_max_turned = 6;
/// Principal axes are preferred unless the given ones gain so much more at order 2
/// (docs/explanation/transport.md, "Orientation": at equal gain at order 2 the principal axes were never
/// worse at the end, often ten times better).
constexpr double k_clearly_more = 1.2;

}  // namespace

AffineMap principal_axes(const AffineMap& pre_map) {
  const Eigen::MatrixXd matrix = pre_map.matrix();
  const numerics::SymmetricEigen eigen(matrix * matrix.transpose());
  const Index d = pre_map.dimension();
  AffineMap turned;
  turned.shift = pre_map.shift;
  turned.rotation = eigen.eigenvectors().rowwise().reverse();
  for (Index k = 0; k < d; ++k) {  // signs as near to the given axes as can be
    Index largest = 0;
    turned.rotation.col(k).cwiseAbs().maxCoeff(&largest);
    if (turned.rotation(largest, k) < 0) turned.rotation.col(k) *= -1;
  }
  // The spread along the axes from the factor itself: the eigenvalues of its square have half of the digits.
  const Eigen::VectorXd spread = (turned.rotation.transpose() * matrix).rowwise().norm();
  turned.lower = spread.asDiagonal();
  return turned;
}

std::string describe_method(const Parametrisation& parametrisation, const AffineMap& pre_map) {
  return fmt::format(
      "{}, linear tails{}, {}", in_words(parametrisation.rectifier),
      parametrisation.radii == TailRadii{}
          ? ""
          : fmt::format(" beyond {:g} and {:g}", parametrisation.radii.level, parametrisation.radii.tangent),
      pre_map.rotation.size() > 0 ? "rotated to principal axes" : "in the given coordinates");
}

MapSolver::Workspace::Climb MapSolver::Workspace::climb(CheckedDensity& target, MapResult& result,
                                                        AffineMap pre_map,
                                                        const Parametrisation& parametrisation,
                                                        Orientation orientation, int first,
                                                        std::ptrdiff_t warm) {
  const Index d = target.dimension();
  const auto last = [&]() -> Index { return tried - 1; };
  if (orientation == Orientation::principal) pre_map = principal_axes(pre_map);
  // A family of the caller's own belongs to the caller's coordinates.
  bool may_turn = orientation == Orientation::automatic && d >= 2 && d <= k_max_turned && !options.family;
  Climb climb;
  double best = std::numeric_limits<double>::infinity();
  for (int order = first; order <= options.max_order && !climb.reached; ++order) {
    MapShape& of_order = shapes.of_order(d, order, parametrisation);
    const double below =
        warm >= 0 ? candidates[warm].training_objective : std::numeric_limits<double>::quiet_NaN();
    (void)train(target, result, pre_map, of_order, order, warm);
    warm = last();
    if (may_turn && order >= 2) {
      may_turn = false;
      const double given = candidates[warm].training_objective;
      const AffineMap turned = principal_axes(pre_map);
      const double along = train(target, result, turned, of_order, order, -1).training_objective;
      const bool better =
          std::isnan(below) ? along <= given : k_clearly_more * (below - along) >= below - given;
      if (better) pre_map = turned, warm = last();
    }
    Candidate& candidate = candidates[warm];
    if (candidate.training_diagnostic <= options.tolerance) {
      verify(target, candidate);
      climb.reached = candidate.verified_diagnostic <= options.tolerance;
    }
    // Low orders may get worse before they get better: a bent ridge is followed only from order 3 or 4 on.
    climb.no_longer_falls = !climb.reached && order > 4 && candidate.diagnostic() > 0.85 * best;
    best = std::min(best, candidate.diagnostic());
    if (climb.no_longer_falls) break;
  }
  return climb;
}

MapSolver::Workspace::Climb MapSolver::Workspace::climb_long(CheckedDensity& target, MapResult& result,
                                                             const AffineMap& pre_map) {
  Climb climb;
  std::ptrdiff_t warm = -1;
  double best = std::numeric_limits<double>::infinity();
  for (int order = k_first_long;
       order <= std::min(last_long(target.dimension()), options.max_order) && !climb.reached; ++order) {
    if (order >= k_first_dear_long) {
      Candidate& last = candidates[warm];
      verify(target, last);
      if (last.verified_diagnostic <= 10 * options.tolerance) break;
    }
    MapShape& shape = shapes.long_of_order(target.dimension(), order);
    Candidate& candidate = train(target, result, pre_map, shape, shape.identity.order(), warm);
    candidate.is_long = true;
    warm = tried - 1;
    if (candidate.training_diagnostic <= options.tolerance) {
      verify(target, candidate);
      climb.reached = candidate.verified_diagnostic <= options.tolerance;
    }
    climb.no_longer_falls = !climb.reached && order > k_first_long + 1 && candidate.diagnostic() > 0.9 * best;
    best = std::min(best, candidate.diagnostic());
    if (climb.no_longer_falls) break;
  }
  return climb;
}

MapSolver::Workspace::Climb MapSolver::Workspace::climb_tempered(LogDensity& user_target,
                                                                 CheckedDensity& target, MapResult& result,
                                                                 const AffineMap& pre_map) {
  TemperedDensity tempered(user_target);
  CheckedDensity checked(tempered);
  const int order = std::clamp(3, options.min_order, options.max_order);
  MapShape& of_order = shapes.of_order(target.dimension(), order, options.parametrisation);
  std::ptrdiff_t warm = -1;
  for (const double beta : {0.0625, 0.125, 0.25, 0.5}) {
    tempered.set_beta(beta);
    Candidate& candidate = train(checked, result, pre_map, of_order, order, warm);
    candidate.usable = false;
    candidate.training_diagnostic = candidate.verified_diagnostic = std::numeric_limits<double>::infinity();
    warm = tried - 1;
  }
  tempered_evaluations += checked.evaluations();
  return climb(target, result, pre_map, options.parametrisation, Orientation::given, order, warm);
}

MapSolver::Workspace::Climb MapSolver::Workspace::fall_back(LogDensity& user_target, CheckedDensity& target,
                                                            MapResult& result, const AffineMap& pre_map) {
  const std::size_t standard = choose(target);
  standard_diagnostic = candidates[standard].verified_diagnostic;
  Climb climb;
  climb.reached = standard_diagnostic <= options.tolerance;
  const Parametrisation& own = options.parametrisation;
  const auto attempt = [&](const Parametrisation& parametrisation, const AffineMap& axes,
                           Orientation orientation) {
    if (!climb.reached) climb = this->climb(target, result, axes, parametrisation, orientation, 1, -1);
  };
  // The orientation not taken.
  const AffineMap taken = candidates[standard].pre_map;
  const Index d = target.dimension();
  if (options.orientation == Orientation::automatic && d >= 2 && d <= k_max_turned && !options.family)
    attempt(own, pre_map, taken.rotation.size() > 0 ? Orientation::given : Orientation::principal);
  // Targets that are polynomial far into their tails, as Rosenbrock's.
  Parametrisation wide = own;
  wide.radii.tangent = std::max(8.0, own.radii.tangent);
  attempt(wide, pre_map, options.orientation);
  // Rectifiers without the barrier.
  for (const Rectifier other : {Rectifier::softplus, Rectifier::exponential, Rectifier::square}) {
    Parametrisation changed = own;
    changed.rectifier = other;
    if (other != own.rectifier) attempt(changed, taken, Orientation::given);
  }
  if (!climb.reached) climb = climb_tempered(user_target, target, result, taken);
  return climb;
}

}  // namespace knothe::posterior
