#include "knothe/transport/point_tables.hpp"

#include <cassert>
#include <map>
#include <utility>

#include "knothe/sampling/log_density.hpp"

namespace knothe::transport {

namespace {

using Key = std::vector<std::pair<int, int>>;

/// The factors of an index in the variables below `below`.
Key key_of(const MultiIndex& index, int below) {
  Key key;
  for (const auto& f : index.factors)
    if (f.variable < below) key.emplace_back(f.variable, f.degree);
  return key;
}

}  // namespace

MapLayout::MapLayout(Eigen::Index dimension, int order) {
  const TriangularMap map(dimension, order);
  for (Eigen::Index k = 0; k < dimension; ++k) {
    const MapComponent& c = map.component(k);
    const int variable = static_cast<int>(k);
    Component mine{c.offset, c.constant_count(), c.monotone_count(), {0}};
    std::map<Key, Eigen::Index> column;
    for (std::size_t m = 0; m < c.constant.size(); ++m) {
      column[key_of(c.constant[m], variable)] = static_cast<Eigen::Index>(m);
      to_map_.push_back(c.offset + static_cast<Eigen::Index>(m));
    }
    const std::size_t e_begin = to_map_.size();
    to_map_.resize(e_begin + c.monotone.size());
    for (int j = 0; j < order; ++j)
      mine.group_begin.push_back(mine.group_begin.back() + total_order_count(variable, order - 1 - j));
    for (std::size_t m = 0; m < c.monotone.size(); ++m) {
      const auto j = static_cast<std::size_t>(c.monotone[m].degree_of(variable));
      const Eigen::Index at = mine.group_begin[j] + column.at(key_of(c.monotone[m], variable));
      to_map_[e_begin + static_cast<std::size_t>(at)] =
          c.offset + c.constant_count() + static_cast<Eigen::Index>(m);
    }
    components_.push_back(std::move(mine));
  }
}

void MapLayout::gather(const Eigen::VectorXd& map_coefficients, Eigen::VectorXd& table_order) const {
  table_order.resize(size());
  for (Eigen::Index i = 0; i < size(); ++i)
    table_order[i] = map_coefficients[to_map_[static_cast<std::size_t>(i)]];
}

void MapLayout::scatter(const Eigen::VectorXd& table_order, Eigen::VectorXd& map_coefficients) const {
  map_coefficients.resize(size());
  for (Eigen::Index i = 0; i < size(); ++i)
    map_coefficients[to_map_[static_cast<std::size_t>(i)]] = table_order[i];
}

PointTables::PointTables(Eigen::MatrixXd points, int order, const TailedHermite& basis)
    : points_(std::move(points)), order_(order) {
  const Eigen::Index n = points_.rows(), d = points_.cols(), packed = order * (order + 1) / 2;
  TailedHermite::Values values{}, first{}, second{};
  std::vector<double> integrals(static_cast<std::size_t>(packed));
  std::vector<Eigen::MatrixXd> tangent;
  const auto products = [n](const std::vector<MultiIndex>& indices,
                            const std::vector<Eigen::MatrixXd>& factors) {
    Eigen::MatrixXd product = Eigen::MatrixXd::Ones(n, static_cast<Eigen::Index>(indices.size()));
    for (std::size_t m = 0; m < indices.size(); ++m)
      for (const auto& f : indices[m].factors)
        product.col(static_cast<Eigen::Index>(m)).array() *=
            factors[static_cast<std::size_t>(f.variable)].col(f.degree).array();
    return product;
  };
  for (Eigen::Index k = 0; k < d; ++k) {
    Eigen::MatrixXd psi(n, order + 1), integral(n, packed), psi_tangent(n, order + 1);
    for (Eigen::Index i = 0; i < n; ++i) {
      basis.level(points_(i, k), order, values, first, second);
      for (Eigen::Index j = 0; j <= order; ++j) psi(i, j) = values[static_cast<std::size_t>(j)];
      basis.tangent(points_(i, k), order, values, first, second);
      for (Eigen::Index j = 0; j <= order; ++j) psi_tangent(i, j) = values[static_cast<std::size_t>(j)];
      basis.product_integrals(points_(i, k), order - 1, integrals);
      for (Eigen::Index j = 0; j < packed; ++j) integral(i, j) = integrals[static_cast<std::size_t>(j)];
    }
    psi_.push_back(std::move(psi));
    tangent.push_back(std::move(psi_tangent));
    integrals_.push_back(std::move(integral));
    const auto indices = total_order_indices(static_cast<int>(k), order);
    constant_prefix_.push_back(products(indices, tangent));
    prefix_.push_back(products(indices, psi_));
  }
}

void ComponentValues::evaluate_slope(const PointTables& tables, const MapLayout& layout, int order,
                                     Eigen::Index k, const Eigen::VectorXd& coefficients) {
  const auto& c = layout.components()[static_cast<std::size_t>(k)];
  const auto& prefix = tables.prefix(k);
  const auto& psi = tables.psi(k);
  const Eigen::Index n = prefix.rows();
  b.resize(n, order);
  h.resize(n);
  for (Eigen::Index j = 0; j < order; ++j) {
    const double* a = coefficients.data() + c.monotone_begin() + c.group_begin[static_cast<std::size_t>(j)];
    auto column = b.col(j);
    column.setConstant(a[0]);  // the first prefix column is 1
    for (Eigen::Index m = 1; m < c.group_size(j); ++m) column += a[m] * prefix.col(m);
    if (j == 0)
      h = column;
    else
      h.array() += column.array() * psi.col(j).array();
  }
}

void ComponentValues::evaluate(const PointTables& tables, const MapLayout& layout, int order, Eigen::Index k,
                               const Eigen::VectorXd& coefficients) {
  evaluate_slope(tables, layout, order, k, coefficients);
  const auto& c = layout.components()[static_cast<std::size_t>(k)];
  const auto& prefix = tables.constant_prefix(k);
  const auto& integrals = tables.integrals(k);
  g.resize(b.rows(), order);
  value.resize(b.rows());
  value.setConstant(coefficients[c.offset]);
  for (Eigen::Index m = 1; m < c.constant_count; ++m) value += coefficients[c.offset + m] * prefix.col(m);
  for (Eigen::Index j = 0; j < order; ++j) {
    auto column = g.col(j).array();
    column = integrals.col(sampling::packed_index(j, 0)).array() * b.col(0).array();
    for (Eigen::Index l = 1; l < order; ++l)
      column += integrals.col(sampling::packed_index(j, l)).array() * b.col(l).array();
    value.array() += b.col(j).array() * column;
  }
}

}  // namespace knothe::transport
