#include "knothe/numerics/integrate/smolyak.hpp"

#include <fmt/format.h>

#include <map>
#include <utility>
#include <vector>

#include "knothe/base/error.hpp"

namespace knothe::numerics {

namespace {

constexpr int k_max_points = 1'000'000;

/// Coordinates that differ from the trivial value (rule of one node; node 0), in increasing order.
using Sparse = std::vector<std::pair<Eigen::Index, int>>;

double binomial(Eigen::Index n, Eigen::Index k) {
  double value = 1;
  for (Eigen::Index j = 1; j <= k; ++j)
    value = value * static_cast<double>(n - k + j) / static_cast<double>(j);
  return value;
}

/// A point whose non-zero coordinates come from rules of 2h_k + 1 nodes is there iff Σ (2h_k − 1) ≤ level;
/// there are Π 2h_k such points: the coefficients up to t^level of (1 + Σ_h 2h t^{2h−1})^d.
double count_points(Eigen::Index d, int level) {
  std::vector<double> count(static_cast<std::size_t>(level) + 1, 0.0);
  count[0] = 1;
  for (Eigen::Index k = 0; k < d; ++k)
    for (std::size_t sum = count.size(); sum-- > 0;)
      for (std::size_t h = 1; 2 * h - 1 <= sum; ++h)
        count[sum] += static_cast<double>(2 * h) * count[sum - (2 * h - 1)];
  double total = 0;
  for (const double c : count) total += c;
  return total;
}

/// A(level, d) = Σ_{|i| ≤ level} (−1)^{level − |i|} C(d − 1, level − |i|) ⊗_k Q_{i_k}, i_k ≥ 0 (Smolyak 1963;
/// Wasilkowski and Woźniakowski 1995). Rules that are equal are gathered before points are made: key is the
/// half number of nodes ⌈i/2⌉ of the coordinates that have more than one.
class Combination {
 public:
  Combination(Eigen::Index d, int level) : d_(d), level_(level) {
    if (const double points = count_points(d, level); points > k_max_points)
      throw UsageError(fmt::format(
          "Smolyak rule of level {} in {} dimensions: {:.3g} points are more than the {} that are "
          "possible; use a lower level or Sobol points",
          level, d, points, k_max_points));
    collect(0, 0);
    for (int half = 0; half <= (level + 1) / 2; ++half) rules_.push_back(gauss_hermite(2 * half + 1));
    for (const auto& [rule, coefficient] : coefficients_)
      if (coefficient != 0) expand(rule, 0, coefficient, {});
  }

  [[nodiscard]] PointRule result() const {
    PointRule rule{Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(weights_.size()), d_),
                   Eigen::VectorXd(static_cast<Eigen::Index>(weights_.size()))};
    Eigen::Index row = 0;
    for (const auto& [point, weight] : weights_) {
      for (const auto& [k, id] : point) {
        const int half = id / 1024, node = id % 1024;
        rule.points(row, k) = rules_[half].nodes[node];
      }
      rule.weights[row++] = weight;
    }
    return rule;
  }

 private:
  void collect(Eigen::Index from, int sum) {
    const Eigen::Index missing = level_ - sum;
    if (missing <= d_ - 1) coefficients_[current_] += (missing % 2 == 0 ? 1 : -1) * binomial(d_ - 1, missing);
    for (Eigen::Index k = from; k < d_; ++k)
      for (int i = 1; sum + i <= level_; ++i) {
        current_.emplace_back(k, (i + 1) / 2);
        collect(k + 1, sum + i);
        current_.pop_back();
      }
  }

  void expand(const Sparse& rule, std::size_t at, double weight, Sparse point) {
    if (at == rule.size()) {
      weights_[point] += weight;
      return;
    }
    const auto& [k, half] = rule[at];
    const Quadrature& nodes = rules_[half];
    for (int j = 0; j < nodes.nodes.size(); ++j) {
      Sparse next = point;
      if (j != half) next.emplace_back(k, half * 1024 + j);  // the middle node is 0, shared by all rules
      expand(rule, at + 1, weight * nodes.weights[j], std::move(next));
    }
  }

  Eigen::Index d_;
  int level_;
  Sparse current_;
  std::map<Sparse, double> coefficients_, weights_;
  std::vector<Quadrature> rules_;
};

}  // namespace

PointRule smolyak_rule(Eigen::Index d, int level) {
  if (d < 1) throw UsageError(fmt::format("Smolyak rule in {} dimensions: at least 1 is needed", d));
  if (level < 0 || level > 30)
    throw UsageError(fmt::format("Smolyak rule of level {}: 0 to 30 are possible", level));
  return Combination(d, level).result();
}

}  // namespace knothe::numerics
