#pragma once
/// @file Do the data look like the model plus the stated noise? Tests of the residuals at the posterior mean,
/// absolute and from the first datum on.
#include <Eigen/Core>
#include <array>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "knothe/assimilation/update/update_result.hpp"
#include "knothe/likelihood/data/data_set.hpp"
#include "knothe/likelihood/noise/noise_model.hpp"
#include "knothe/model/observe/observed_model.hpp"
#include "knothe/model/observe/sensors.hpp"

namespace knothe::assimilation {

/// What is compared with what pure noise would do. Each has one probability, of as much or more by chance;
/// where it is the extreme of many (sensors, values, steps) that is already counted in.
enum class ResidualTest {
  total,             ///< χ² of all values
  too_small,         ///< the same, lower tail
  group,             ///< χ² of a displacement component, or of a scalar series
  sensor,            ///< χ² of a sensor over time
  sensor_mean,       ///< mean of a sensor over time
  value,             ///< a single value
  step,              ///< χ² of a datum
  modes,             ///< χ² of the residuals' part in the span of the model's own space modes
  modes_mean,        ///< the mean of that part over time
  modes_slow,        ///< its means over successive eighths of the data
  time_neighbours,   ///< correlation of residuals that follow each other
  space_neighbours,  ///< correlation of residuals of the same component next to each other
  agreement,         ///< the parameters that a scalar series asks for and those that all data do
  constancy,         ///< the parameters before a time and after it (parameter_change.hpp)
  repeated           ///< a datum that is, to its last digits, the one before or one of the same time
};
inline constexpr std::size_t k_residual_tests = 15;

/// Tests whose failure alone says that the noise is not what was stated, not that the model is wrong.
[[nodiscard]] constexpr bool is_about_noise(ResidualTest test) {
  return test == ResidualTest::too_small || test == ResidualTest::time_neighbours ||
         test == ResidualTest::space_neighbours || test == ResidualTest::repeated;
}

struct ResidualReport {
  Eigen::Index values = 0;  ///< that are not missing
  double misfit = 0;        ///< χ² of all values
  std::array<double, k_residual_tests> probability{};
  std::array<Eigen::Index, k_residual_tests> at{};  ///< which group, sensor, value, datum, step; else 0
  /// n × m, one column per datum examined: residual over its standard deviation given the other sensors
  /// (independent noise: the standard deviation); 0 where missing.
  Eigen::MatrixXd scores;

  [[nodiscard]] double of(ResidualTest test) const { return probability[static_cast<std::size_t>(test)]; }
  void set(ResidualTest test, double p, Eigen::Index where = 0) {
    probability[static_cast<std::size_t>(test)] = p;
    at[static_cast<std::size_t>(test)] = where;
  }
  /// The test of the smallest probability: of those that do not only ask whether the noise is what it is said
  /// to be (`is_about_noise`) where one is below `limit`. A repeated datum comes before all.
  [[nodiscard]] ResidualTest worst(double limit) const;
  /// Whether a test says what chance does once in 1 / `limit`.
  [[nodiscard]] bool fails(double limit) const { return of(worst(limit)) < limit; }
};

/// Tests of data under one model and noise. Cost: one prediction of all data examined, O(n l m).
class ResidualTests {
 public:
  /// `sensors`: places and components of the model's observations, or empty: then there are no groups and no
  /// neighbours in space.
  ResidualTests(std::shared_ptr<const model::ObservedModel> model, likelihood::NoiseModel noise,
                model::Sensors sensors);

  /// At the functions `w` (r; the posterior mean). `level`: factor of all variances. `parameters`: how many
  /// values the fit can absorb. `lasting`: what the data say of the errors they have together, or nothing.
  [[nodiscard]] ResidualReport examine(std::span<const likelihood::DatumPointer> data,
                                       const Eigen::VectorXd& w, double level, Eigen::Index parameters,
                                       std::span<const EstimatedError> lasting = {});
  /// The same for scores that are known (those of a report, changed; 0: missing), independent noise.
  [[nodiscard]] ResidualReport examine_scores(Eigen::MatrixXd scores, Eigen::Index parameters) const;

  /// What each scalar series says of the parameters (`said_of_parameters`) by its scores in a report; none
  /// where their noise is not independent or there is nothing beside the one series.
  [[nodiscard]] std::vector<Eigen::MatrixXd> said_by_series(std::span<const likelihood::DatumPointer> data,
                                                            const ResidualReport& report,
                                                            const Eigen::MatrixXd& tangent) const;

  [[nodiscard]] const likelihood::NoiseModel& noise() const { return noise_; }
  [[nodiscard]] const model::Sensors& sensors() const { return sensors_; }
  /// 1/standard deviation of each sensor given the others, n; 0 where it is not measured.
  [[nodiscard]] const Eigen::VectorXd& inverse_std() const { return inverse_std_; }
  /// "sensor 12 (y at 0.05, 0.10, 0.00 m)", or the name of a series.
  [[nodiscard]] std::string name_of(Eigen::Index sensor) const;
  [[nodiscard]] bool is_scalar(Eigen::Index sensor) const {
    return sensors_.size() > 0 && static_cast<std::size_t>(sensor) >= sensors_.displacement_count();
  }
  /// The components that are measured, in order ("x", "y", "z"), then the series' names.
  [[nodiscard]] const std::vector<std::string>& group_names() const { return group_names_; }
  [[nodiscard]] const std::vector<Eigen::Index>& groups() const { return groups_; }  ///< n: of each sensor

 private:
  [[nodiscard]] const Eigen::MatrixXd& rows_at(std::size_t time_index);
  [[nodiscard]] bool repeats(std::span<const likelihood::DatumPointer> data, Eigen::Index k) const;
  [[nodiscard]] Eigen::VectorXd weighted_present(const Eigen::VectorXd& values,
                                                 const Eigen::VectorXd& residual);
  void test_independent(ResidualReport& report, Eigen::Index parameters) const;
  void test_extremes(ResidualReport& report) const;
  void test_modes(const Eigen::MatrixXd& residuals, ResidualReport& report) const;

  std::shared_ptr<const model::ObservedModel> model_;
  likelihood::NoiseModel noise_;
  model::Sensors sensors_;
  Eigen::VectorXd inverse_std_, std_;
  Eigen::Index measured_ = 0;          ///< sensors that are measured at all
  std::vector<Eigen::Index> present_;  ///< of the last datum with missing values, correlated noise …
  std::optional<likelihood::GaussianNoise> present_noise_;  ///< … and that of these
  std::vector<Eigen::Index> groups_;
  std::vector<std::string> group_names_;
  std::vector<std::array<Eigen::Index, 2>> neighbours_;
  bool has_rows_ = false;                        ///< (OU) C_t, n × r, costs less than its two factors
  std::map<std::size_t, Eigen::MatrixXd> rows_;  ///< of the times looked at last
  std::vector<Eigen::MatrixXd> series_rows_;     ///< the same of the scalar series alone, s × r
  Eigen::MatrixXd modal_;  ///< k × n: residual of a complete datum → its part in the modes, N(0, I)
};

}  // namespace knothe::assimilation
