#pragma once
/// @file A small test of two parameters, and the verdict of it.
#include <Eigen/Core>
#include <array>
#include <memory>
#include <optional>
#include <vector>

#include "knothe/assimilation/update/sequential_update.hpp"
#include "knothe/assimilation/verdict/assessor.hpp"
#include "knothe/likelihood/testing/test_models.hpp"

namespace knothe::assimilation::test {

inline constexpr Eigen::Index k_case_sensors = 24, k_case_times = 30;

inline likelihood::DatumPointer datum_of(std::size_t step, std::size_t time_index,
                                         const Eigen::VectorXd& values) {
  return std::make_shared<const likelihood::Datum>(
      likelihood::Datum{{}, step, time_index, values, std::nullopt});
}

/// A model of two parameters on [0.5, 1.5]², and what is measured.
struct Bench {
  std::shared_ptr<const model::ObservedModel> model;
  model::Sensors sensors;
  likelihood::NoiseModel noise =
      likelihood::NoiseModel::independent(Eigen::VectorXd::Constant(k_case_sensors, 0.1));
  std::vector<posterior::Prior> priors;
  Eigen::Vector2d truth{0.9, 1.2};
  Eigen::MatrixXd data;
  std::vector<std::size_t> times;

  explicit Bench(unsigned seed = 1) {
    auto made = std::make_shared<model::ObservedModel>(*likelihood::test::random_model(
        std::make_shared<likelihood::test::CurvedFunctions>(), k_case_sensors, 4, k_case_times, 3));
    // Smooth in time, as a test is: a random walk of small steps.
    for (std::size_t t = 1; t < made->core.size(); ++t) {
      made->core[t] = made->core[t - 1] + 0.2 * made->core[t];
      made->lift.col(static_cast<Eigen::Index>(t)) = made->lift.col(static_cast<Eigen::Index>(t) - 1) +
                                                     0.2 * made->lift.col(static_cast<Eigen::Index>(t));
    }
    made->parameters = {"a", "b"};
    model = made;
    for (std::size_t i = 0; i < k_case_sensors; ++i) {
      const std::array<double, 3> at = {0.1 * static_cast<double>(i / 2), 0, 0};
      sensors.add(at, static_cast<std::int64_t>(i % 2));
    }
    priors = {posterior::Prior::normal(1, 0.3).truncated(0.5, 1.5, "a"),
              posterior::Prior::normal(1, 0.3).truncated(0.5, 1.5, "b")};
    data = likelihood::test::synthetic_data(*model, truth, noise.measurement().standard_deviations(), seed);
    for (std::size_t t = 0; t < k_case_times; ++t) times.push_back(t);
  }

  /// What the last sensor measures is a series of this name.
  void name_last_sensor(const std::string& name) {
    model::Sensors others;
    for (std::size_t i = 0; i + 1 < k_case_sensors; ++i) others.add(sensors.point(i), sensors.components[i]);
    others.scalars = {name};
    sensors = others;
  }

  /// The verdict after all data.
  [[nodiscard]] Verdict verdict(likelihood::RobustOptions robust = {},
                                model::ObservedErrors errors = {}) const {
    SequentialUpdate update(model, noise, priors);
    std::vector<likelihood::DatumPointer> examined;
    for (Eigen::Index t = 0; t < data.cols(); ++t) {
      const auto step = static_cast<std::size_t>(t);
      update.update(step, times[step], data.col(t));
      examined.push_back(datum_of(step, times[step], data.col(t)));
    }
    Assessor assessor(model, noise, priors, sensors, robust, std::move(errors), {});
    return assessor.assess({update.result(),
                            update.functions(),
                            &update.sums(),
                            update.form_of(update.result().step),
                            false,
                            {}},
                           AssessedData(examined));
  }

  [[nodiscard]] std::optional<MisfitCause> cause() const {
    for (const VerdictReason& reason : verdict().reasons)
      if (reason.part == VerdictPart::fit) return reason.cause;
    return {};
  }
};

}  // namespace knothe::assimilation::test
