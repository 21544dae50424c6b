#pragma once
/// @file A caller's density, a function of one point, as solvers ask for it: of many, within a budget. Not
/// installed.
#include <chrono>
#include <cstdint>
#include <string>
#include <unordered_map>
#include <vector>

#include "knothe/library/transport_map.hpp"
#include "knothe/posterior/log_density.hpp"

namespace knothe::library {

class FunctionDensity final : public posterior::LogDensity {
 public:
  /// `budget`: values that may be asked for, a gradient counting as four. `seconds`: from now on; 0: no
  /// limit. The density must outlive this.
  FunctionDensity(const Density& density, std::int64_t budget, double seconds);

  [[nodiscard]] Eigen::Index dimension() const override { return std::ssize(point_); }
  [[nodiscard]] int available_derivatives() const override { return density_->gradient ? 1 : 0; }
  /// What was asked before is known, and costs nothing. Errors: BudgetSpent.
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives,
                posterior::LogDensityBatch& out) override;

  /// From here on only this share of the budget, and of the time, may be spent.
  void limit_to(double share) { share_ = share; }
  [[nodiscard]] std::int64_t spent() const { return spent_; }
  [[nodiscard]] std::int64_t budget() const { return budget_; }
  /// Whether a call was refused.
  [[nodiscard]] bool is_spent() const { return refused_; }
  /// What was spent, and what to ask for to go on.
  [[nodiscard]] std::string in_words() const;

 private:
  struct Known {
    double value = 0;
    std::vector<double> gradient;  ///< empty: not asked for yet
  };
  void afford(std::int64_t cost);
  [[nodiscard]] double seconds_since_start() const;

  const Density* density_;
  std::vector<double> point_, slope_;
  std::int64_t budget_, spent_ = 0;
  double seconds_, share_ = 1;
  bool refused_ = false, out_of_time_ = false;
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  std::unordered_map<std::string, Known> known_;  ///< by the point's bytes
};

/// A forgotten sign or factor: a wrong gradient is met by no map, after minutes. Asked at five points of
/// N(0, I); wrong where a component is off by a fifth and more at three of them. Errors: UsageError.
void check_gradient(FunctionDensity& target);

}  // namespace knothe::library
