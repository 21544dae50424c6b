#include "knothe/library/function_density.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "knothe/numerics/statistics/random.hpp"
#include "knothe/posterior/budget_spent.hpp"

namespace knothe::library {
namespace {

constexpr std::int64_t k_gradient_cost = 4;      ///< as of `infer`
constexpr std::size_t k_max_stored = 1U << 23U;  ///< numbers of known answers: 64 MB

double value_at(FunctionDensity& target, const Eigen::RowVectorXd& point) {
  posterior::LogDensityBatch batch;
  batch.resize(1, point.size(), 0);
  target.evaluate(point, 0, batch);
  return batch.value[0];
}

/// By how much a slope differs from central differences of the log-density in steps of 1e-4, 1e-3 and 1e-2;
/// 0 unless all of them differ in the same sense: a noisy or coarsely rounded density is off in any.
double slope_error(FunctionDensity& target, Eigen::RowVectorXd point, Eigen::Index k, double slope) {
  double least = INFINITY;
  bool above = false, below = false;
  const double at = point[k];
  for (const double step : {1e-4, 1e-3, 1e-2}) {
    point[k] = at + step;
    const double up = value_at(target, point);
    point[k] = at - step;
    const double error = slope - (up - value_at(target, point)) / (2 * step);
    (error > 0 ? above : below) = true;
    if (!(std::abs(error) >= least)) least = std::abs(error);
  }
  return above != below && std::isfinite(least) ? least : 0;
}

}  // namespace

FunctionDensity::FunctionDensity(const Density& density, std::int64_t budget, double seconds)
    : density_(&density), point_(density.dimension), slope_(point_), budget_(budget), seconds_(seconds) {}

double FunctionDensity::seconds_since_start() const {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
}

void FunctionDensity::afford(std::int64_t cost) {
  const bool is_late = seconds_ > 0 && seconds_since_start() >= share_ * seconds_;
  if (is_late || spent_ + cost > share_ * budget_) {
    refused_ = true;
    out_of_time_ = is_late;
    throw posterior::BudgetSpent(in_words());
  }
  spent_ += cost;
}

std::string FunctionDensity::in_words() const {
  if (out_of_time_)
    return fmt::format("the time of {} s is over: seconds = {} goes on from here", seconds_, 2 * seconds_);
  return fmt::format("the budget of {} calls is spent: evaluations = {} goes on from here", budget_,
                     2 * budget_);
}

void FunctionDensity::evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives,
                               posterior::LogDensityBatch& out) {
  const auto d = point_.size();
  for (Eigen::Index i = 0; i < points.rows(); ++i) {
    for (Eigen::Index k = 0; k < dimension(); ++k) point_[k] = points(i, k);
    std::string key(reinterpret_cast<const char*>(point_.data()), d * sizeof(double));
    auto at = known_.find(key);
    if (at == known_.end()) {
      afford(1);
      const double value = density_->log_value(point_);
      if (known_.size() * (2 * d + 1) > k_max_stored) known_.clear();
      at = known_.emplace(std::move(key), Known{value, {}}).first;
    }
    Known& known = at->second;
    out.value[i] = known.value;
    if (derivatives < 1) continue;
    if (known.gradient.empty()) {
      afford(k_gradient_cost);
      density_->gradient(point_, slope_);
      known.gradient = slope_;
    }
    out.gradient.row(i) = Eigen::Map<const Eigen::RowVectorXd>(known.gradient.data(), dimension());
  }
}

void check_gradient(FunctionDensity& target) {
  constexpr int k_points = 5, k_wrong = 3;
  constexpr double k_share = 0.2, k_of_steepest = 0.1;
  const Eigen::Index d = target.dimension();
  const Eigen::MatrixXd points = numerics::monte_carlo_normal_points(k_points, d, 1);
  std::vector<int> wrong(d, 0);
  posterior::LogDensityBatch batch;
  batch.resize(1, d, 1);
  for (Eigen::Index i = 0; i < k_points; ++i) {
    const Eigen::RowVectorXd point = points.row(i);
    if (!std::isfinite(value_at(target, point))) continue;
    target.evaluate(point, 1, batch);
    const Eigen::RowVectorXd slope = batch.gradient.row(0);
    double steepest = 0;
    for (const double s : slope) steepest = std::max(steepest, std::abs(s));
    for (Eigen::Index k = 0; k < d; ++k) {
      const double error = slope_error(target, point, k, slope[k]);
      if (error > std::max({k_share * std::abs(slope[k]), k_of_steepest * steepest, 1e-6})) ++wrong[k];
      if (wrong[k] == k_wrong)
        throw UsageError(
            fmt::format("the gradient is not that of the log-density: at ({:.4g}) its component {} is "
                        "{:.4g}, off by {:.2g} "
                        "from differences of the log-density",
                        fmt::join(point, ", "), k, slope[k], error));
    }
  }
}

}  // namespace knothe::library
