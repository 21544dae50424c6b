#include "knothe/assimilation/forecast/quantity_of_interest.hpp"

#include <fmt/core.h>

#include <cmath>
#include <utility>

#include "knothe/base/error.hpp"

namespace knothe::assimilation {

QuantityOfInterest::QuantityOfInterest(std::shared_ptr<const model::ParameterFunctions> functions,
                                       double offset, Eigen::VectorXd coefficients, double threshold,
                                       double error_std)
    : functions_(std::move(functions)),
      offset_(offset),
      coefficients_(std::move(coefficients)),
      threshold_(threshold),
      error_std_(error_std) {
  if (coefficients_.size() != functions_->count())
    throw DataError(
        fmt::format("quantity of interest: {} coefficients, but the model has {} parameter functions",
                    coefficients_.size(), functions_->count()));
  if (!coefficients_.allFinite() || !std::isfinite(offset_) || !std::isfinite(threshold_))
    throw DataError("quantity of interest: offset, coefficients and threshold must be finite");
}

Eigen::VectorXd QuantityOfInterest::evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points) const {
  model::FunctionBatch batch;
  batch.resize(points.rows(), points.cols(), functions_->count(), 0);
  functions_->evaluate(points, 0, batch);
  return values(batch.value);
}

ScalarForecast QuantityOfInterest::update(const Eigen::Ref<const Eigen::MatrixXd>& points,
                                          const Eigen::Ref<const Eigen::VectorXd>& weights) const {
  return forecast(evaluate(points), weights);
}

Eigen::VectorXd QuantityOfInterest::values(const Eigen::Ref<const model::RowMatrix>& functions) const {
  return (functions * coefficients_).array() + offset_;
}

ScalarForecast QuantityOfInterest::forecast(const Eigen::Ref<const Eigen::VectorXd>& values,
                                            const Eigen::Ref<const Eigen::VectorXd>& weights) const {
  return forecast_of_samples(values, weights, threshold_, error_std_);
}

}  // namespace knothe::assimilation
