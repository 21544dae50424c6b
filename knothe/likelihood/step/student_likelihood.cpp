#include "knothe/likelihood/step/student_likelihood.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "knothe/base/error.hpp"
#include "knothe/numerics/integrate/quadrature.hpp"

namespace knothe::likelihood {
namespace {

/// Of the rule that averages slope and curvature: a prediction much wider than the noise, as the prior's may
/// be, wants more nodes than one that is sure.
constexpr int k_nodes = 9;
/// So many factors 1 + e²/ν are multiplied before a logarithm is taken. None of them counts as more than
/// 1e36, so that the product is finite: so far out a value says nothing of the parameters.
constexpr Eigen::Index k_factors = 8;
constexpr double k_largest_factor = 1e36;

}  // namespace

StudentLikelihood::StudentLikelihood(std::shared_ptr<const model::ObservedModel> model,
                                     Eigen::VectorXd central, double degrees)
    : model_(std::move(model)), central_(std::move(central)), degrees_(degrees) {}

void StudentLikelihood::add(std::size_t time_index, const Eigen::Ref<const Eigen::VectorXd>& values,
                            const Eigen::Ref<const Eigen::VectorXd>& scale) {
  if (values.array().isInf().any())
    throw DataError("a measured value is infinite: give NaN for a missing value");
  const auto present = values.array() == values.array();
  Kept datum{time_index, values - model_->lift.col(time_index), {}, present.count()};
  datum.residual -= model_->space * (model_->core[time_index] * central_).eval();
  datum.precision = present.select(scale.array().inverse(), 0.0);
  datum.residual = present.select(datum.residual.array() * datum.precision.array(), 0.0);
  const double of_one = std::lgamma(0.5 * (degrees_ + 1)) - std::lgamma(0.5 * degrees_) -
                        0.5 * std::log(degrees_ * std::numbers::pi);
  log_constant_ += datum.used * of_one - present.select(scale.array().log(), 0.0).sum();
  data_.push_back(std::move(datum));
}

void StudentLikelihood::raise(double power) {
  if (power == 0) data_.clear();
  for (Kept& datum : data_) datum.power *= power;
  log_constant_ *= power;
}

Eigen::MatrixXd StudentLikelihood::rows(const Kept& datum, const Eigen::MatrixXd& basis) const {
  return datum.precision.asDiagonal() * (model_->space * (model_->core[datum.time_index] * basis).eval());
}

Eigen::VectorXd StudentLikelihood::evaluate(const Eigen::VectorXd& origin, const Eigen::MatrixXd& basis,
                                            const Eigen::MatrixXd& coordinates) const {
  const Eigen::Index count = coordinates.cols();
  const Eigen::MatrixXd points = coordinates.transpose();
  Eigen::ArrayXd logarithms = Eigen::ArrayXd::Zero(count), product(count);
  Eigen::MatrixXd error(count, k_factors);
  for (const Kept& datum : data_) {
    const Eigen::VectorXd at_origin = datum.residual - rows(datum, origin);
    const Eigen::MatrixXd slope = rows(datum, basis).transpose();
    for (Eigen::Index first = 0; first < at_origin.size(); first += k_factors) {
      const Eigen::Index n = std::min(k_factors, at_origin.size() - first);
      error.leftCols(n).noalias() = points * slope.middleCols(first, n);
      product.setOnes();
      for (Eigen::Index j = 0; j < n; ++j)
        product *=
            1 + ((at_origin[first + j] - error.col(j).array()).square() / degrees_).min(k_largest_factor);
      logarithms += datum.power * product.log();
    }
  }
  return log_constant_ - 0.5 * (degrees_ + 1) * logarithms;
}

StepForm StudentLikelihood::linearise(const Eigen::VectorXd& mean, const Eigen::MatrixXd& factor,
                                      const Eigen::MatrixXd& basis) const {
  static const numerics::Quadrature rule = numerics::gauss_hermite(k_nodes);
  StepForm form = StepForm::zero(basis.cols());
  for (const Kept& datum : data_) {
    const Eigen::ArrayXd expected = datum.residual - rows(datum, mean);
    const Eigen::ArrayXd spread = rows(datum, factor).rowwise().norm();
    Eigen::ArrayXd slope = Eigen::ArrayXd::Zero(expected.size()), curvature = slope;
    for (Eigen::Index k = 0; k < rule.nodes.size(); ++k) {
      const Eigen::ArrayXd error = expected + rule.nodes[k] * spread;
      const Eigen::ArrayXd square = error.square(),
                           per = datum.power * rule.weights[k] * (degrees_ + 1) / (degrees_ + square);
      slope += per * error;  // towards the value
      curvature += per * (degrees_ - square) / (degrees_ + square);
    }
    const Eigen::MatrixXd direction = rows(datum, basis);
    form.linear.noalias() += direction.transpose() * slope.matrix();
    form.quadratic.noalias() +=
        direction.transpose() * (curvature.max(0.0).matrix().asDiagonal() * direction);
  }
  form.quadratic = 0.5 * (form.quadratic + form.quadratic.transpose().eval());
  return form;
}

Eigen::VectorXd StudentLikelihood::precision_factors(const Eigen::VectorXd& mean,
                                                     const Eigen::MatrixXd& factor) const {
  const Kept& datum = data_.back();
  const Eigen::ArrayXd square = (datum.residual - rows(datum, mean)).array().square() +
                                rows(datum, factor).rowwise().squaredNorm().array();
  return (datum.precision.array() > 0)
      .select((degrees_ + 1) / (degrees_ + square), std::numeric_limits<double>::quiet_NaN());
}

StepForm StudentLikelihood::gaussian_form(const Eigen::VectorXd& precision_factors) const {
  const Kept& datum = data_.back();
  const auto present = datum.precision.array() > 0;
  const Eigen::ArrayXd factor = present.select(precision_factors.array(), 0.0);
  const Eigen::MatrixXd weighted = datum.precision.cwiseProduct(factor.matrix()).asDiagonal() * model_->space;
  const Eigen::MatrixXd& core = model_->core[datum.time_index];
  StepForm form;
  form.quadratic = core.transpose() *
                   (model_->space.transpose() * (datum.precision.asDiagonal() * weighted)).eval() * core;
  form.quadratic = 0.5 * (form.quadratic + form.quadratic.transpose().eval());
  form.linear = core.transpose() * (weighted.transpose() * datum.residual).eval();
  form.constant = (factor * datum.residual.array().square()).sum();
  form.log_normaliser = datum.used * std::log(2 * std::numbers::pi) -
                        present.select(factor * datum.precision.array().square(), 1.0).log().sum();
  form.used = datum.used;
  form.missing = factor.size() - datum.used;
  return form;
}

}  // namespace knothe::likelihood
