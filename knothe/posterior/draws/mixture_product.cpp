#include "knothe/posterior/draws/mixture_product.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>

#include "knothe/base/error.hpp"

namespace knothe::posterior {
namespace {

/// Quarters of the ranks: below the first quartile 0, …, above the third 3.
std::vector<int> quarters(const Eigen::VectorXd& values) {
  const std::size_t n = values.size();
  std::vector<std::size_t> order(n);
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return values[a] < values[b]; });
  std::vector<int> quarter(n);
  for (std::size_t rank = 0; rank < n; ++rank) quarter[order[rank]] = 4 * rank / n;
  return quarter;
}

/// χ² of the 4 × 4 table of counts, divided by their number (Pearson 1904).
double mean_square_contingency(const std::vector<int>& a, const std::vector<int>& b) {
  std::array<double, 16> counts{};
  for (std::size_t i = 0; i < a.size(); ++i) counts[4 * a[i] + b[i]] += 1;
  const double expected = a.size() / 16.0;
  double sum = 0;
  for (const double count : counts) sum += (count - expected) * (count - expected);
  return sum / (expected * a.size());
}

}  // namespace

MixtureProduct::MixtureProduct(std::vector<Factor> factors, SupportEnds ends, Eigen::Index as_drawn)
    : factors_(std::move(factors)), ends_(std::move(ends)), as_drawn_(as_drawn) {
  std::vector<Eigen::Index> all;
  for (const Factor& f : factors_) {
    if (std::ssize(f.coordinates) != f.mixture.dimension())
      throw UsageError("mixtures: a factor's coordinates are not as many as its mixture's");
    all.insert(all.end(), f.coordinates.begin(), f.coordinates.end());
  }
  std::sort(all.begin(), all.end());
  dimension_ = std::ssize(all);
  for (Eigen::Index k = 0; k < dimension_; ++k)
    if (all[k] != k) throw UsageError("mixtures: every coordinate must be in one factor");
}

void MixtureProduct::sample(Eigen::Index n, RandomNumbers& random, Eigen::MatrixXd& points) const {
  points.resize(n, dimension_);
  std::vector<Eigen::Index> order(n);
  std::iota(order.begin(), order.end(), Eigen::Index{0});
  Eigen::MatrixXd own;
  for (std::size_t f = 0; f < factors_.size(); ++f) {
    factors_[f].mixture.sample(n, random, own);
    if (f > 0)
      for (Eigen::Index i = n - 1; i > 0; --i) std::swap(order[i], order[random.index(i + 1)]);
    for (std::size_t k = 0; k < factors_[f].coordinates.size(); ++k) {
      auto column = points.col(factors_[f].coordinates[k]);
      for (Eigen::Index i = 0; i < n; ++i) column[i] = own(order[i], k);
    }
  }
  if (!is_folded()) return;
  for (Eigen::Index k = 0; k < dimension_; ++k)
    for (Eigen::Index i = 0; ends_.at(k) && i < n; ++i)
      if (as_drawn_ == 0 || i % as_drawn_ != 0) points(i, k) = ends_.folded(points(i, k), k);
}

/// Of a point mirrored at the ends: the sum over all points that become it.
void MixtureProduct::folded_log_density(const Factor& factor, const Eigen::MatrixXd& points,
                                        Eigen::VectorXd& out) const {
  constexpr double k_infinity = std::numeric_limits<double>::infinity();
  // What a coordinate may have been: the same, inside, or its image, beyond an end.
  struct Image {
    double end, lower, upper;  ///< end: infinite for the same
  };
  std::vector<Eigen::Index> mirrored;
  std::vector<std::vector<Image>> images;
  for (Eigen::Index j = 0; j < std::ssize(factor.coordinates); ++j) {
    const double lower = ends_.lower[factor.coordinates[j]], upper = ends_.upper[factor.coordinates[j]];
    if (std::isinf(lower) && std::isinf(upper)) continue;
    mirrored.push_back(j);
    images.push_back({{k_infinity, lower, upper}});
    if (std::isfinite(lower)) images.back().push_back({lower, -k_infinity, lower});
    if (std::isfinite(upper)) images.back().push_back({upper, upper, k_infinity});
  }
  out.setConstant(points.rows(), -k_infinity);
  Eigen::MatrixXd was = points;
  Eigen::VectorXd part;
  std::vector<std::size_t> which(mirrored.size(), 0);
  for (std::size_t m = 0; m < which.size();) {
    Eigen::Array<bool, Eigen::Dynamic, 1> possible =
        Eigen::Array<bool, Eigen::Dynamic, 1>::Constant(points.rows(), true);
    for (m = 0; m < which.size(); ++m) {
      const Image& image = images[m][which[m]];
      auto x = was.col(mirrored[m]).array();
      x = points.col(mirrored[m]).array();
      if (std::isfinite(image.end)) x = 2 * image.end - x;
      possible = possible && x >= image.lower && x <= image.upper;
    }
    if (possible.any()) {
      factor.mixture.log_density(was, part);
      for (Eigen::Index i = 0; i < part.size(); ++i)
        if (possible[i]) out[i] = log_sum(out[i], part[i]);
    }
    for (m = 0; m < which.size() && ++which[m] == images[m].size(); ++m) which[m] = 0;  // the next
  }
}

void MixtureProduct::log_density(const Eigen::Ref<const Eigen::MatrixXd>& points,
                                 Eigen::VectorXd& out) const {
  out.setZero(points.rows());
  Eigen::VectorXd part, folded = out;
  for (const Factor& f : factors_) {
    const Eigen::MatrixXd own = columns_of(points, f.coordinates);
    f.mixture.log_density(own, part);
    out += part;
    if (!is_folded()) continue;
    if (std::any_of(f.coordinates.begin(), f.coordinates.end(), [&](Eigen::Index k) { return ends_.at(k); }))
      folded_log_density(f, own, part);
    folded += part;
  }
  if (!is_folded()) return;
  const double share = as_drawn_ > 0 ? 1.0 / as_drawn_ : 0;
  for (Eigen::Index i = 0; i < out.size(); ++i)
    out[i] = log_sum(std::log(share) + out[i], std::log1p(-share) + folded[i]);
}

Eigen::MatrixXd columns_of(const Eigen::Ref<const Eigen::MatrixXd>& points,
                           const std::vector<Eigen::Index>& columns) {
  Eigen::MatrixXd some(points.rows(), std::ssize(columns));
  for (std::size_t k = 0; k < columns.size(); ++k) some.col(k) = points.col(columns[k]);
  return some;
}

std::vector<std::vector<Eigen::Index>> dependent_groups(
    std::initializer_list<std::reference_wrapper<const Eigen::MatrixXd>> samples, double worth) {
  // n times the contingency of n independent points is χ² of 9 degrees of freedom: 9 ± 4.2.
  constexpr double k_dependent = 0.04, k_by_chance = 9 + 4 * 4.2;
  const double least = std::max(k_dependent, k_by_chance / worth);
  const Eigen::Index d = samples.begin()->get().cols();
  std::vector<std::vector<std::vector<int>>> quarter;  // of each sample, of each coordinate
  for (const Eigen::MatrixXd& sample : samples) {
    quarter.emplace_back();
    for (Eigen::Index k = 0; k < d; ++k) quarter.back().push_back(quarters(sample.col(k)));
  }
  const auto depend = [&](Eigen::Index a, Eigen::Index b) {
    return std::any_of(quarter.begin(), quarter.end(),
                       [&](const auto& of) { return mean_square_contingency(of[a], of[b]) > least; });
  };
  std::vector<std::vector<Eigen::Index>> groups;
  for (Eigen::Index k = 0; k < d; ++k) {
    // k and all groups with a coordinate that it depends on become one.
    std::vector<Eigen::Index> mine{k};
    std::erase_if(groups, [&](const std::vector<Eigen::Index>& group) {
      if (std::none_of(group.begin(), group.end(), [&](Eigen::Index other) { return depend(k, other); }))
        return false;
      mine.insert(mine.end(), group.begin(), group.end());
      return true;
    });
    std::sort(mine.begin(), mine.end());
    groups.push_back(std::move(mine));
  }
  std::sort(groups.begin(), groups.end());
  return groups;
}

}  // namespace knothe::posterior
