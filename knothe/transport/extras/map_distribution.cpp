#include "knothe/transport/extras/map_distribution.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "knothe/base/error.hpp"
#include "knothe/numerics/integrate/sobol.hpp"
#include "knothe/numerics/optimise/bfgs.hpp"
#include "knothe/numerics/optimise/nelder_mead.hpp"
#include "knothe/numerics/statistics/random.hpp"
#include "knothe/sampling/checked_density.hpp"
#include "knothe/transport/map/pull_back.hpp"

namespace knothe::transport {

namespace {

/// −log of a density at T(x), as a function of x: of the map's own density, or of a target.
class NegativeLogDensity final : public numerics::Objective {
 public:
  NegativeLogDensity(const ComposedMap& map, sampling::CheckedDensity* target)
      : map_(&map), target_(target) {}
  [[nodiscard]] Eigen::Index dimension() const override { return map_->dimension(); }
  bool evaluate(const Eigen::VectorXd& x, int derivatives, double& value, Eigen::VectorXd& gradient,
                Eigen::MatrixXd& hessian) override {
    (void)hessian;
    trace_.evaluate(*map_, x.transpose(), derivatives >= 1);
    if (!trace_.value().allFinite()) return false;
    if (target_) {
      target_->evaluate(trace_.value(), derivatives, batch_);
      value = -batch_.value[0];
      if (derivatives >= 1) pulled_ = -batch_.gradient;
    } else {  // log T_♯ρ = log ρ(x) − log det
      value = trace_.log_determinant()[0] - standard_normal_log_density(x.transpose())[0];
      if (derivatives >= 1) pulled_.setZero(1, x.size());
    }
    if (derivatives >= 1) {
      trace_.pull_back_gradient(*map_, target_ ? 0 : 1, pulled_);
      gradient = pulled_.transpose();
      if (!target_) gradient += x;
    }
    return std::isfinite(value) && (derivatives < 1 || gradient.allFinite());
  }

 private:
  const ComposedMap* map_;
  sampling::CheckedDensity* target_;
  MapTrace trace_;
  sampling::LogDensityBatch batch_;
  Eigen::MatrixXd pulled_;
};

MaximumOfDensity climb(const ComposedMap& map, sampling::CheckedDensity* target, Eigen::VectorXd x) {
  NegativeLogDensity objective(map, target);
  numerics::MinimiserSummary summary;
  if (target && target->available_derivatives() < 1) {
    numerics::NelderMeadOptions options;
    options.max_iterations = 2000 * static_cast<int>(x.size());
    options.point_tolerance = 1e-7;
    options.value_tolerance = 1e-13;
    summary = numerics::NelderMead().minimise(objective, options, x);
  } else {
    numerics::BfgsOptions options;
    options.gradient_tolerance = 1e-9;
    summary = numerics::Bfgs().minimise(objective, options, x);
  }
  MaximumOfDensity result;
  result.point = map.evaluate(x.transpose()).transpose();
  result.reference = std::move(x);
  result.log_density = -summary.value;
  result.converged = summary.converged() || summary.gradient_norm < 1e-5;
  return result;
}

/// The first m components of a part, which depend on nothing else.
ComposedMap::Part leading_block(const ComposedMap::Part& part, Eigen::Index m) {
  if (const auto* affine = std::get_if<AffineMap>(&part))
    return AffineMap{affine->shift.head(m), affine->lower.topLeftCorner(m, m)};
  const auto& map = std::get<TriangularMap>(part);
  MapSpecification specification = map.specification();
  specification.components.resize(static_cast<std::size_t>(m));
  TriangularMap block(std::move(specification));
  block.set_coefficients(map.coefficients().head(block.coefficients().size()));
  return block;
}

}  // namespace

MapDistribution::MapDistribution(ComposedMap map) : map_(std::move(map)) {
  if (map_.dimension() < 1) throw UsageError("distribution of a map: the map has no variables");
}

bool MapDistribution::is_triangular() const {
  return std::all_of(map_.parts().begin(), map_.parts().end(), [](const ComposedMap::Part& part) {
    const auto* affine = std::get_if<AffineMap>(&part);
    return affine ? affine->is_triangular() : std::holds_alternative<TriangularMap>(part);
  });
}

void MapDistribution::require_triangular(const char* what) const {
  if (is_triangular()) return;
  throw UsageError(fmt::format(
      "{}: the map is not triangular, it has a part on a subspace (a lazy map) or one turned to the "
      "principal axes; make it with MapSolverOptions::orientation = Orientation::given, or weigh "
      "samples and condition those",
      what));
}

void MapDistribution::require_coordinate(Eigen::Index k) const {
  if (k < 0 || k >= dimension())
    throw UsageError(fmt::format("coordinate {}: the map has coordinates 0 to {}", k, dimension() - 1));
}

Eigen::VectorXd MapDistribution::log_density(const Eigen::Ref<const Eigen::MatrixXd>& z) const {
  return map_.log_density(z);
}

Eigen::MatrixXd MapDistribution::sample(Eigen::Index n, std::uint64_t seed) const {
  return map_.evaluate(numerics::monte_carlo_normal_points(n, dimension(), seed));
}

numerics::PointRule MapDistribution::push_forward(const numerics::PointRule& rule) const {
  if (rule.points.cols() != dimension())
    throw UsageError(
        fmt::format("push-forward: a rule in {} variables, a map in {}", rule.points.cols(), dimension()));
  return {map_.evaluate(rule.points), rule.weights};
}

Moments MapDistribution::moments(Eigen::Index points, std::uint64_t seed) const {
  if (dimension() <= 3) {
    const auto rule =
        numerics::tensor_rule(numerics::gauss_hermite(dimension() < 3 ? 32 : 20), dimension(), 1e-25);
    return moments_of(map_.evaluate(rule.points), rule.weights);
  }
  Eigen::MatrixXd x = numerics::sobol_normal_points(points, dimension(), seed);
  if (points > dimension()) numerics::match_standard_moments(x);
  return moments_of(map_.evaluate(x), Eigen::VectorXd::Ones(points));
}

MaximumOfDensity MapDistribution::mode() const {
  return climb(map_, nullptr, Eigen::VectorXd::Zero(dimension()));
}

MaximumOfDensity MapDistribution::mode_of(sampling::LogDensity& target) const {
  if (target.dimension() != dimension())
    throw UsageError(
        fmt::format("mode of a target in {} variables through a map in {}: give the density it was made "
                    "for",
                    target.dimension(), dimension()));
  sampling::CheckedDensity checked(target);
  return climb(map_, &checked, mode().reference);
}

MapDistribution MapDistribution::leading(Eigen::Index m) const {
  if (m < 1 || m > dimension())
    throw UsageError(fmt::format("the first {} coordinates of a map with {}", m, dimension()));
  require_triangular("marginal of the leading coordinates");
  if (m == dimension()) return *this;
  ComposedMap block(m);
  for (const auto& part : map_.parts()) block.append(leading_block(part, m));
  return MapDistribution(std::move(block));
}

Eigen::VectorXd MapDistribution::conditional_log_density(
    const Eigen::VectorXd& given, const Eigen::Ref<const Eigen::MatrixXd>& rest) const {
  const Eigen::Index m = given.size(), d = dimension(), n = rest.rows();
  if (rest.cols() != d - m)
    throw UsageError(
        fmt::format("conditional density: {} coordinates given and {} to evaluate at, the map has {}", m,
                    rest.cols(), d));
  if (m == 0) return log_density(rest);
  const MapDistribution block = leading(m);
  Eigen::MatrixXd z(n, d);
  z.leftCols(m) = given.transpose().replicate(n, 1);
  z.rightCols(d - m) = rest;
  return log_density(z).array() - block.log_density(given.transpose())[0];
}

Eigen::MatrixXd MapDistribution::conditional_sample(const Eigen::VectorXd& given, Eigen::Index n,
                                                    std::uint64_t seed) const {
  const Eigen::Index m = given.size(), d = dimension();
  if (m == 0) return sample(n, seed);
  if (!given.allFinite()) throw UsageError("conditional samples: a given value is not finite");
  const Eigen::RowVectorXd leading_reference = leading(m).map().inverse(given.transpose());
  Eigen::MatrixXd x(n, d);
  x.leftCols(m) = leading_reference.replicate(n, 1);
  x.rightCols(d - m) = numerics::monte_carlo_normal_points(n, d - m, seed);
  Eigen::MatrixXd z = map_.evaluate(x);
  z.leftCols(m) = given.transpose().replicate(n, 1);  // to the bit
  return z;
}

Eigen::MatrixXd MapDistribution::conditional_sample(std::span<const Eigen::Index> coordinates,
                                                    const Eigen::VectorXd& given, Eigen::Index n,
                                                    std::uint64_t seed) const {
  const auto m = static_cast<Eigen::Index>(coordinates.size());
  if (given.size() != m)
    throw UsageError(
        fmt::format("conditional samples: {} coordinates named, {} values given", m, given.size()));
  Eigen::VectorXd ordered = Eigen::VectorXd::Constant(m, std::numeric_limits<double>::quiet_NaN());
  for (Eigen::Index i = 0; i < m; ++i) {
    const Eigen::Index k = coordinates[static_cast<std::size_t>(i)];
    require_coordinate(k);
    if (k >= m || !std::isnan(ordered[k]))
      throw UsageError(
          fmt::format("conditional samples given coordinate {}: a triangular map has exact conditionals only "
                      "given its leading coordinates, here 0 to {}, each once; put the variables that will "
                      "be given first when making the map",
                      k, m - 1));
    ordered[k] = given[i];
  }
  return conditional_sample(ordered, n, seed);
}

}  // namespace knothe::transport
