#pragma once
/// @file A quantity of interest at every time of the model: when it passes a threshold.
#include <Eigen/Core>
#include <memory>
#include <string>
#include <vector>

#include "knothe/assimilation/forecast/crack_bridge.hpp"
#include "knothe/assimilation/forecast/forecast_specification.hpp"
#include "knothe/model/reduced/separated_model.hpp"

namespace knothe::assimilation {

class QuantityHistory {
 public:
  /// The quantity of `specification`, whose horizon means nothing here. `seen`: the measured dofs, through
  /// which the crack bridge looks. Errors: as of `Forecaster`.
  QuantityHistory(const model::SeparatedModel& model, const model::Dofs& seen,
                  const ForecastSpecification& specification);

  /// q at parameters `points` (n × d) and the model's times `first`, `first` + 1, …: n × `count`, in its
  /// unit, without the model's error.
  [[nodiscard]] Eigen::MatrixXd values(const Eigen::Ref<const Eigen::MatrixXd>& points, std::size_t first,
                                       Index count) const;

  [[nodiscard]] const std::string& units() const { return units_; }

 private:
  [[nodiscard]] Eigen::VectorXd lengths(const CrackBridge& crack, const model::RowMatrix& functions) const;

  /// w of the model; of an output its value at each time.
  std::shared_ptr<const model::ParameterFunctions> functions_;
  std::string units_ = "m";
  std::vector<CrackBridge> cracks_;  ///< one for each time, of a crack length
  double offset_ = 0;                ///< of a crack length
  Eigen::VectorXd lift_;             ///< of a displacement, one for each time
  Eigen::MatrixXd coefficients_;     ///< likewise, r × times
};

}  // namespace knothe::assimilation
