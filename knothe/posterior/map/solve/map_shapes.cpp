#include "knothe/posterior/map/solve/map_shapes.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <utility>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/numerics/integrate/sobol.hpp"

namespace knothe::posterior {
namespace {

constexpr std::uint64_t k_training_seed = 0x7261696e;  // never that of the verification points
/// Maps with a long first variable: so many times the order of the others, and no more than that.
constexpr int k_longer = 4, k_longer_in_width = 2, k_longest = k_max_order;
/// Nodes along a long variable: what makes it long are features that fewer nodes step over
/// (docs/explanation/transport.md, "A long first variable").
constexpr int k_long_nodes = 96;
/// Lighter nodes of a tensor rule only stall the minimiser.
constexpr double k_lightest_node = 1e-11;

/// Symmetric quasi-random points whose mean is exactly 0 and whose covariance is exactly the identity, so
/// that a Gaussian target has exactly its affine map.
numerics::PointRule quasi_random_rule(Index n, Index d) {
  Eigen::MatrixXd points(n, d);
  points.topRows(n / 2) = numerics::sobol_normal_points(n / 2, d, k_training_seed);
  points.bottomRows(n / 2) = -points.topRows(n / 2);
  const Eigen::MatrixXd covariance = points.transpose() * points / n;
  const Eigen::MatrixXd white = covariance.llt().matrixL().solve(points.transpose());
  return {white.transpose(), Eigen::VectorXd::Constant(n, 1.0 / n)};
}

/// Order in each variable: the highest degree in a Φ_c, or one more than that in a Φ_e.
std::vector<int> orders_of(const TriangularMap& map) {
  std::vector<int> orders(map.dimension(), 1);
  for (Index k = 0; k < map.dimension(); ++k) {
    for (const MultiIndex& index : map.component(k).constant)
      for (const auto& f : index.factors) orders[f.variable] = std::max(orders[f.variable], f.degree);
    for (const MultiIndex& index : map.component(k).monotone)
      for (const auto& f : index.factors) orders[f.variable] = std::max(orders[f.variable], f.degree + 1);
  }
  return orders;
}

bool less(const Parametrisation& a, const Parametrisation& b) {
  const auto key = [](const Parametrisation& p) {
    return std::tuple(p.rectifier, p.radii.level, p.radii.bend, p.radii.tangent);
  };
  return key(a) < key(b);
}

/// The training rule is chosen with the order: 2p + 4 Gauss–Hermite nodes per axis, p the order in that
/// variable, in up to three dimensions; beyond, twelve quasi-random points per coefficient of the largest
/// component.
numerics::PointRule default_training_rule(const MapShape& shape) {
  const Index d = shape.identity.dimension();
  if (d <= 3) {
    std::vector<numerics::Quadrature> rules;
    const std::vector<int> orders = orders_of(shape.identity);
    const bool is_long = d > 1 && orders.front() > orders.back();
    for (Index k = 0; k < std::ssize(orders); ++k)
      rules.push_back(numerics::gauss_hermite(k == 0 && is_long ? k_long_nodes : 2 * orders[k] + 4));
    return numerics::tensor_rule(rules, k_lightest_node);
  }
  Index most = 0;
  for (const auto& c : shape.layout.components()) most = std::max(most, c.count());
  Index n = 1024;
  while (n < 12 * most) n *= 2;
  return quasi_random_rule(n, d);
}

}  // namespace

bool MapShapes::Less::operator()(const Key& a, const Key& b) const {
  if (std::get<0>(a) != std::get<0>(b)) return std::get<0>(a) < std::get<0>(b);
  if (std::get<1>(a) != std::get<1>(b)) return std::get<1>(a) < std::get<1>(b);
  return less(std::get<2>(a), std::get<2>(b));
}

MapShape& MapShapes::of_order(Index d, int order, const Parametrisation& parametrisation) {
  auto& shape = shapes_[{d, order, parametrisation}];
  if (!shape) {
    MapSpecification specification =
        options_.family ? options_.family(d, order) : total_order_map(d, order, parametrisation);
    if (specification.dimension() != d)
      throw UsageError(
          fmt::format("map solver: the map family gives a map in {} dimensions for a density in {}",
                      specification.dimension(), d));
    specification.parametrisation = parametrisation;
    shape = std::make_unique<MapShape>(std::move(specification));
  }
  return *shape;
}

MapShape& MapShapes::long_of_order(Index d, int order) {
  auto& shape = long_shapes_[{d, order}];
  if (!shape) {
    std::vector<int> orders(d, order);
    orders.front() = std::min(k_longer * order, k_longest);
    MapSpecification specification = per_variable_map(orders, options_.parametrisation);
    // How the *width* across the ridge changes along it needs less than where the ridge is, and the pairs of
    // its functions are what costs.
    orders.front() = std::min(k_longer_in_width * order, k_longest);
    const MapSpecification shorter = per_variable_map(orders, options_.parametrisation);
    for (Index k = 1; k < std::ssize(orders); ++k)
      specification.components[k].monotone = shorter.components[k].monotone;
    shape = std::make_unique<MapShape>(std::move(specification));
  }
  return *shape;
}

MapShape& MapShapes::of(const TriangularMap& map) {
  // Copies of a map share their structure, hence the address tells.
  const auto same = [&](const MapShape& shape) { return &shape.identity.component(0) == &map.component(0); };
  for (auto& [key, shape] : shapes_)
    if (same(*shape)) return *shape;
  for (auto& [key, shape] : long_shapes_)
    if (same(*shape)) return *shape;
  if (!foreign_ || !same(*foreign_)) {
    foreign_ = std::make_unique<MapShape>(map.specification());
    foreign_->identity = map;
  }
  return *foreign_;
}

const TrainingTables& MapShapes::training_tables(MapShape& shape) {
  if (!shape.training) {
    numerics::PointRule rule = options_.nodes_per_axis > 0
                                   ? numerics::tensor_rule(numerics::gauss_hermite(options_.nodes_per_axis),
                                                           shape.identity.dimension(), k_lightest_node)
                                   : default_training_rule(shape);
    shape.training = std::make_unique<TrainingTables>(std::move(rule), shape.identity);
  }
  return *shape.training;
}

const VerificationTables& MapShapes::verification_tables(MapShape& shape, Index n, bool is_broad) {
  auto& tables = shape.verification[{n, is_broad}];
  if (tables) return *tables;
  const Index d = shape.identity.dimension();
  tables = std::make_unique<VerificationTables>();
  Eigen::MatrixXd& points = tables->reference;
  points.resize(n, d);
  if (is_broad) {
    points.topRows(n / 2) = numerics::sobol_normal_points(n / 2, d, options_.seed);
    points.bottomRows(n / 2) = k_broad * numerics::sobol_normal_points(n / 2, d, options_.seed + 0x62726f61);
  } else {
    // With matched moments an affine map of a Gaussian target gives mean and covariance exactly.
    points = numerics::sobol_normal_points(n, d, options_.seed);
    if (n > d) numerics::match_standard_moments(points);
  }
  tables->log_reference = standard_normal_log_density(points);
  if (is_broad) {
    const Eigen::ArrayXd narrow = tables->log_reference.array();
    const Eigen::ArrayXd wide = standard_normal_log_density(points / k_broad).array() - d * std::log(k_broad);
    const Eigen::ArrayXd top = narrow.max(wide);
    tables->log_reference = top + (0.5 * (narrow - top).exp() + 0.5 * (wide - top).exp()).log();
  }
  if (shape.identity.parametrisation().rectifier == Rectifier::square)
    tables->points = PointTables(points, shape.identity, shape.layout);
  return *tables;
}

void MapShapes::prepare(MapShape& shape, bool with_broad) {
  (void)training_tables(shape);
  (void)verification_tables(shape, options_.verification_points);
  if (!with_broad) return;
  for (const int more : {2, 4}) (void)verification_tables(shape, more * options_.verification_points, true);
}

}  // namespace knothe::posterior
