#include "knothe/model/compress/cp_als.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "knothe/base/index.hpp"
#include "knothe/model/compress/low_rank.hpp"

namespace knothe::model {

namespace {

/// Columns ⊗_{k ≥ 1} factors[k].col(c), the last index fastest: (n₁ … n_D) × m.
Eigen::MatrixXd khatri_rao(const std::vector<Eigen::MatrixXd>& factors) {
  Eigen::MatrixXd result = factors[1];
  for (Index k = 2; k < std::ssize(factors); ++k) {
    Eigen::MatrixXd next(result.rows() * factors[k].rows(), result.cols());
    for (Index c = 0; c < result.cols(); ++c) {
      const Eigen::MatrixXd outer = factors[k].col(c) * result.col(c).transpose();
      next.col(c) = outer.reshaped();
    }
    result = std::move(next);
  }
  return result;
}

/// Hadamard product of the Gram matrices of all factors but `left_out`.
Eigen::MatrixXd gram_of_others(const std::vector<Eigen::MatrixXd>& factors, Index left_out) {
  const Index m = factors.front().cols();
  Eigen::MatrixXd gram = Eigen::MatrixXd::Ones(m, m);
  for (Index k = 0; k < std::ssize(factors); ++k) {
    if (k != left_out) gram.array() *= (factors[k].transpose() * factors[k]).array();
  }
  return gram;
}

/// X with X · gram = right side. A ridge near rounding keeps nearly parallel modes from growing without
/// bound.
Eigen::MatrixXd solve(const Eigen::MatrixXd& gram, const Eigen::MatrixXd& right_side) {
  Eigen::MatrixXd ridged = gram;
  ridged.diagonal().array() += 1e-13 * gram.diagonal().maxCoeff() + 1e-300;
  return ridged.ldlt().solve(right_side.transpose()).transpose();
}

/// `slice` [n₁, …, n_D] contracted with column c of all factors but `kept` (numbered from 1).
Eigen::VectorXd contract_all_but(const Eigen::Ref<const Eigen::VectorXd>& slice,
                                 const std::vector<Eigen::MatrixXd>& factors, std::size_t kept, Index c) {
  Eigen::VectorXd rest = slice;
  for (std::size_t k = factors.size() - 1; k > kept; --k) {  // the last index is contiguous
    const Index n = factors[k].rows();
    rest = (rest.reshaped(n, rest.size() / n).transpose() * factors[k].col(c)).eval();
  }
  for (std::size_t k = 1; k < kept; ++k) {  // now the first index has the largest stride
    const Index n = factors[k].rows();
    rest = (rest.reshaped(rest.size() / n, n) * factors[k].col(c)).eval();
  }
  return rest;
}

/// Unit columns; a zero column stays.
void normalise(Eigen::MatrixXd& factor) {
  for (auto column : factor.colwise()) {
    const double norm = column.norm();
    if (norm > 0.0) column /= norm;
  }
}

/// One sweep over all factors; returns the squared error. The scale of the modes ends in the last factor.
double sweep(const CoreTensor& tensor, double squared_norm, std::vector<Eigen::MatrixXd>& factors) {
  normalise(factors.back());
  factors[0] = solve(gram_of_others(factors, 0), tensor.unfolded * khatri_rao(factors));
  normalise(factors[0]);
  const Eigen::MatrixXd contracted = tensor.unfolded.transpose() * factors[0];  // (n₁ … n_D) × m
  double squared_error = 0.0;
  for (Index k = 1; k < std::ssize(factors); ++k) {
    Eigen::MatrixXd right_side(factors[k].rows(), factors[k].cols());
    for (Index c = 0; c < right_side.cols(); ++c) {
      right_side.col(c) = contract_all_but(contracted.col(c), factors, k, c);
    }
    const Eigen::MatrixXd gram = gram_of_others(factors, k);
    factors[k] = solve(gram, right_side);
    if (k + 1 < std::ssize(factors)) {
      normalise(factors[k]);
    } else {
      const double inner = right_side.cwiseProduct(factors[k]).sum();
      const double own = gram.cwiseProduct(factors[k].transpose() * factors[k]).sum();
      squared_error = std::max(0.0, squared_norm - 2.0 * inner + own);
    }
  }
  return squared_error;
}

}  // namespace

CpFactors als(const CoreTensor& tensor, CpFactors start, std::size_t max_sweeps) {
  const double squared_norm = tensor.unfolded.squaredNorm();
  double before = squared_norm;
  int slow = 0;
  for (std::size_t i = 0; i < max_sweeps; ++i) {
    const double squared_error = sweep(tensor, squared_norm, start.factors);
    start.error = std::sqrt(squared_error);
    ++start.sweeps;
    slow = squared_error > before * (1.0 - 2e-5) ? slow + 1 : 0;
    before = squared_error;
    if (slow >= 5 || squared_error <= 1e-15 * squared_norm) break;
  }
  return start;
}

CpFactors random_start(const CoreTensor& tensor, Index modes, std::uint64_t seed) {
  CpFactors cp;
  cp.factors.push_back(normal_matrix(tensor.unfolded.rows(), modes, seed));
  for (Index k = 0; k < std::ssize(tensor.others); ++k) {
    cp.factors.push_back(normal_matrix(tensor.others[k], modes, seed + 1000003 * (k + 1)));
  }
  for (auto& factor : cp.factors) normalise(factor);
  return cp;
}

CpFactors with_one_more_mode(const CoreTensor& tensor, const CpFactors& start, std::uint64_t seed) {
  CoreTensor rest = tensor;
  if (!start.factors.empty()) rest.unfolded -= unfolded(start);
  CpFactors mode = als(rest, random_start(rest, 1, seed), 30);
  if (start.factors.empty()) return mode;
  CpFactors grown = start;
  for (Index k = 0; k < std::ssize(grown.factors); ++k) {
    grown.factors[k].conservativeResize(Eigen::NoChange, start.modes() + 1);
    grown.factors[k].rightCols(1) = mode.factors[k];
  }
  return grown;
}

Eigen::MatrixXd unfolded(const CpFactors& cp) {
  return cp.factors[0] * khatri_rao(cp.factors).transpose();
}

}  // namespace knothe::model
