#pragma once
/// @file A quantity of interest at every time of the model: when it passes a threshold.
#include <Eigen/Core>
#include <string>
#include <vector>

#include "knothe/assimilation/forecast/crack_bridge.hpp"
#include "knothe/assimilation/forecast/forecast_inputs.hpp"
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

 private:
  [[nodiscard]] Eigen::VectorXd lengths(const CrackBridge& crack, const model::RowMatrix& functions) const;

  std::vector<CrackBridge> cracks_;  ///< one for each time, of a crack length
  double offset_ = 0;                ///< of a crack length
  LinearQuantity linear_;            ///< of any other quantity, at each time; of a crack length w alone
};

}  // namespace knothe::assimilation
