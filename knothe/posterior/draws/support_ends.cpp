#include "knothe/posterior/draws/support_ends.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace knothe::posterior {
namespace {

constexpr double k_infinity = std::numeric_limits<double>::infinity();

bool is_inside(double log_target) {
  return log_target > CheckedDensity::k_min_log_density;
}

/// An end of coordinate k that may be: `sign` −1 lower, +1 upper.
struct Candidate {
  Eigen::Index k = 0;
  double sign = 0;
  double inside = 0, outside = 0;  ///< on the first line; the end is between
  double scale = 0;                ///< distance from the outermost draw to the middle of the draws
};

/// Beyond the outermost draw that has density there have to be some that have none.
std::vector<Candidate> candidates_of(const Eigen::MatrixXd& points, const std::vector<Eigen::Index>& inside,
                                     const std::vector<Eigen::Index>& outside) {
  constexpr std::ptrdiff_t k_beyond = 5;
  std::vector<Candidate> candidates;
  for (Eigen::Index k = 0; k < points.cols(); ++k) {
    std::vector<double> here;
    for (const Eigen::Index i : inside) here.push_back(points(i, k));
    std::sort(here.begin(), here.end());
    for (const double sign : {-1.0, 1.0}) {
      const double outermost = sign < 0 ? here.front() : here.back(),
                   scale = sign * (outermost - here[here.size() / 2]);
      const auto beyond = std::count_if(outside.begin(), outside.end(), [&](Eigen::Index i) {
        return sign * (points(i, k) - outermost) > 0;
      });
      if (beyond >= k_beyond && scale > 0)
        candidates.push_back({k, sign, 0, outermost + 0.5 * sign * scale, scale});
    }
  }
  return candidates;
}

/// Points `start`, their coordinates k moved to `to(candidate)`.
template <class Where>
Eigen::MatrixXd moved(const std::vector<Candidate>& candidates, const Eigen::RowVectorXd& start,
                      const Where& to) {
  Eigen::MatrixXd points = start.replicate(std::ssize(candidates), 1);
  for (std::size_t c = 0; c < candidates.size(); ++c) points(c, candidates[c].k) = to(candidates[c]);
  return points;
}

}  // namespace

SupportEnds SupportEnds::none(Eigen::Index d) {
  return {Eigen::VectorXd::Constant(d, -k_infinity), Eigen::VectorXd::Constant(d, k_infinity)};
}

bool SupportEnds::at(Eigen::Index k) const {
  return lower[k] > -k_infinity || upper[k] < k_infinity;
}

bool SupportEnds::any() const {
  for (Eigen::Index k = 0; k < lower.size(); ++k)
    if (at(k)) return true;
  return false;
}

double SupportEnds::folded(double x, Eigen::Index k) const {
  return x < lower[k] ? 2 * lower[k] - x : x > upper[k] ? 2 * upper[k] - x : x;
}

SupportEnds find_support_ends(CheckedDensity& target, const Eigen::MatrixXd& points,
                              const Eigen::VectorXd& log_target) {
  constexpr std::size_t k_lines = 4, k_min_inside = 8;
  constexpr int k_halvings = 24;
  constexpr double k_confirmed = 1e-4;
  SupportEnds ends = SupportEnds::none(points.cols());
  std::vector<Eigen::Index> inside, outside;
  for (Eigen::Index i = 0; i < points.rows(); ++i) (is_inside(log_target[i]) ? inside : outside).push_back(i);
  if (inside.size() < k_min_inside) return ends;
  std::vector<Candidate> candidates = candidates_of(points, inside, outside);
  if (candidates.empty()) return ends;
  std::sort(inside.begin(), inside.end(),
            [&](Eigen::Index a, Eigen::Index b) { return log_target[a] > log_target[b]; });
  const CheckedDensity::Leniency lenient(target);
  LogDensityBatch batch;
  /// Leaves the candidates for which `fits` holds of log π̄ at the points.
  const auto evaluate = [&](const Eigen::MatrixXd& at, const auto& fits) {
    target.evaluate(at, 0, batch);
    std::vector<Candidate> left;
    for (std::size_t c = 0; c < candidates.size(); ++c)
      if (fits(candidates[c], is_inside(batch.value[c]))) left.push_back(candidates[c]);
    candidates = std::move(left);
    return !candidates.empty();
  };
  const Eigen::RowVectorXd best = points.row(inside.front());
  for (Candidate& c : candidates) c.inside = best[c.k];
  if (!evaluate(moved(candidates, best, [](const Candidate& c) { return c.outside; }),
                [](const Candidate&, bool has_density) { return !has_density; }))
    return ends;
  const auto middle = [](const Candidate& c) { return 0.5 * (c.inside + c.outside); };
  for (int halving = 0; halving < k_halvings; ++halving)
    (void)evaluate(moved(candidates, best, middle), [&](Candidate& c, bool has_density) {
      (has_density ? c.inside : c.outside) = middle(c);
      return true;
    });
  for (std::size_t line = 1; line < k_lines; ++line) {
    const Eigen::RowVectorXd start = points.row(inside[line * (inside.size() - 1) / (k_lines - 1)]);
    for (const double side : {-1.0, 1.0})
      if (!evaluate(
              moved(candidates, start,
                    [&](const Candidate& c) { return middle(c) + side * c.sign * k_confirmed * c.scale; }),
              [&](const Candidate&, bool has_density) { return has_density == (side < 0); }))
        return ends;
  }
  for (const Candidate& c : candidates) (c.sign < 0 ? ends.lower : ends.upper)[c.k] = middle(c);
  return ends;
}

}  // namespace knothe::posterior
