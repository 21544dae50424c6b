#include "knothe/model/grid/registered_solutions.hpp"

#include <algorithm>
#include <functional>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"

namespace knothe::model {
namespace {

/// Relative changes of the state below this are rounding and the solver's tolerance.
constexpr double k_unchanged = 1e-9;

/// Where `level` is in falling states: between `before` and the next one.
struct Place {
  Index before;
  double share;  ///< of the next
};
Place place_of(const std::vector<double>& falling, double level) {
  const auto next = std::ranges::lower_bound(falling, level, std::greater<>());  // first that is not above
  if (next == falling.begin()) return {0, 0};
  if (next == falling.end()) return {std::ssize(falling) - 1, 0};
  const Index before = next - falling.begin() - 1;
  return {before, (falling[before] - level) / (falling[before] - falling[before + 1])};
}

/// The weight of each grid point in the tensor-product spline at `q`, last axis fastest.
Eigen::VectorXd weights_at(std::span<const numerics::CubicSplineBasis> axes, std::span<const double> q) {
  Eigen::VectorXd weights = Eigen::VectorXd::Ones(1);
  for (Index i = 0; i < std::ssize(axes); ++i) {
    const Eigen::VectorXd along = axes[i].cardinal_weights(q[i]);
    const Eigen::MatrixXd product = along * weights.transpose();
    weights = product.reshaped();
  }
  return weights;
}

}  // namespace

RegisteredSolutions::RegisteredSolutions(std::span<const std::vector<double>> nodes,
                                         std::vector<History> histories) {
  Index points = 1;
  for (const std::vector<double>& axis : nodes) {
    axes_.emplace_back(axis);
    points *= std::ssize(axis);
  }
  if (std::ssize(histories) != points) throw UsageError("a history is needed for each point of the grid");
  for (const History& history : histories) tracks_.push_back(track_of(history));
  histories.clear();
  for (const Track& track : tracks_) levels_.insert(levels_.end(), track.state.begin(), track.state.end());
  std::ranges::sort(levels_, std::greater<>());
  levels_.erase(std::ranges::unique(levels_).begin(), levels_.end());
  clocks_.resize(std::ssize(levels_), points);
  for (Index j = 0; j < points; ++j)
    for (Index m = 0; m < std::ssize(levels_); ++m) clocks_(m, j) = clock(tracks_[j], levels_[m]);
}

RegisteredSolutions::Track RegisteredSolutions::track_of(const History& history) {
  const Index n = std::ssize(history.time);
  if (n == 0 || std::ssize(history.state) != n || history.values.cols() != n || !(history.state[0] > 0))
    throw UsageError("a history needs a state above zero and values at each of its times");
  Track track;
  std::vector<Index> kept;
  double lowest = 1;
  for (Index i = 0; i < n; ++i) {
    const double state = history.state[i] / history.state[0];
    if (state > lowest - k_unchanged) {
      if (std::ssize(kept) == 1) kept[0] = i;  // the last before the first change
      if (!kept.empty()) continue;
    }
    lowest = kept.empty() ? 1 : state;
    kept.push_back(i);
    track.state.push_back(lowest);
  }
  track.shape.resize(history.values.rows(), std::ssize(kept));
  for (Index k = 0; k < std::ssize(kept); ++k) {
    track.time.push_back(history.time[kept[k]]);
    track.shape.col(k) = history.values.col(kept[k]) / track.time[k];
  }
  return track;
}

double RegisteredSolutions::clock(const Track& track, double state) {
  const auto [before, share] = place_of(track.state, state);
  return share > 0 ? (1 - share) * track.time[before] + share * track.time[before + 1] : track.time[before];
}

Eigen::MatrixXd RegisteredSolutions::at(std::span<const double> q, std::span<const double> times) const {
  const Eigen::VectorXd weights = weights_at(axes_, q);
  Eigen::VectorXd clock = clocks_ * weights;
  for (Index m = 1; m < clock.size(); ++m) clock[m] = std::max(clock[m], clock[m - 1]);
  Eigen::MatrixXd values = Eigen::MatrixXd::Zero(tracks_[0].shape.rows(), std::ssize(times));
  for (Index i = 0; i < std::ssize(times); ++i) {
    const Index m = std::lower_bound(clock.begin(), clock.end(), times[i]) - clock.begin();
    double level = levels_[std::min<Index>(m, clock.size() - 1)];
    if (m > 0 && m < clock.size())
      level = levels_[m - 1] +
              (levels_[m] - levels_[m - 1]) * (times[i] - clock[m - 1]) / (clock[m] - clock[m - 1]);
    for (Index j = 0; j < std::ssize(tracks_); ++j) {
      if (weights[j] == 0) continue;
      const auto [before, share] = place_of(tracks_[j].state, level);
      values.col(i) += times[i] * weights[j] * (1 - share) * tracks_[j].shape.col(before);
      if (share > 0) values.col(i) += times[i] * weights[j] * share * tracks_[j].shape.col(before + 1);
    }
  }
  return values;
}

}  // namespace knothe::model
