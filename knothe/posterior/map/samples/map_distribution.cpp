#include "knothe/posterior/map/samples/map_distribution.hpp"

#include <fmt/format.h>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/numerics/statistics/random.hpp"

namespace knothe::posterior {

namespace {

/// The first m components of a part, which depend on nothing else.
ComposedMap::Part leading_block(const ComposedMap::Part& part, Index m) {
  if (const auto* affine = std::get_if<AffineMap>(&part))
    return AffineMap{affine->shift.head(m), affine->lower.topLeftCorner(m, m)};
  const auto& map = std::get<TriangularMap>(part);
  MapSpecification specification = map.specification();
  specification.components.resize(m);
  TriangularMap block(std::move(specification));
  block.set_coefficients(map.coefficients().head(block.coefficients().size()));
  return block;
}

}  // namespace

MapDistribution::MapDistribution(ComposedMap map) : map_(std::move(map)) {
  if (map_.dimension() < 1) throw UsageError("distribution of a map: the map has no variables");
}

Eigen::VectorXd MapDistribution::log_density(const Eigen::Ref<const Eigen::MatrixXd>& z) const {
  return map_.log_density(z);
}

MapDistribution MapDistribution::leading(Index m) const {
  if (m < 1 || m > dimension())
    throw UsageError(fmt::format("the first {} coordinates of a map with {}", m, dimension()));
  for (const ComposedMap::Part& part : map_.parts())
    if (const auto* affine = std::get_if<AffineMap>(&part); affine != nullptr && !affine->is_triangular())
      throw UsageError(
          "marginal of the leading coordinates: the map is not triangular, it has a part that is turned to "
          "the "
          "principal axes; fit a triangular map (`triangular`; MapSolverOptions::orientation = "
          "Orientation::given), or weigh samples and condition those");
  if (m == dimension()) return *this;
  ComposedMap block(m);
  for (const auto& part : map_.parts()) block.append(leading_block(part, m));
  return MapDistribution(std::move(block));
}

Eigen::MatrixXd MapDistribution::conditional_reference(const Eigen::VectorXd& given, Index n,
                                                       std::uint64_t seed) const {
  const Index m = given.size(), d = dimension();
  if (m == 0) return numerics::monte_carlo_normal_points(n, d, seed);
  if (!given.allFinite()) throw UsageError("conditional samples: a given value is not finite");
  const Eigen::RowVectorXd leading_reference = leading(m).map().inverse(given.transpose());
  Eigen::MatrixXd x(n, d);
  x.leftCols(m) = leading_reference.replicate(n, 1);
  x.rightCols(d - m) = numerics::monte_carlo_normal_points(n, d - m, seed);
  return x;
}

}  // namespace knothe::posterior
