#include "knothe/posterior/map/triangular_map.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <map>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/posterior/log_density.hpp"
#include "knothe/posterior/map/point_evaluation.hpp"

namespace knothe::posterior {

namespace {

Index position_of(const MultiIndex& index, const std::vector<MultiIndex>& set) {
  return std::find(set.begin(), set.end(), index) - set.begin();
}

/// Copies the coefficients of a set into those of a larger one. Sets that begin alike, as total orders do,
/// need no search.
void embed_set(const std::vector<MultiIndex>& from, const double* values, const std::vector<MultiIndex>& to,
               double* out) {
  std::map<std::vector<MultiIndex::Factor>, std::size_t> positions;
  for (Index m = 0; m < std::ssize(from); ++m) {
    std::size_t at = m;
    if (m >= std::ssize(to) || !(to[m] == from[m])) {
      if (positions.empty())
        for (Index i = 0; i < std::ssize(to); ++i) positions[to[i].factors] = i;
      const auto found = positions.find(from[m].factors);
      if (found == positions.end())
        throw UsageError("embedding a map: it has an index that the larger map has not");
      at = found->second;
    }
    out[at] = values[m];
  }
}

/// "x1^2 x3", counted from 1 as in the formulas.
std::string name_of(const MultiIndex& index) {
  std::string name;
  for (const auto& f : index.factors) {
    name += fmt::format("{}x{}", name.empty() ? "" : " ", f.variable + 1);
    if (f.degree > 1) name += fmt::format("^{}", f.degree);
  }
  return name.empty() ? "1" : name;
}

/// The coefficients of largest magnitude with their terms.
std::string largest_terms(const std::vector<MultiIndex>& set, const double* values) {
  constexpr std::size_t k_shown = 3;
  std::vector<std::size_t> order(set.size());
  for (Index m = 0; m < std::ssize(order); ++m) order[m] = m;
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return std::abs(values[a]) > std::abs(values[b]); });
  std::string text;
  for (std::size_t i = 0; i < std::min(k_shown, order.size()); ++i)
    if (i == 0 || values[order[i]] != 0)
      text += fmt::format("{}{:.4g} ({})", i == 0 ? "" : ", ", values[order[i]], name_of(set[order[i]]));
  return text;
}

}  // namespace

void MapBatch::resize(Index n, Index d, int derivatives) {
  value.resize(n, d);
  log_determinant.resize(n);
  jacobian.resize(derivatives >= 1 ? n : 0, derivatives >= 1 ? d * d : 0);
  hessian.resize(derivatives >= 2 ? n : 0, derivatives >= 2 ? d * (d * (d + 1) / 2) : 0);
}

TriangularMap::TriangularMap(Index dimension, int order, TailRadii radii)
    : TriangularMap(total_order_map(dimension, order, {Rectifier::square, radii})) {}

TriangularMap::TriangularMap(MapSpecification specification)
    : kernel_(std::make_shared<const MapKernel>(std::move(specification))) {
  coefficients_ = Eigen::VectorXd::Zero(structure().coefficient_count);
  if (parametrisation().rectifier != Rectifier::square) return;  // r(0) = 1 already
  for (const MapComponent& c : structure().components)
    coefficients_[c.offset + c.constant_count() + position_of({}, c.monotone)] = 1;
}

MapSpecification TriangularMap::specification() const {
  MapSpecification specification{parametrisation(), {}};
  for (const MapComponent& c : structure().components)
    specification.components.push_back({c.constant, c.monotone});
  return specification;
}

void TriangularMap::set_coefficients(const Eigen::VectorXd& coefficients) {
  if (coefficients.size() != coefficients_.size())
    throw UsageError(fmt::format("triangular map: {} coefficients given, the map has {}", coefficients.size(),
                                 coefficients_.size()));
  if (!coefficients.allFinite()) throw UsageError("triangular map: a coefficient is not finite");
  coefficients_ = coefficients;
}

void TriangularMap::embed(const TriangularMap& lower) {
  if (lower.dimension() != dimension() || !(lower.parametrisation() == parametrisation()))
    throw UsageError("embedding a map: it must have the dimension and the parametrisation of the larger one");
  Eigen::VectorXd embedded = Eigen::VectorXd::Zero(coefficients_.size());
  for (Index k = 0; k < dimension(); ++k) {
    const auto &mine = component(k), &theirs = lower.component(k);
    const double* values = lower.coefficients_.data() + theirs.offset;
    double* out = embedded.data() + mine.offset;
    embed_set(theirs.constant, values, mine.constant, out);
    embed_set(theirs.monotone, values + theirs.constant_count(), mine.monotone, out + mine.constant_count());
  }
  coefficients_ = std::move(embedded);
}

std::string TriangularMap::describe() const {
  std::string text;
  for (Index k = 0; k < dimension(); ++k) {
    const MapComponent& c = component(k);
    const double* a_c = coefficients_.data() + c.offset;
    int degree = 0;
    for (const auto* set : {&c.constant, &c.monotone})
      for (const MultiIndex& index : *set) degree = std::max(degree, index.total);
    text += fmt::format("component {}: {}, linear tails, {} + {} terms of degree up to {}; ", k + 1,
                        in_words(parametrisation().rectifier), c.constant.size(), c.monotone.size(), degree);
    text += fmt::format("largest: {}; inside the integral: {}\n", largest_terms(c.constant, a_c),
                        largest_terms(c.monotone, a_c + c.constant_count()));
  }
  return text;
}

void TriangularMap::evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives,
                             MapBatch& out) const {
  const Index n = points.rows(), d = dimension(), packed = d * (d + 1) / 2;
  assert(points.cols() == d);
  out.resize(n, d, derivatives);
  if (derivatives == 0) {
    kernel_->evaluate(coefficients_.data(), points, out.value, out.log_determinant);
    return;
  }
  out.jacobian.setZero();
  if (derivatives >= 2) out.hessian.setZero();
  PointEvaluation at(structure(), coefficients_.data());
  PointEvaluation::Derivatives result;
  for (Index i = 0; i < n; ++i) {
    out.log_determinant[i] = 0;
    for (Index k = 0; k < d; ++k) {
      at.set(k, points(i, k));
      at.derivatives(k, derivatives >= 2, result);
      out.value(i, k) = result.value;
      out.log_determinant[i] += result.log_slope;
      for (Index a = 0; derivatives >= 1 && a <= k; ++a) out.jacobian(i, k * d + a) = result.first[a];
      for (Index m = 0; m < std::ssize(result.second); ++m) out.hessian(i, k * packed + m) = result.second[m];
    }
  }
}

Eigen::MatrixXd TriangularMap::evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points) const {
  MapBatch batch;
  evaluate(points, 0, batch);
  return std::move(batch.value);
}

Eigen::VectorXd TriangularMap::log_determinant(const Eigen::Ref<const Eigen::MatrixXd>& points) const {
  MapBatch batch;
  evaluate(points, 0, batch);
  return std::move(batch.log_determinant);
}

Eigen::MatrixXd TriangularMap::inverse(const Eigen::Ref<const Eigen::MatrixXd>& z) const {
  assert(z.cols() == dimension());
  Eigen::MatrixXd x(z.rows(), z.cols());
  kernel_->invert(coefficients_.data(), z, x);
  return x;
}

}  // namespace knothe::posterior
