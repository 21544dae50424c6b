#include "knothe/offline/latin/latin_separation.hpp"

#include <algorithm>
#include <limits>

#include "knothe/base/index.hpp"
#include "knothe/model/compress/cp_als.hpp"
#include "knothe/offline/full_order/dense_solvers.hpp"

namespace knothe::offline {

using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr std::size_t k_sweeps_for_growth = 20, k_sweeps_at_end = 200, k_sweeps_for_recompression = 20;

/// [R, n_t, n₁, …] with the roots of the weights, so that Frobenius' norm is that of Σ w cᵀc.
model::CoreTensor tensor_of(std::span<const MatrixXd> coordinates, const LatinGrid& grid) {
  const Index points = grid.points();
  const VectorXd roots = grid.point_weights().cwiseSqrt();
  model::CoreTensor tensor;
  tensor.unfolded.resize(coordinates.front().rows(), points * std::ssize(coordinates));
  for (Index t = 0; t < std::ssize(coordinates); ++t)
    tensor.unfolded.middleCols(points * t, points) = coordinates[t] * roots.asDiagonal();
  tensor.others.push_back(std::ssize(coordinates));
  tensor.others.insert(tensor.others.end(), grid.sizes.begin(), grid.sizes.end());
  return tensor;
}

LatinTerms terms_of(const model::CpFactors& cp, const LatinGrid& grid) {
  LatinTerms terms{cp.factors[0], cp.factors[1], {}};
  for (Index axis = 0; axis < std::ssize(grid.sizes); ++axis)
    terms.parameters.emplace_back(grid.weights[axis].cwiseSqrt().cwiseInverse().asDiagonal() *
                                  cp.factors[axis + 2]);
  terms.normalise();
  return terms;
}

model::CpFactors factors_of(const LatinTerms& terms, const LatinGrid& grid) {
  model::CpFactors cp;
  cp.factors = {terms.space, terms.time};
  for (Index axis = 0; axis < std::ssize(grid.sizes); ++axis)
    cp.factors.emplace_back(grid.weights[axis].cwiseSqrt().asDiagonal() * terms.parameters[axis]);
  return cp;
}

/// The term that the others can best do without goes, and they take over what they can of it in one of the
/// factors. With H the product of the Gram matrices of the other factors, what they cannot take over of term
/// k has the squared norm ‖f_k‖² / (H⁻¹)_kk, and the rest is theirs with −(H⁻¹)_lk / (H⁻¹)_kk.
void leave_out_cheapest(std::vector<MatrixXd>& factors) {
  const Index m = factors.front().cols();
  double least = std::numeric_limits<double>::infinity();
  Index gone = 0;
  std::size_t taking = 0;
  VectorXd share = VectorXd::Zero(m);
  for (Index f = 0; f < std::ssize(factors); ++f) {
    MatrixXd inverse = MatrixXd::Ones(m, m);
    for (Index other = 0; other < std::ssize(factors); ++other)
      if (other != f) inverse.array() *= (factors[other].transpose() * factors[other]).array();
    const VectorXd scale = inverse.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
    inverse = (scale.asDiagonal() * inverse * scale.asDiagonal()).eval();
    inverse.diagonal().array() += 1e-10;  // terms may be the same
    if (!invert_positive_definite(std::span(inverse.data(), inverse.size()), m)) continue;
    for (Index k = 0; k < m; ++k) {
      const double cost = factors[f].col(k).squaredNorm() / (inverse(k, k) * scale[k] * scale[k]);
      if (!(cost < least)) continue;
      least = cost;
      gone = k;
      taking = f;
      share = -inverse.col(k).cwiseProduct(scale) / (inverse(k, k) * scale[k]);
    }
  }
  std::vector<Index> kept;
  for (Index k = 0; k < m; ++k)
    if (k != gone) kept.push_back(k);
  share[gone] = 0;
  factors[taking] += (factors[taking].col(gone) * share.transpose()).eval();
  for (MatrixXd& factor : factors) factor = factor(Eigen::all, kept).eval();
}

}  // namespace

LatinTerms separate(std::span<const MatrixXd> coordinates, const LatinGrid& grid, Index most,
                    double tolerance) {
  const model::CoreTensor tensor = tensor_of(coordinates, grid);
  const double size = tensor.unfolded.norm();
  model::CpFactors cp;
  for (Index k = 0; k < most; ++k) {
    cp = model::als(tensor, model::with_one_more_mode(tensor, cp, k + 1), k_sweeps_for_growth);
    if (cp.error <= tolerance * size) break;
  }
  return terms_of(model::als(tensor, std::move(cp), k_sweeps_at_end), grid);
}

LatinTerms with_fewer_terms(const LatinTerms& terms, const LatinGrid& grid, Index most, double allowed) {
  if (terms.count() < 2) return terms;
  std::vector<MatrixXd> coordinates;
  for (Index t = 0; t < terms.time.rows(); ++t) coordinates.push_back(terms.coordinates(t));
  const model::CoreTensor tensor = tensor_of(coordinates, grid);
  const double size = tensor.unfolded.norm();
  LatinTerms best = terms;
  while (best.count() > 1) {
    model::CpFactors cp = factors_of(best, grid);  // one term goes, or more where there are far too many
    for (Index k = std::max<Index>(1, (best.count() - most) / 4); k > 0; --k) leave_out_cheapest(cp.factors);
    cp = model::als(tensor, std::move(cp), k_sweeps_for_recompression);
    if (best.count() <= most && !(cp.error <= allowed * size)) break;
    best = terms_of(cp, grid);
  }
  return best;
}

}  // namespace knothe::offline
