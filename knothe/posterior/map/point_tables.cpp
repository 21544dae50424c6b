#include "knothe/posterior/map/point_tables.hpp"

#include <algorithm>
#include <bit>
#include <cassert>
#include <cstdint>
#include <map>
#include <utility>

#include "knothe/base/index.hpp"
#include "knothe/posterior/log_density.hpp"

namespace knothe::posterior {

namespace {

/// The factors of an index in the variables below `below`.
MultiIndex prefix_of(const MultiIndex& index, int below) {
  MultiIndex prefix;
  for (const auto& f : index.factors)
    if (f.variable < below) prefix.factors.push_back(f), prefix.total += f.degree;
  return prefix;
}

/// The products of one-variable functions, n × (degree + 1) per variable, that a set of indices asks for.
Eigen::MatrixXd products(Index n, const std::vector<MultiIndex>& indices,
                         const std::vector<Eigen::MatrixXd>& factors) {
  Eigen::MatrixXd product(n, std::ssize(indices));
  for (Index m = 0; m < std::ssize(indices); ++m) {
    auto column = product.col(m);
    bool first = true;
    for (const auto& f : indices[m].factors) {
      const auto factor = factors[f.variable].col(f.degree);
      if (first)
        column = factor;
      else
        column.array() *= factor.array();
      first = false;
    }
    if (first) column.setOnes();
  }
  return product;
}

/// row(i, x) fills row i of every table for the coordinate x; tensor rules repeat their coordinates, for
/// which `copy(i, from)` takes the row made before. Looked up by open addressing: there are as many look-ups
/// as points, and most points have coordinates of their own.
template <class Row, class Copy>
void for_each_coordinate(const Eigen::Ref<const Eigen::VectorXd>& x, Row row, Copy copy) {
  const std::size_t size = std::bit_ceil(std::size_t{2} * x.size() + 2);
  std::vector<Index> made(size, -1);
  for (Index i = 0; i < x.size(); ++i) {
    const std::uint64_t mixed =
        std::bit_cast<std::uint64_t>(x[i]) * 0x9E3779B97F4A7C15U;  // Fibonacci hashing
    std::size_t at = (mixed >> 32) & (size - 1);
    while (made[at] >= 0 && x[made[at]] != x[i]) at = (at + 1) & (size - 1);
    if (made[at] < 0) {
      made[at] = i;
      row(i, x[i]);
    } else {
      copy(i, made[at]);
    }
  }
}

}  // namespace

MapLayout::MapLayout(const TriangularMap& map) {
  for (Index k = 0; k < map.dimension(); ++k) {
    const MapComponent& c = map.component(k);
    const int variable = k;
    Component mine{c.offset, c.constant_count(), c.monotone_count(), {}, c.constant, {MultiIndex{}}};
    for (Index m = 0; m < c.constant_count(); ++m) to_map_.push_back(c.offset + m);
    std::map<std::vector<MultiIndex::Factor>, Index> column{{{}, 0}};
    std::vector<std::vector<Index>> member;  // by degree: positions in c.monotone
    for (Index m = 0; m < std::ssize(c.monotone); ++m) {
      const std::size_t degree = c.monotone[m].degree_of(variable);
      MultiIndex prefix = prefix_of(c.monotone[m], variable);
      const auto [at, is_new] = column.try_emplace(prefix.factors, std::ssize(mine.prefix));
      if (is_new) mine.prefix.push_back(std::move(prefix));
      if (mine.groups.size() <= degree) mine.groups.resize(degree + 1), member.resize(degree + 1);
      mine.groups[degree].column.push_back(at->second);
      member[degree].push_back(m);
    }
    Index begin = 0;
    for (Index j = 0; j < std::ssize(mine.groups); ++j) {
      mine.groups[j].begin = begin;
      begin += mine.groups[j].size();
      for (const Index m : member[j]) to_map_.push_back(c.offset + c.constant_count() + m);
    }
    components_.push_back(std::move(mine));
  }
}

void MapLayout::gather(const Eigen::VectorXd& map_coefficients, Eigen::VectorXd& table_order) const {
  table_order.resize(size());
  for (Index i = 0; i < size(); ++i) table_order[i] = map_coefficients[to_map_[i]];
}

void MapLayout::scatter(const Eigen::VectorXd& table_order, Eigen::VectorXd& map_coefficients) const {
  map_coefficients.resize(size());
  for (Index i = 0; i < size(); ++i) map_coefficients[to_map_[i]] = table_order[i];
}

PointTables::PointTables(Eigen::MatrixXd points, const TriangularMap& map, const MapLayout& layout)
    : points_(std::move(points)), rectifier_(map.parametrisation().rectifier) {
  const Index n = points_.rows(), d = points_.cols();
  const OneVariableBasis& basis = map.basis();
  std::vector<int> constant_degree(d, 0), monotone_degree(constant_degree);
  for (const auto& c : layout.components()) {
    for (const MultiIndex& index : c.constant)
      for (const auto& f : index.factors) {
        auto& degree = constant_degree[f.variable];
        degree = std::max(degree, f.degree);
      }
    for (const MultiIndex& index : c.prefix)
      for (const auto& f : index.factors) {
        auto& degree = monotone_degree[f.variable];
        degree = std::max(degree, f.degree);
      }
  }
  OneVariableBasis::Values values{}, first{}, second{};
  std::vector<Eigen::MatrixXd> constant, monotone;
  for (Index k = 0; k < d; ++k) {
    const Index degrees = layout.component(k).degrees();
    const int nc = constant_degree[k];
    const int ne = std::max<int>(monotone_degree[k], degrees - 1);
    Eigen::MatrixXd c(n, nc + 1), e(n, ne + 1);
    for_each_coordinate(
        points_.col(k),
        [&](Index i, double x) {
          basis.constant(x, nc, values, first, second);
          for (Index j = 0; j <= nc; ++j) c(i, j) = values[j];
          basis.monotone(x, ne, values, first, second);
          for (Index j = 0; j <= ne; ++j) e(i, j) = values[j];
        },
        [&](Index i, Index from) { c.row(i) = c.row(from), e.row(i) = e.row(from); });
    psi_.push_back(e.leftCols(degrees));
    constant.push_back(std::move(c));
    monotone.push_back(std::move(e));
    integrals_.emplace_back();
    pieces_.emplace_back();
    if (rectifier_ == Rectifier::square)
      tabulate_integrals(basis, k, degrees);
    else
      tabulate_pieces(basis, k, degrees);
    constant_prefix_.push_back(products(n, layout.component(k).constant, constant));
    prefix_.push_back(products(n, layout.component(k).prefix, monotone));
  }
}

void PointTables::tabulate_integrals(const OneVariableBasis& basis, Index k, Index degrees) {
  const Index n = points_.rows(), packed = degrees * (degrees + 1) / 2;
  Eigen::MatrixXd& table = integrals_[k];
  table.resize(n, packed);
  const int degree = degrees - 1;
  std::vector<double> sums(packed);
  for_each_coordinate(
      points_.col(k),
      [&](Index i, double x) {
        basis.product_integrals(x, degree, sums);
        for (Index j = 0; j < packed; ++j) table(i, j) = sums[j];
      },
      [&](Index i, Index from) { table.row(i) = table.row(from); });
}

void PointTables::tabulate_pieces(const OneVariableBasis& basis, Index k, Index degrees) {
  const int degree = degrees - 1;
  OneVariableBasis::Values values{};
  double from = 0;
  for (const OneVariableBasis::Piece& stretch : basis.pieces(degree)) {
    Piece piece;
    for (Index i = 0; i < points_.rows(); ++i)
      if (std::abs(points_(i, k)) > from || from == 0) piece.rows.push_back(i);
    if (piece.rows.empty()) return;
    const UnitRule& unit = unit_rule(stretch.nodes);
    const auto rows = std::ssize(piece.rows);
    piece.nodes = stretch.nodes;
    piece.weight.resize(rows, piece.nodes);
    piece.psi.resize(rows, piece.nodes * degrees);
    Eigen::VectorXd x(rows);
    for (Index r = 0; r < rows; ++r) x[r] = points_(piece.rows[r], k);
    for_each_coordinate(
        x,
        [&](Index r, double at) {
          const double sign = at < 0 ? -1 : 1, width = std::min(std::abs(at), stretch.end) - from;
          for (Index q = 0; q < piece.nodes; ++q) {
            basis.monotone(sign * (from + width * unit.node[q]), degree, values);
            piece.weight(r, q) = sign * width * unit.weight[q];
            for (Index j = 0; j < degrees; ++j) piece.psi(r, q * degrees + j) = values[j];
          }
        },
        [&](Index r, Index other) {
          piece.weight.row(r) = piece.weight.row(other), piece.psi.row(r) = piece.psi.row(other);
        });
    pieces_[k].push_back(std::move(piece));
    from = stretch.end;
  }
}

}  // namespace knothe::posterior
