#pragma once
/// @file How good forecasts were, once what they spoke of has been measured.
#include <Eigen/Core>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "knothe/assimilation/forecast/quantity_of_interest.hpp"
#include "knothe/base/index.hpp"
#include "knothe/model/observe/observed_model.hpp"

namespace knothe::assimilation {

/// A forecast against what came.
struct Score {
  /// Continuous ranked probability score ∫ (F(x) − 1{x ≥ y})² dx, in the unit of the quantity: 0 for a sure
  /// and true forecast, the absolute error for a sure one.
  double crps = 0;
  double probability = 0;  ///< F(y): uniform on (0, 1) over many forecasts, if their widths are right
};

/// Of the measurement of a quantity: weighted samples of it plus noise N(0, noise_std²), noise_std > 0, in
/// closed form (Grimit et al. 2006: a mixture of normal distributions). n² operations.
[[nodiscard]] Score score_samples(std::span<const double> samples, std::span<const double> weights,
                                  double noise_std, double observed);

/// A forecast that has come true: its scores when it was made after each step, from the first on.
struct ScoredForecast {
  std::string name;
  std::string units;
  double time = 0;                  ///< model time of the measurement
  double observed = 0, std = 0;     ///< and its noise
  std::vector<std::size_t> step;    ///< after which it was made
  std::vector<double> lead_time;    ///< model time from then to the measurement
  std::vector<double> crps;         ///< in `units`
  std::vector<double> probability;  ///< P(measurement ≤ the one that came)
};

/// Forecasts kept until their instant is measured.
class ForecastScores {
 public:
  /// `model`: at the times and with the rows of the data. `row` and `time_index`: where the quantity of the
  /// forecast `name` is measured, with noise `std`.
  void wait_for(const std::string& name, const std::string& units, const model::ObservedModel& model,
                Index row, std::size_t time_index, double std);
  [[nodiscard]] bool empty() const { return waiting_.empty(); }

  /// The datum of `step` at `time_index`: what has come true with it, of the forecasts made after earlier
  /// steps. A missing value never does.
  [[nodiscard]] std::vector<ScoredForecast> score(std::size_t step, std::size_t time_index,
                                                  const Eigen::Ref<const Eigen::VectorXd>& values);
  /// The posterior after `step` at model time `time`: n × d points and their weights. In increasing order of
  /// steps.
  void add_posterior(std::size_t step, double time, const Eigen::Ref<const Eigen::MatrixXd>& points,
                     const Eigen::Ref<const Eigen::VectorXd>& weights);
  /// The data have changed from `step` on: what was kept of it and later is kept no longer.
  void forget_from(std::size_t step);

 private:
  struct Kept {
    std::size_t step;
    double time;
    std::vector<double> samples;  ///< equally likely
  };
  struct Waiting {
    std::string name, units;
    QuantityOfInterest quantity;
    Index row;
    std::size_t time_index;
    double time, std;
    std::vector<Kept> kept;
    std::optional<std::size_t> scored_at;  ///< step that it came true with
  };
  std::vector<Waiting> waiting_;
};

}  // namespace knothe::assimilation
