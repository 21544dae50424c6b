#pragma once
/// @file Decides from a posterior what to do next (docs/explanation/decisions.md).
#include <Eigen/Core>
#include <memory>
#include <optional>
#include <vector>

#include "knothe/assimilation/decide/decision.hpp"
#include "knothe/assimilation/decide/expected_information.hpp"
#include "knothe/assimilation/forecast/quantity_history.hpp"
#include "knothe/assimilation/update/update_result.hpp"
#include "knothe/likelihood/noise/gaussian_noise.hpp"
#include "knothe/model/reduced/loading.hpp"

namespace knothe::assimilation {

/// Plans the measurements that are worth their cost among those that the risk allows now, and chooses the
/// first of them: a load that is passed does not come again. A function of the posterior, its verdict and the
/// present time alone.
///
/// Failure by time T has the probability P(T) = P(max of q between now and T > threshold), q with the
/// forecast's own model error and, where the reduced model's error is known, with that too. An increment may
/// add the share of `risk` that it is of the whole load, so that all increments after the first datum
/// together add no more than `risk`. Under `caution` the posterior of q is widened; under `reject` there is
/// no load.
class Decider {
 public:
  /// `observed`: `model` at the sensors, at its own times; `noise`: of a measurement; `prior_std`: d;
  /// `forecasts`: those of the project. Errors: ProjectError for options that name what is not there, a
  /// forecast without threshold, or times outside the model; and as of `QuantityHistory`.
  Decider(const model::SeparatedModel& model, std::shared_ptr<const model::ObservedModel> observed,
          const model::Dofs& seen, const likelihood::GaussianNoise& noise, const Eigen::VectorXd& prior_std,
          const std::vector<ForecastSpecification>& forecasts, DecisionOptions options);

  /// After the data of a step; `posterior` has its verdict. `data`: the sum of their quadratic forms, r × r,
  /// or empty; then the posterior's covariance stands for what is known everywhere.
  [[nodiscard]] Decision decide(const UpdateResult& posterior, const Eigen::MatrixXd& data = {});

 private:
  [[nodiscard]] std::size_t present(double time) const;
  [[nodiscard]] std::vector<double> risk_from(const UpdateResult& posterior, std::size_t now) const;
  [[nodiscard]] double allowed(double present, std::size_t then, double failed) const;
  void require_step(double increment) const;
  [[nodiscard]] bool is_increment(std::size_t now, std::size_t then, double increment) const;
  [[nodiscard]] bool is_offered(std::size_t now, std::size_t then) const;
  void look_from(const UpdateResult& posterior, const Eigen::MatrixXd& draws, const Eigen::MatrixXd& data);
  [[nodiscard]] Eigen::MatrixXd rows_about(const Eigen::MatrixXd& draws) const;
  void explain(std::size_t now, const std::vector<double>& risk, Decision& decision) const;
  void put_load(Decision& decision) const;

  DecisionOptions options_;
  std::vector<double> time_;  ///< of the model
  std::size_t end_;           ///< index of the last time to load to
  ForecastSpecification failure_specification_;
  std::string units_;  ///< of its quantity
  QuantityHistory failure_;
  std::optional<QuantityHistory> learnt_;  ///< the forecast to learn about
  TimePosition horizon_;                   ///< of it
  Eigen::MatrixXd about_;                  ///< the parameters to learn about
  Eigen::VectorXd prior_std_;
  ExpectedInformation information_;
  model::Loading loading_;
};

}  // namespace knothe::assimilation
