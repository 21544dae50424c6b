#pragma once
/// @file Between Eigen inside and std::vector at the library's border. Not installed.
#include <Eigen/Core>
#include <span>
#include <string>
#include <vector>

#include "knothe/base/error.hpp"
#include "knothe/library/posterior.hpp"
#include "knothe/posterior/posterior.hpp"

namespace knothe::library {

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

[[nodiscard]] inline std::vector<double> plain(const Eigen::VectorXd& v) {
  return {v.data(), v.data() + v.size()};
}
/// In C order.
[[nodiscard]] inline std::vector<double> plain(const Eigen::MatrixXd& matrix) {
  std::vector<double> rows(matrix.size());
  Eigen::Map<RowMajor>(rows.data(), matrix.rows(), matrix.cols()) = matrix;
  return rows;
}
[[nodiscard]] inline Posterior plain(const posterior::Posterior& r) {
  Posterior p;
  p.mean = plain(r.mean);
  p.covariance = plain(r.covariance);
  p.maximum_a_posteriori = plain(r.maximum_a_posteriori);
  p.levels.assign(numerics::k_quantile_levels.begin(), numerics::k_quantile_levels.end());
  p.quantiles = plain(r.quantiles);
  p.points = plain(r.points);
  p.weights = plain(r.weights);
  p.log_evidence = r.log_evidence;
  p.map_order = r.map_order;
  p.variance_diagnostic = r.variance_diagnostic;
  p.effective_sample_size = r.effective_sample_size;
  p.tolerance_reached = r.tolerance_reached;
  p.trusted = r.trusted;
  p.remark = r.remark;
  return p;
}
[[nodiscard]] inline Eigen::VectorXd vector_of(std::span<const double> values) {
  return Eigen::Map<const Eigen::VectorXd>(values.data(), std::ssize(values));
}
/// Rows of `columns` numbers. UsageError, "`what`: …", if it does not come out even.
[[nodiscard]] inline Eigen::MatrixXd rows_of(std::span<const double> values, std::size_t columns,
                                             const char* what) {
  if (columns == 0 || values.size() % columns != 0)
    throw UsageError(std::string(what) + ": " + std::to_string(values.size()) +
                     " numbers are not a multiple of " + std::to_string(columns) + " coordinates");
  return Eigen::Map<const RowMajor>(values.data(), values.size() / columns, columns);
}

}  // namespace knothe::library
