#include "knothe/numerics/linear/incremental_svd.hpp"

#include <Eigen/SVD>
#include <algorithm>
#include <cassert>

#include "knothe/base/index.hpp"

namespace knothe::numerics {
namespace {

/// A part of a column that is smaller than this, relative to the column and to the largest singular value,
/// is rounding: it names no direction.
constexpr double k_rounding = 1e-14;

constexpr Index k_orthonormal_every = 32;

/// The first columns of x times `by` into x, rows by rows that stay in the cache.
void turn(Eigen::MatrixXd& x, const Eigen::MatrixXd& by) {
  constexpr Index k_block = 512;
  Eigen::MatrixXd block;
  for (Index first = 0; first < x.rows(); first += k_block) {
    const Index count = std::min(k_block, x.rows() - first);
    block.noalias() = x.block(first, 0, count, by.rows()) * by;
    x.block(first, 0, count, by.cols()) = block;
  }
}

}  // namespace

IncrementalSvd::IncrementalSvd(Index rows, Index rank, Index window)
    : most_(std::min(rank, rows)), window_(window) {
  assert(rows >= 1 && rank >= 1 && window >= 1);
  space_.setZero(rows, most_ + 1);
  value_.setZero(most_ + 1);
  time_.setZero(window_ + 1, most_ + 1);
}

void IncrementalSvd::append(const Eigen::Ref<const Eigen::VectorXd>& column) {
  assert(column.size() == space_.rows() && column.allFinite());
  const Index k = rank_;
  // a = U c + ρ q. Gram-Schmidt twice: after the second pass q is orthogonal to U to rounding.
  Eigen::VectorXd rest = column;
  Eigen::VectorXd inside = space().transpose() * rest;
  rest.noalias() -= space() * inside;
  const Eigen::VectorXd again = space().transpose() * rest;
  rest.noalias() -= space() * again;
  inside += again;
  const double rho = rest.norm();
  const double largest = std::max(column.norm(), k > 0 ? value_[0] : 0.0);
  const bool grows = k < space_.rows() && rho > k_rounding * largest;

  // The small matrix [diag(s) c; 0 ρ].
  const Index m = grows ? k + 1 : k;
  Eigen::MatrixXd small = Eigen::MatrixXd::Zero(m, k + 1);
  small.topLeftCorner(k, k) = singular_values().asDiagonal();
  small.topRightCorner(k, 1) = inside;
  if (grows) {
    small(k, k) = rho;
    space_.col(k) = rest / rho;
    // q carries the rounding of the subtraction, enlarged by |a|/ρ: once more, now that it has unit length.
    const Eigen::VectorXd leak = space_.leftCols(k).transpose() * space_.col(k);
    space_.col(k).noalias() -= space_.leftCols(k) * leak;
    space_.col(k).normalize();
  }

  // V gains a row and a column: [V 0; 0 1]. The oldest row falls out of the window.
  if (kept_ == window_) {
    for (Index i = 0; i + 1 < window_; ++i) time_.row(i) = time_.row(i + 1);
    --kept_;
  }
  time_.col(k).head(kept_).setZero();
  time_.row(kept_).setZero();
  time_(kept_, k) = 1;
  ++kept_;
  ++columns_;
  if (m == 0) return;  // only zeros so far

  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(small, Eigen::ComputeThinU | Eigen::ComputeThinV);
  const Eigen::VectorXd& s = svd.singularValues();
  rank_ = std::min(m, most_);
  turn(space_, svd.matrixU().leftCols(rank_));
  if (columns_ % k_orthonormal_every == 0) {
    // One step of Newton and Schulz towards the nearest orthonormal matrix: products of thousands of turns
    // would drift.
    const Eigen::MatrixXd gram = space().transpose() * space();
    turn(space_, 1.5 * Eigen::MatrixXd::Identity(rank_, rank_) - 0.5 * gram);
  }
  const Eigen::MatrixXd times = time_.topLeftCorner(kept_, k + 1) * svd.matrixV().leftCols(rank_);
  time_.topLeftCorner(kept_, rank_) = times;
  value_.head(rank_) = s.head(rank_);
}

}  // namespace knothe::numerics
