#include "knothe/posterior/draws/mixture_product.hpp"

#include <algorithm>
#include <array>
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

MixtureProduct::MixtureProduct(std::vector<Factor> factors) : factors_(std::move(factors)) {
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
}

void MixtureProduct::log_density(const Eigen::Ref<const Eigen::MatrixXd>& points,
                                 Eigen::VectorXd& out) const {
  out.setZero(points.rows());
  Eigen::VectorXd part;
  for (const Factor& f : factors_) {
    f.mixture.log_density(columns_of(points, f.coordinates), part);
    out += part;
  }
}

Eigen::MatrixXd columns_of(const Eigen::Ref<const Eigen::MatrixXd>& points,
                           const std::vector<Eigen::Index>& columns) {
  Eigen::MatrixXd some(points.rows(), std::ssize(columns));
  for (std::size_t k = 0; k < columns.size(); ++k) some.col(k) = points.col(columns[k]);
  return some;
}

std::vector<std::vector<Eigen::Index>> dependent_groups(
    std::initializer_list<std::reference_wrapper<const Eigen::MatrixXd>> samples) {
  constexpr double k_dependent = 0.04;
  const Eigen::Index d = samples.begin()->get().cols();
  std::vector<std::vector<std::vector<int>>> quarter;  // of each sample, of each coordinate
  for (const Eigen::MatrixXd& sample : samples) {
    quarter.emplace_back();
    for (Eigen::Index k = 0; k < d; ++k) quarter.back().push_back(quarters(sample.col(k)));
  }
  const auto depend = [&](Eigen::Index a, Eigen::Index b) {
    return std::any_of(quarter.begin(), quarter.end(),
                       [&](const auto& of) { return mean_square_contingency(of[a], of[b]) > k_dependent; });
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
