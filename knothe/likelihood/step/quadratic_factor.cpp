#include "knothe/likelihood/step/quadratic_factor.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>

namespace knothe::likelihood {
namespace {

constexpr double k_negligible = 1e-10;  ///< of a log-likelihood

}  // namespace

void QuadraticFactor::compute(const Eigen::MatrixXd& quadratic, const Eigen::VectorXd& linear,
                              const Eigen::VectorXd& magnitude) {
  const Eigen::Index r = linear.size();
  assert(quadratic.rows() == r && quadratic.cols() == r && magnitude.size() == r);
  const bool bounded = magnitude.allFinite();
  const double rounding = 4.0 * r * std::numeric_limits<double>::epsilon();
  lower_.setZero(r, r);
  solution_.setZero(r);
  remainder_ = linear;
  diagonal_ = quadratic.diagonal();  // of S; zero once a row is a pivot's
  for (rank_ = 0; rank_ < r; ++rank_) {
    Eigen::Index pivot = -1;
    double largest = 0, felt = 0;
    for (Eigen::Index i = 0; i < r; ++i) {
      if (!(diagonal_[i] > rounding * quadratic(i, i))) continue;
      const double weight = bounded ? std::sqrt(diagonal_[i]) * magnitude[i] : diagonal_[i] / quadratic(i, i);
      felt += weight;
      if (weight > largest) {
        largest = weight;
        pivot = i;
      }
    }
    if (pivot < 0 || (bounded && felt * felt <= 2 * k_negligible)) break;
    const double root = std::sqrt(diagonal_[pivot]);
    auto column = lower_.col(rank_);
    column = quadratic.col(pivot);
    column.noalias() -= lower_.leftCols(rank_) * lower_.row(pivot).head(rank_).transpose();
    column /= root;
    for (Eigen::Index i = 0; i < r; ++i)
      if (diagonal_[i] == 0) column[i] = 0;  // rows of earlier pivots, exactly
    column[pivot] = root;
    solution_[rank_] = remainder_[pivot] / root;
    remainder_ -= solution_[rank_] * column;
    remainder_[pivot] = 0;
    diagonal_ = (diagonal_.array() - column.array().square()).max(0.0);
    diagonal_[pivot] = 0;
  }
  if (bounded && remainder_.cwiseAbs().dot(magnitude) <= k_negligible) remainder_.setZero();
}

}  // namespace knothe::likelihood
