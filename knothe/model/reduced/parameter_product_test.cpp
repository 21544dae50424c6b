#include "knothe/model/reduced/parameter_product.hpp"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <cmath>

#include "knothe/model/reduced/deviation.hpp"
#include "knothe/model/testing/test_models.hpp"
#include "knothe/numerics/functions/cubic_spline.hpp"
#include "knothe/numerics/linear/dense_svd.hpp"

namespace knothe::model {
namespace {

constexpr std::size_t k_dofs = 15;

Snapshots front() {
  return snapshots_of(travelling_front(k_dofs), two_axes(),
                      {0.1, 0.2, 0.4, 0.5, 0.7, 0.8, 0.9, 1.0, 1.1, 1.2, 1.4, 1.5}, k_dofs);
}

/// ∫ f fᵀ over an axis by a fine midpoint rule, f the cardinal splines: independent of ParameterProduct.
Eigen::MatrixXd sampled_gram(std::span<const double> nodes) {
  const numerics::CubicSplineBasis basis(nodes);
  constexpr int k_samples = 40000;
  const double length = nodes.back() - nodes.front();
  Eigen::MatrixXd gram = Eigen::MatrixXd::Zero(basis.size(), basis.size());
  for (int i = 0; i < k_samples; ++i) {
    const Eigen::VectorXd f = basis.cardinal_weights(nodes.front() + length * (i + 0.5) / k_samples);
    gram += f * f.transpose() / k_samples;
  }
  return gram;
}

TEST(ParameterProduct, TreeIsOptimalInTheNormOfSplines) {
  // ‖e‖² = tr(E W Eᵀ), W = ⊗ M, against the tail of the singular values of the whole matrix times W^½.
  const Snapshots snapshots = front();
  const Deviation deviation(snapshots);
  const auto dofs = static_cast<Eigen::Index>(k_dofs);
  const Eigen::MatrixXd first = sampled_gram(snapshots.axes[0].nodes),
                        second = sampled_gram(snapshots.axes[1].nodes);
  Eigen::MatrixXd w(30, 30);
  for (Eigen::Index p = 0; p < 30; ++p) {
    for (Eigen::Index q = 0; q < 30; ++q) w(p, q) = first(p / 6, q / 6) * second(p % 6, q % 6);
  }
  const Eigen::MatrixXd root = Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(w).operatorSqrt();
  Eigen::MatrixXd field(12 * dofs, 30);
  for (Eigen::Index t = 0; t < 12; ++t) {
    field.middleRows(t * dofs, dofs) =
        std::sqrt(deviation.time_weights()[t]) * deviation.at_time(t).transpose();
  }
  const Eigen::VectorXd sigma = numerics::singular_values(field * root);
  const std::vector<std::size_t> modes{2, 5, 9};
  for (const StudiedModel& studied : compression_study(snapshots, {}, modes)) {
    const SeparatedModel model(studied.model);
    Eigen::MatrixXd error(12 * dofs, 30);
    for (std::size_t g = 0; g < 30; ++g) {
      for (std::size_t t = 0; t < 12; ++t) {
        const auto start = static_cast<Eigen::Index>(t) * dofs;
        const FieldDerivatives at = model.evaluate(snapshots.parameters_at(g), t);
        const Eigen::Map<const Eigen::VectorXd> value(at.value.data(), dofs),
            u(snapshots.solution(g).data() + start, dofs);
        error.col(static_cast<Eigen::Index>(g)).segment(start, dofs) =
            std::sqrt(deviation.time_weights()[static_cast<Eigen::Index>(t)]) * (u - value);
      }
    }
    const double best = sigma.tail(30 - static_cast<Eigen::Index>(studied.row.parameter_modes)).norm();
    EXPECT_GE((error * root).norm(), best * (1 - 1e-6));
    EXPECT_LE((error * root).norm(), best * 1.001);
    // β is orthonormal in W.
    const auto r = static_cast<Eigen::Index>(studied.row.parameter_modes);
    const Eigen::Map<const RowMatrix> beta(studied.model.joint.data(), r, 30);
    EXPECT_LT((beta * w * beta.transpose() - Eigen::MatrixXd::Identity(r, r)).norm(), 1e-6);
  }
}

}  // namespace
}  // namespace knothe::model
