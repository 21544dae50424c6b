#pragma once
/// @file A small model that is wrong, for this room's tests of bias and alarms.
#include <Eigen/Core>
#include <cmath>
#include <memory>
#include <numbers>
#include <span>
#include <vector>

#include "knothe/model/observe/observed_model.hpp"
#include "knothe/model/reduced/spline_functions.hpp"
#include "knothe/numerics/linear/incremental_svd.hpp"

namespace knothe::likelihood::test {

/// A front y = tanh((x − a t)/(0.2 b)) that runs along x with speed a and width b: what canonical separation
/// is worst at. The model is its best with `r` modes, from 9 × 9 parameter points.
struct Front {
  static constexpr Eigen::Index n = 20, n_t = 24;
  std::shared_ptr<model::ObservedModel> model = std::make_shared<model::ObservedModel>();
  double error = 0;  ///< root mean square of what the modes leave

  /// `uneven`: the speed is a (1 + uneven cos 2πt/n_t), which no model here knows: the front is where it
  /// should be at the beginning, in the middle and at the end.
  static Eigen::MatrixXd field(double a, double b, double uneven = 0) {
    Eigen::MatrixXd y(n, n_t);
    for (Eigen::Index t = 0; t < n_t; ++t) {
      const double turn = 2 * std::numbers::pi / static_cast<double>(n_t);
      const double passed = static_cast<double>(t) + uneven / turn * std::sin(turn * static_cast<double>(t));
      for (Eigen::Index i = 0; i < n; ++i)
        y(i, t) = std::tanh((0.05 * static_cast<double>(i + 1) - a * passed / 32) / (0.2 * b));
    }
    return y;
  }

  explicit Front(Eigen::Index r = 3) {
    std::vector<double> nodes;
    for (int k = 0; k < 9; ++k) nodes.push_back(0.5 + 0.125 * k);
    Eigen::MatrixXd all(n * n_t, 81);
    for (int i = 0; i < 9; ++i)
      for (int j = 0; j < 9; ++j) all.col(9 * i + j) = field(nodes[i], nodes[j]).reshaped();
    const Eigen::VectorXd mean = all.rowwise().mean();
    all.colwise() -= mean;
    numerics::IncrementalSvd svd(n * n_t, 40, 81);
    for (Eigen::Index k = 0; k < 81; ++k) svd.append(all.col(k));
    const Eigen::MatrixXd basis = svd.space().leftCols(r);
    const model::RowMatrix coordinates = basis.transpose() * all;  // r × grid
    error = (all - basis * coordinates).norm() / std::sqrt(static_cast<double>(all.size()));
    model->functions = std::make_shared<model::JointFunctions>(
        std::vector<std::vector<double>>{nodes, nodes},
        std::span(coordinates.data(), static_cast<std::size_t>(coordinates.size())), r);
    model->parameters = {"a", "b"};
    model->space = Eigen::MatrixXd::Identity(n, n);
    model->lift = mean.reshaped(n, n_t);
    for (Eigen::Index t = 0; t < n_t; ++t) {
      model->time.push_back(static_cast<double>(t));
      model->core.emplace_back(basis.middleRows(n * t, n));
    }
  }
};

}  // namespace knothe::likelihood::test
