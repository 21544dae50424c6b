#include "knothe/transport/extras/map_distribution.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "knothe/base/error.hpp"
#include "knothe/numerics/integrate/sobol.hpp"
#include "knothe/numerics/statistics/random.hpp"

namespace knothe::transport {

namespace {

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
    return affine == nullptr || affine->is_triangular();
  });
}

void MapDistribution::require_triangular(const char* what) const {
  if (is_triangular()) return;
  throw UsageError(fmt::format(
      "{}: the map is not triangular, it has a part that is turned to the principal axes; "
      "fit a triangular map (`triangular`; MapSolverOptions::orientation = Orientation::given), or weigh "
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

numerics::Moments MapDistribution::moments(Eigen::Index points, std::uint64_t seed) const {
  if (dimension() <= 3) {
    const auto rule =
        numerics::tensor_rule(numerics::gauss_hermite(dimension() < 3 ? 32 : 20), dimension(), 1e-25);
    return numerics::moments_of(map_.evaluate(rule.points), rule.weights);
  }
  Eigen::MatrixXd x = numerics::sobol_normal_points(points, dimension(), seed);
  if (points > dimension()) numerics::match_standard_moments(x);
  return numerics::moments_of(map_.evaluate(x), Eigen::VectorXd::Ones(points));
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

Eigen::MatrixXd MapDistribution::conditional_reference(const Eigen::VectorXd& given, Eigen::Index n,
                                                       std::uint64_t seed) const {
  const Eigen::Index m = given.size(), d = dimension();
  if (m == 0) return numerics::monte_carlo_normal_points(n, d, seed);
  if (!given.allFinite()) throw UsageError("conditional samples: a given value is not finite");
  const Eigen::RowVectorXd leading_reference = leading(m).map().inverse(given.transpose());
  Eigen::MatrixXd x(n, d);
  x.leftCols(m) = leading_reference.replicate(n, 1);
  x.rightCols(d - m) = numerics::monte_carlo_normal_points(n, d - m, seed);
  return x;
}

Eigen::MatrixXd MapDistribution::conditional_sample(const Eigen::VectorXd& given, Eigen::Index n,
                                                    std::uint64_t seed) const {
  Eigen::MatrixXd z = map_.evaluate(conditional_reference(given, n, seed));
  z.leftCols(given.size()) = given.transpose().replicate(n, 1);  // to the bit
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
