#pragma once
/// @file All forecasts of a project, updated from each posterior.
#include <Eigen/Core>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "knothe/assimilation/forecast/crack_bridge.hpp"
#include "knothe/assimilation/forecast/forecast_specification.hpp"
#include "knothe/assimilation/forecast/quantity_of_interest.hpp"
#include "knothe/assimilation/forecast/scalar_forecast.hpp"
#include "knothe/model/reduced/separated_model.hpp"
#include "knothe/numerics/functions/lattice_table.hpp"

namespace knothe::assimilation {

/// One forecast after one step.
struct NamedForecast {
  std::string name;
  std::string units;
  ScalarForecast forecast;
  std::optional<double>
      bridge_residual_rms;  ///< m, crack length only: how far the elastic crack is from the field, dof by dof
  double horizon = 0;       ///< model time
  bool is_past = false;     ///< the horizon is before the last datum: what is told has been
  double threshold = 0;     ///< in its units, that of the probabilities
  bool threshold_stated = true;  ///< false: it is a default, of no interest to people
};

/// Sets `is_past` of forecasts made after a datum at model time `time`.
void mark_past(std::vector<NamedForecast>& forecasts, double time);

/// Forecasts by name. Everything that does not depend on the posterior is computed once.
class Forecaster {
 public:
  /// `seen`: the measured dofs, through which the crack bridge looks. Errors: DataError where the model lacks
  /// what a forecast needs, ProjectError for a horizon outside the model's time.
  Forecaster(const model::SeparatedModel& model, const model::Dofs& seen,
             const std::vector<ForecastSpecification>& specifications);

  /// From weighted points of the posterior (n × d, n).
  [[nodiscard]] std::vector<NamedForecast> update(const Eigen::Ref<const Eigen::MatrixXd>& points,
                                                  const Eigen::Ref<const Eigen::VectorXd>& weights);

  /// What Eq. 33 takes the predicted field for.
  enum class FieldDensity {
    normal,       ///< of its moments
    inverse_map,  ///< ρ(S(u)) |det ∇S(u)| of its inverse transport map S (§6.3.2); tenths of a second
  };
  /// The crack lengths by Eq. 33, beside those of `update`; with the discrepancy that is stated, else
  /// estimated.
  [[nodiscard]] std::vector<NamedForecast> published(const Eigen::Ref<const Eigen::MatrixXd>& points,
                                                     const Eigen::Ref<const Eigen::VectorXd>& weights,
                                                     FieldDensity density = FieldDensity::normal);

 private:
  struct Crack {
    std::string name;
    CrackBridge bridge;
    double offset;
    std::optional<double> discrepancy_std;
  };
  struct Scalar {
    std::string name, units;
    QuantityOfInterest quantity;
  };
  void evaluate_functions(const Eigen::Ref<const Eigen::MatrixXd>& points);
  [[nodiscard]] static NamedForecast forecast_of(const Crack& crack, CrackForecast found);
  [[nodiscard]] Eigen::MatrixXd values_at(const Eigen::MatrixXd& points);
  [[nodiscard]] std::vector<NamedForecast> forecasts_of(const Eigen::MatrixXd& values,
                                                        const Eigen::VectorXd& weights) const;
  [[nodiscard]] std::vector<NamedForecast> forecasts_from(const Eigen::MatrixXd& points,
                                                          const Eigen::VectorXd& weights);
  void add_crack(const model::SeparatedModel& model, const model::Dofs& seen,
                 const ForecastSpecification& specification);
  void add_scalar(const model::SeparatedModel& model, const ForecastSpecification& specification);
  /// Puts them in the project's order, each with its horizon and threshold.
  void complete(std::vector<NamedForecast>& forecasts) const;

  std::shared_ptr<const model::ParameterFunctions> functions_;
  std::vector<ForecastSpecification> specifications_;
  std::vector<Crack> cracks_;
  std::vector<Scalar> scalars_;
  std::optional<numerics::LatticeTable> table_;  ///< two for each crack, length and square; then the scalars
  model::FunctionBatch batch_;
};

}  // namespace knothe::assimilation
