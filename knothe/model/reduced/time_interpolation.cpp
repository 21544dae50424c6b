#include "knothe/model/reduced/time_interpolation.hpp"

#include <algorithm>
#include <cassert>

#include "knothe/base/index.hpp"

namespace knothe::model {
namespace {

ObservedModel combined(const ObservedModel& model, std::span<const double> times,
                       std::vector<double> TimeWeights::*kind) {
  ObservedModel result{model.functions, model.parameters, {times.begin(), times.end()}, model.space, {}, {}};
  result.lift.setZero(model.lift.rows(), std::ssize(times));
  for (Index i = 0; i < std::ssize(times); ++i) {
    const TimeWeights w = interpolate_in_time(model.time, times[i]);
    Eigen::MatrixXd core = Eigen::MatrixXd::Zero(model.space.cols(), model.functions->count());
    for (Index k = 0; k < std::ssize(w.index); ++k) {
      const double weight = (w.*kind)[k];
      if (weight == 0) continue;
      core += weight * model.core[w.index[k]];
      result.lift.col(i) += weight * model.lift.col(w.index[k]);
    }
    result.core.push_back(std::move(core));
  }
  return result;
}

}  // namespace

TimeWeights interpolate_in_time(std::span<const double> time, double at) {
  assert(!time.empty());
  const std::size_t n = std::min<std::size_t>(4, time.size());
  const std::size_t after = std::lower_bound(time.begin(), time.end(), at) - time.begin();
  const std::size_t first = std::min(after < n / 2 ? 0 : after - n / 2, time.size() - n);
  const std::span<const double> t = time.subspan(first, n);
  TimeWeights w;
  for (std::size_t k = 0; k < n; ++k) {
    // ℓ_k(t) = Π_{j≠k} (t − t_j)/(t_k − t_j) and its derivative, by the product rule.
    double value = 1, slope = 0;
    for (std::size_t j = 0; j < n; ++j) {
      if (j == k) continue;
      const double width = t[k] - t[j];
      slope = slope * (at - t[j]) / width + value / width;
      value *= (at - t[j]) / width;
    }
    w.index.push_back(first + k);
    w.value.push_back(value);
    w.slope.push_back(slope);
  }
  return w;
}

ObservedModel at_times(const ObservedModel& model, std::span<const double> times) {
  return combined(model, times, &TimeWeights::value);
}

ObservedModel rates_at_times(const ObservedModel& model, std::span<const double> times) {
  return combined(model, times, &TimeWeights::slope);
}

}  // namespace knothe::model
