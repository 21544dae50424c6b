#include "knothe/model/observe/crack_modes.hpp"

#include <fmt/format.h>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/numerics/linear/dense_svd.hpp"

namespace knothe::model {

CrackSolutions crack_modes(std::span<const double> lengths, std::span<const double> values) {
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  if (lengths.empty() || values.size() % lengths.size() != 0)
    throw DataError(
        fmt::format("crack solutions: {} values for {} crack lengths", values.size(), lengths.size()));
  const auto n = std::ssize(lengths);
  const Eigen::Map<const RowMajor> solutions(values.data(), n, std::ssize(values) / n);
  const numerics::DenseSvd svd = numerics::dense_svd(solutions);
  Index kept = 0;
  while (kept < svd.values.size() && svd.values[kept] > 1e-10 * svd.values[0]) ++kept;
  const RowMajor modes = svd.right.leftCols(kept).transpose();
  const RowMajor coefficients = svd.left.leftCols(kept) * svd.values.head(kept).asDiagonal();
  return {{lengths.begin(), lengths.end()},
          {modes.data(), modes.data() + modes.size()},
          {coefficients.data(), coefficients.data() + coefficients.size()}};
}

}  // namespace knothe::model
