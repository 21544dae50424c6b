#include "knothe/reduction/crack_modes.hpp"

#include <fmt/format.h>

#include <Eigen/SVD>

#include "knothe/base/error.hpp"

namespace knothe::reduction {

CrackSolutions crack_modes(std::span<const double> lengths, std::span<const double> values) {
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  if (lengths.empty() || values.size() % lengths.size() != 0)
    throw DataError(
        fmt::format("crack solutions: {} values for {} crack lengths", values.size(), lengths.size()));
  const auto n = static_cast<Eigen::Index>(lengths.size());
  const Eigen::Map<const RowMajor> solutions(values.data(), n, static_cast<Eigen::Index>(values.size()) / n);
  const Eigen::BDCSVD<Eigen::MatrixXd> svd(solutions, Eigen::ComputeThinU | Eigen::ComputeThinV);
  Eigen::Index kept = 0;
  while (kept < svd.singularValues().size() && svd.singularValues()[kept] > 1e-10 * svd.singularValues()[0])
    ++kept;
  const RowMajor modes = svd.matrixV().leftCols(kept).transpose();
  const RowMajor coefficients = svd.matrixU().leftCols(kept) * svd.singularValues().head(kept).asDiagonal();
  return {{lengths.begin(), lengths.end()},
          {modes.data(), modes.data() + modes.size()},
          {coefficients.data(), coefficients.data() + coefficients.size()}};
}

}  // namespace knothe::reduction
