#pragma once
/// @file Vectors and matrices as JSON. Private to the room.
#include <Eigen/Core>
#include <nlohmann/json.hpp>
#include <vector>

namespace knothe::record {

[[nodiscard]] inline nlohmann::ordered_json to_json(const Eigen::Ref<const Eigen::VectorXd>& v) {
  return std::vector<double>(v.begin(), v.end());
}

/// One array per row.
[[nodiscard]] inline nlohmann::ordered_json rows_of(const Eigen::MatrixXd& m) {
  auto rows = nlohmann::ordered_json::array();
  for (Eigen::Index i = 0; i < m.rows(); ++i) rows.push_back(to_json(m.row(i).transpose()));
  return rows;
}

}  // namespace knothe::record
