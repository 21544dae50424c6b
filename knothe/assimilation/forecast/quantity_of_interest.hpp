#pragma once
/// @file Any other predicted number: a displacement, a crack opening, a reaction force.
#include <Eigen/Core>
#include <memory>

#include "knothe/assimilation/forecast/scalar_forecast.hpp"
#include "knothe/model/reduced/parameter_functions.hpp"

namespace knothe::assimilation {

/// q(p) = offset + coefficients · w(p) (Rubio et al. 2019, Eq. 14). For the displacement of a point: offset
/// its lift at the horizon, coefficients its row of (O U) C_T; for an output kept as functions of p: those
/// functions.
class QuantityOfInterest {
 public:
  /// `threshold` and `error_std`, the standard deviation of what the model leaves out (added in `update`),
  /// are in the unit of q. Errors: DataError if the number of coefficients is not that of `functions`, or a
  /// number is not finite.
  QuantityOfInterest(std::shared_ptr<const model::ParameterFunctions> functions, double offset,
                     Eigen::VectorXd coefficients, double threshold, double error_std = 0);

  /// q(p) at points of p (n × d), without the error.
  [[nodiscard]] Eigen::VectorXd evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points) const;
  /// The distribution of q under the weighted posterior points (n × d, n).
  [[nodiscard]] ScalarForecast update(const Eigen::Ref<const Eigen::MatrixXd>& points,
                                      const Eigen::Ref<const Eigen::VectorXd>& weights) const;
  /// Its halves where w at the points (n × r), or q there (n), is at hand.
  [[nodiscard]] Eigen::VectorXd values(const Eigen::Ref<const model::RowMatrix>& functions) const;
  [[nodiscard]] ScalarForecast forecast(const Eigen::Ref<const Eigen::VectorXd>& values,
                                        const Eigen::Ref<const Eigen::VectorXd>& weights) const;
  /// Whether it is one of these functions' values.
  [[nodiscard]] bool is_of(const model::ParameterFunctions& functions) const {
    return functions_.get() == &functions;
  }
  [[nodiscard]] double threshold() const { return threshold_; }

 private:
  std::shared_ptr<const model::ParameterFunctions> functions_;
  double offset_;
  Eigen::VectorXd coefficients_;
  double threshold_, error_std_;
};

}  // namespace knothe::assimilation
