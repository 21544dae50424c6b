#include "knothe/reduction/model/parameter_product.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/numerics/functions/cubic_spline.hpp"
#include "knothe/numerics/integrate/quadrature.hpp"
#include "knothe/reduction/model/deviation.hpp"

namespace knothe::reduction {

namespace {

/// M + s² K of one axis. Four Gauss points between two nodes: exact for products of cubics.
Eigen::MatrixXd spline_gram(std::span<const double> nodes, double s) {
  const numerics::CubicSplineBasis basis(nodes);
  const double length = nodes.back() - nodes.front();
  Eigen::MatrixXd gram = Eigen::MatrixXd::Zero(basis.size(), basis.size());
  for (std::size_t i = 0; i + 1 < nodes.size(); ++i) {
    const numerics::Quadrature rule = numerics::gauss_legendre(4, nodes[i], nodes[i + 1]);
    for (Eigen::Index q = 0; q < rule.weights.size(); ++q) {
      const double x = rule.nodes[q], weight = rule.weights[q] / length;
      const Eigen::VectorXd value = basis.cardinal_weights(x);
      gram.noalias() += weight * value * value.transpose();
      if (s == 0.0) continue;
      const Eigen::VectorXd slope = s * length * basis.cardinal_weights(x, 1);
      gram.noalias() += weight * slope * slope.transpose();
    }
  }
  return gram;
}

}  // namespace

ParameterProduct::ParameterProduct(std::span<const Axis> axes, const CompressionOptions& options) {
  const double s = options.sobolev_length;
  if (!(s >= 0.0 && std::isfinite(s))) {
    throw UsageError(fmt::format("the Sobolev length {} must not be negative", s));
  }
  factor_ = Eigen::MatrixXd::Ones(1, 1);
  for (const Axis& axis : axes) {
    Eigen::MatrixXd& own = factors_.emplace_back();
    // Canonical form: alternating least squares found worse minima in the norm of splines
    // (docs/reduction.md).
    if (options.parameter_norm == ParameterNorm::nodes || options.form == Form::canonical) {
      own = trapezoid_weights(axis.nodes).cwiseSqrt().asDiagonal();
    } else {
      own = spline_gram(axis.nodes, s).llt().matrixL();
    }
    const Eigen::Index n = own.rows();
    Eigen::MatrixXd product(factor_.rows() * n, factor_.cols() * n);  // the new axis varies fastest
    for (Eigen::Index a = 0; a < factor_.rows(); ++a) {
      for (Eigen::Index b = 0; b < factor_.cols(); ++b)
        product.block(a * n, b * n, n, n) = factor_(a, b) * own;
    }
    factor_ = std::move(product);
  }
}

Eigen::MatrixXd ParameterProduct::at_nodes(const Eigen::Ref<const Eigen::MatrixXd>& coordinates) const {
  return factor_.transpose().triangularView<Eigen::Upper>().solve(Eigen::MatrixXd(coordinates));
}

}  // namespace knothe::reduction
