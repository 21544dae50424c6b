#include "knothe/assimilation/forecast/crack_meta_model.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/numerics/linear/dense_svd.hpp"

namespace knothe::assimilation {
namespace {

void check(std::span<const double> lengths, const Eigen::Ref<const Eigen::MatrixXd>& solutions) {
  if (lengths.size() < 4)
    throw DataError(
        fmt::format("crack/length: {} crack lengths; a cubic spline needs at least 4", lengths.size()));
  if (solutions.rows() != std::ssize(lengths) || solutions.cols() == 0)
    throw DataError(
        fmt::format("crack solutions: shape [{}, {}], but there are {} crack lengths and at least one "
                    "observed dof is needed",
                    solutions.rows(), solutions.cols(), lengths.size()));
  for (Index i = 0; i < std::ssize(lengths); ++i) {
    if (!std::isfinite(lengths[i]) || (i > 0 && lengths[i] <= lengths[i - 1]))
      throw DataError(fmt::format("crack/length[{}] = {}: lengths must be finite and strictly increasing", i,
                                  lengths[i]));
  }
  for (Index i = 0; i < solutions.rows(); ++i)
    for (Index j = 0; j < solutions.cols(); ++j)
      if (!std::isfinite(solutions(i, j)))
        throw DataError(fmt::format("crack solutions[{},{}] is not finite", i, j));
}

/// Smallest number of modes that leaves out at most `tolerance` of the whole, in the Frobenius norm.
Index modes_for(const Eigen::VectorXd& singular_values, double tolerance) {
  const double allowed = tolerance * singular_values.norm();
  double left_out = 0.0;
  Index modes = singular_values.size();
  while (modes > 1) {
    left_out = std::hypot(left_out, singular_values[modes - 1]);
    if (left_out > allowed) break;
    --modes;
  }
  return modes;
}

}  // namespace

CrackMetaModel::CrackMetaModel(std::span<const double> lengths,
                               const Eigen::Ref<const Eigen::MatrixXd>& solutions, double relative_tolerance)
    : lengths_(lengths.begin(), lengths.end()), basis_((check(lengths, solutions), lengths)) {
  // Transposed against the paper (one row per length): solutions = V D Uᵀ.
  const numerics::DenseSvd svd = numerics::dense_svd(solutions);
  singular_values_ = svd.values;
  const Index modes = modes_for(singular_values_, relative_tolerance);
  space_ = svd.right.leftCols(modes) * singular_values_.head(modes).asDiagonal();
  coefficients_ = (basis_.coefficients_from_values() * svd.left.leftCols(modes)).transpose();
}

Eigen::MatrixXd CrackMetaModel::coordinates(std::span<const double> lengths) const {
  Eigen::MatrixXd result(modes(), std::ssize(lengths));
  for (Index j = 0; j < result.cols(); ++j) evaluate(lengths[j], result.col(j));
  return result;
}

void CrackMetaModel::evaluate(double length, Eigen::Ref<Eigen::VectorXd> value) const {
  const auto local = basis_.evaluate(std::clamp(length, lengths_.front(), lengths_.back()));
  value.noalias() =
      coefficients_.middleCols<4>(local.first) * Eigen::Map<const Eigen::Vector4d>(local.value.data());
}

}  // namespace knothe::assimilation
