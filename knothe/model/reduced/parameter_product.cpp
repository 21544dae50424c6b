#include "knothe/model/reduced/parameter_product.hpp"

#include <Eigen/Cholesky>

#include "knothe/base/index.hpp"
#include "knothe/model/reduced/deviation.hpp"
#include "knothe/model/reduced/tensor_product.hpp"
#include "knothe/numerics/functions/cubic_spline.hpp"
#include "knothe/numerics/integrate/quadrature.hpp"

namespace knothe::model {

namespace {

/// ∫ c cᵀ of the cardinal splines on one axis, scaled to length 1. Four Gauss points between two nodes: exact
/// for products of cubics.
Eigen::MatrixXd spline_gram(std::span<const double> nodes) {
  const numerics::CubicSplineBasis basis(nodes);
  const double length = nodes.back() - nodes.front();
  Eigen::MatrixXd gram = Eigen::MatrixXd::Zero(basis.size(), basis.size());
  for (Index i = 0; i + 1 < std::ssize(nodes); ++i) {
    const numerics::Quadrature rule = numerics::gauss_legendre(4, nodes[i], nodes[i + 1]);
    for (Index q = 0; q < rule.weights.size(); ++q) {
      const Eigen::VectorXd value = basis.cardinal_weights(rule.nodes[q]);
      gram.noalias() += rule.weights[q] / length * value * value.transpose();
    }
  }
  return gram;
}

}  // namespace

ParameterProduct::ParameterProduct(std::span<const Axis> axes, const CompressionOptions& options) {
  for (const Axis& axis : axes) {
    Eigen::MatrixXd& own = factors_.emplace_back();
    // Canonical form: alternating least squares found worse minima in the norm of splines
    // (docs/explanation/reduction.md).
    if (options.parameter_norm == ParameterNorm::nodes || options.form == Form::canonical) {
      own = trapezoid_weights(axis.nodes).cwiseSqrt().asDiagonal();
    } else {
      own = spline_gram(axis.nodes).llt().matrixL();
    }
    transposed_.emplace_back(own.transpose());
    inverse_transposed_.emplace_back(own.transpose().triangularView<Eigen::Upper>().solve(
        Eigen::MatrixXd::Identity(own.rows(), own.rows())));
  }
}

namespace {

Eigen::MatrixXd multiplied(const std::vector<Eigen::MatrixXd>& factors, Eigen::MatrixXd columns) {
  multiply_along_axes(std::span(columns.data(), columns.size()), factors.size(),
                      [&](std::size_t i) -> const Eigen::MatrixXd& { return factors[i]; });
  return columns;
}

}  // namespace

Eigen::MatrixXd ParameterProduct::times(Eigen::MatrixXd columns) const {
  return multiplied(factors_, std::move(columns));
}

Eigen::MatrixXd ParameterProduct::transposed_times(Eigen::MatrixXd columns) const {
  return multiplied(transposed_, std::move(columns));
}

Eigen::MatrixXd ParameterProduct::at_nodes(Eigen::MatrixXd coordinates) const {
  return multiplied(inverse_transposed_, std::move(coordinates));
}

}  // namespace knothe::model
