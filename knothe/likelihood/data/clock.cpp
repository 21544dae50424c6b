#include "knothe/likelihood/data/clock.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/base/text.hpp"
#include "knothe/likelihood/step/posterior_functions.hpp"

namespace knothe::likelihood {
namespace {

constexpr double k_standard_deviations = 4;  ///< of a reading, within which it is put back into the range
constexpr Eigen::Index k_max_spread = 3;

/// The output `name` at the model's times, as an increasing function (`sign` · output).
struct ModelClock {
  std::vector<double> value;
  double sign;
};

ModelClock model_clock(const model::SeparatedModel& model, const std::string& name) {
  const model::ModelContents& contents = model.contents();
  const auto found = std::find_if(contents.outputs.begin(), contents.outputs.end(),
                                  [&](const model::SnapshotOutput& output) { return output.name == name; });
  if (found == contents.outputs.end()) {
    const std::vector<std::string> names = model.output_names();
    throw DataError(fmt::format("data.clock: {} has no output \"{}\"{}; it has {}", model.where(), name,
                                did_you_mean(name, names),
                                names.empty() ? "none" : fmt::format("{}", fmt::join(names, ", "))));
  }
  const std::size_t n = contents.time.size();
  ModelClock clock{{found->values.begin(), found->values.begin() + n}, 1};
  const auto [least, most] = std::minmax_element(clock.value.begin(), clock.value.end());
  const double range = *most - *least;
  for (std::size_t i = 0; i < found->values.size(); ++i) {
    if (!(std::abs(found->values[i] - clock.value[i % n]) <= 1e-9 * range)) {
      throw DataError(
          fmt::format("data.clock: the output \"{}\" of {} depends on the parameters: a clock must not, take "
                      "what is imposed",
                      name, model.where()));
    }
  }
  if (n > 1 && clock.value[1] < clock.value[0]) clock.sign = -1;
  for (double& value : clock.value) value *= clock.sign;
  for (std::size_t i = 1; i < n; ++i) {
    if (clock.value[i] > clock.value[i - 1]) continue;
    throw DataError(fmt::format(
        "data.clock: the output \"{}\" of {} goes back between steps {} and {}: what is imposed must "
        "only increase, or only decrease, to tell the time",
        name, model.where(), i - 1, i));
  }
  if (n < 2) throw DataError(fmt::format("data.clock: {} has one time only", model.where()));
  return clock;
}

}  // namespace

ClockReading read_clock(const model::SeparatedModel& model, const std::string& name,
                        const MeasuredSeries& measured, const std::string& where) {
  const ModelClock clock = model_clock(model, name);
  const std::vector<double>& time = model.contents().time;
  const double error = measured.std.value_or(0.0);
  const double slack =
      std::max(k_standard_deviations * error, 1e-9 * (clock.value.back() - clock.value.front()));
  ClockReading reading;
  double largest = -INFINITY;
  std::size_t of_largest = 0;
  for (std::size_t i = 0; i < measured.values.size(); ++i) {
    const double raw = measured.values[i], value = clock.sign * raw;
    if (std::isnan(raw)) {
      throw DataError(fmt::format(
          "{}: outputs/{}[{}] is missing: without the clock the time of the datum is unknown; leave out "
          "the time, or fill in the reading",
          where, name, i));
    }
    if (value < largest - std::sqrt(2.0) * slack) {
      throw DataError(fmt::format(
          "{}: outputs/{}[{}] = {} comes after {} at index {}: the structure was unloaded, but the "
          "model knows only loading. Give the data up to there, or those of the loading alone",
          where, name, i, raw, measured.values[of_largest], of_largest));
    }
    if (value > largest) largest = value, of_largest = i;
    if (value < clock.value.front() - slack || value > clock.value.back() + slack) {
      throw DataError(fmt::format("{}: outputs/{}[{}] = {} is outside what the model covers, {} to {}", where,
                                  name, i, raw, clock.sign * clock.value.front(),
                                  clock.sign * clock.value.back()));
    }
    const double inside = std::clamp(value, clock.value.front(), clock.value.back());
    const auto after = std::lower_bound(clock.value.begin() + 1, clock.value.end() - 1, inside);
    const std::size_t k = after - clock.value.begin();
    const double slope = (time[k] - time[k - 1]) / (clock.value[k] - clock.value[k - 1]);
    const double ahead = inside - clock.value[k - 1];
    // A reading at a node is the node's time to the bit.
    reading.time.push_back(inside == clock.value[k] ? time[k] : time[k - 1] + slope * ahead);
    reading.std.push_back(error * slope);
    reading.rate.push_back(clock.sign * slope);
  }
  return reading;
}

Eigen::MatrixXd mean_rates(const model::ObservedModel& rates, const posterior::PriorTransform& transform) {
  const PosteriorFunctions prior = prior_functions(*rates.functions, transform);
  Eigen::MatrixXd mean = rates.lift;
  for (Eigen::Index i = 0; i < mean.cols(); ++i) mean.col(i) += rates.space * (rates.core[i] * prior.mean);
  return mean;
}

NoiseModel with_clock_error(const NoiseModel& noise, const model::ObservedModel& rates,
                            const posterior::PriorTransform& transform, std::span<const double> std) {
  const PosteriorFunctions prior = prior_functions(*rates.functions, transform);
  const Eigen::VectorXd noise_std = noise.measurement().standard_deviations();
  NoiseModel result = noise;
  for (std::size_t i = 0; i < std.size(); ++i) {
    if (!(std[i] > 0)) continue;
    const Eigen::VectorXd mean = rates.lift.col(i) + rates.space * (rates.core[i] * prior.mean);
    const Eigen::Index q = std::min(prior.factor.cols(), k_max_spread);
    const Eigen::MatrixXd spread = rates.space * (rates.core[i] * prior.factor.leftCols(q));
    Eigen::MatrixXd factor(noise.size(), 1 + q);
    factor << std[i] * mean, std[i] * spread;
    // What nowhere comes to a thousandth of the noise is not felt; a dof that is not measured does not count.
    Eigen::Index kept = 1;
    for (Eigen::Index j = 1; j <= q; ++j) {
      if ((factor.col(j).array().abs() > 1e-3 * noise_std.array() && noise_std.array() > 0).any())
        factor.col(kept++) = factor.col(j).eval();
    }
    result = result.with_step_error(i, factor.leftCols(kept));
  }
  return result;
}

}  // namespace knothe::likelihood
