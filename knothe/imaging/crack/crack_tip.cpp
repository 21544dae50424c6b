#include "knothe/imaging/crack/crack_tip.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "knothe/base/index.hpp"

namespace knothe::imaging {

namespace {

constexpr std::size_t k_min_data = 6;
constexpr std::array<double, 3> k_powers{0.5, 1.0, 1.5};
constexpr int k_terms = 2;
constexpr double k_beyond = 0.2;  // of the path: how far past its end a tip is thought of
constexpr double k_outlier = 4;   // standard deviations
constexpr double k_max_outliers = 0.2;
constexpr std::array<double, 2> k_prior_width{2, 0.7};  // of the coefficients, of the largest opening
constexpr double k_largest_step = 2;                    // px between trial tips
constexpr int k_max_tips = 1500;

using Basis = Eigen::Matrix<double, k_terms, 1>;
using Matrix = Eigen::Matrix<double, k_terms, k_terms>;

/// Mean of max(ξ, 0)^p over [a, b].
double mean_power(double a, double b, double p) {
  const auto primitive = [p](double x) { return x > 0 ? std::pow(x, p + 1) / (p + 1) : 0; };
  return (primitive(b) - primitive(a)) / (b - a);
}

struct Fit {
  double log_evidence = 0;
  Basis coefficients = Basis::Zero();
};

class Profile {
 public:
  explicit Profile(std::span<const OpeningDatum> data) : data_(data), used_(data.size(), 1) {
    for (const auto& d : data) scale_ = std::max(scale_, std::abs(d.opening));
    length_ = std::max(1.0, data.back().along - data.front().along);
  }

  /// Powers of the distance over the length of the path, so that a coefficient is an opening far from the
  /// tip.
  [[nodiscard]] Basis basis(const OpeningDatum& d, double tip, double power) const {
    Basis b;
    for (int k = 0; k < k_terms; ++k)
      b[k] = mean_power((tip - d.along - 0.5 * d.width) / length_, (tip - d.along + 0.5 * d.width) / length_,
                        power + k);
    return b;
  }

  /// y ~ N(0, C + Ψ S Ψᵀ) against N(0, C), by Woodbury's identity.
  [[nodiscard]] Fit fit(double tip, double power) const {
    Matrix gram = Matrix::Zero();
    Basis right = Basis::Zero();
    for (Index i = 0; i < std::ssize(data_); ++i) {
      if (used_[i] == 0) continue;
      const Basis b = basis(data_[i], tip, power);
      const double weight = 1 / (inflation_ * data_[i].std * data_[i].std);
      gram += weight * b * b.transpose(), right += weight * data_[i].opening * b;
    }
    // The coefficients are those of a crack of this length: ψ_k = (ξ/tip)^(q+k) has the prior, not
    // (ξ/length)^(q+k).
    const double ratio = std::max(1e-3, (tip - data_.front().along) / length_);
    Basis prior_std;
    for (int k = 0; k < k_terms; ++k) prior_std[k] = k_prior_width[k] * scale_ / std::pow(ratio, power + k);
    const Matrix scaled = prior_std.asDiagonal() * gram * prior_std.asDiagonal();
    const Basis scaled_right = prior_std.cwiseProduct(right);
    const Eigen::LLT<Matrix> factor(Matrix::Identity() + scaled);
    const Basis solved = factor.solve(scaled_right);
    Fit fit;
    fit.coefficients = prior_std.cwiseProduct(solved);
    fit.log_evidence =
        0.5 * scaled_right.dot(solved) - Matrix(factor.matrixL()).diagonal().array().log().sum();
    return fit;
  }

  /// Leaves out what is far off the best curve and enlarges the errors to its misfit. Returns that.
  double settle(double tip, double power) {
    const Fit best = fit(tip, power);
    double squares = 0, count = 0;
    std::vector<std::pair<double, std::size_t>> far;
    for (Index i = 0; i < std::ssize(data_); ++i) {
      if (used_[i] == 0) continue;
      const double z = (data_[i].opening - best.coefficients.dot(basis(data_[i], tip, power))) / data_[i].std;
      squares += z * z, count += 1;
      far.emplace_back(std::abs(z), i);
    }
    // Against the spread of the middle, not the mean square that the outliers themselves make.
    std::sort(far.rbegin(), far.rend());
    const double spread = std::max(1.0, far[far.size() / 2].first / 0.6745);
    for (const auto& [z, i] : far) {
      const double left_out = std::count(used_.begin(), used_.end(), 0);
      if (z < k_outlier * spread || left_out + 1 > k_max_outliers * data_.size()) break;
      used_[i] = 0, squares -= z * z, count -= 1;
    }
    const double misfit = squares / std::max(1.0, count - k_terms - 1);
    inflation_ = std::max(1.0, misfit);
    return misfit;
  }

  [[nodiscard]] double length() const { return length_; }

 private:
  std::span<const OpeningDatum> data_;
  std::vector<char> used_;
  double scale_ = 1e-6, length_ = 1, inflation_ = 1;
};

}  // namespace

TipPosterior crack_tip(std::span<const OpeningDatum> data) {
  TipPosterior result;
  if (data.size() < k_min_data) return result;
  Profile profile(data);
  const double first = data.front().along, last = data.back().along + 0.5 * data.back().width,
               end = last + k_beyond * profile.length();
  const int count = std::min(k_max_tips, static_cast<int>((end - first) / k_largest_step) + 2);
  const auto tip_at = [&](int i) { return first + (end - first) * (i + 0.5) / count; };
  std::vector<double> log_density(count);
  const auto scan = [&] {
    std::pair<int, double> best{0, k_powers[0]};
    double highest = -1e300;
    for (int i = 0; i < count; ++i) {
      std::array<double, k_powers.size()> each{};
      for (Index q = 0; q < std::ssize(k_powers); ++q) {
        each[q] = profile.fit(tip_at(i), k_powers[q]).log_evidence;
        if (each[q] > highest) highest = each[q], best = {i, k_powers[q]};
      }
      const double top = *std::max_element(each.begin(), each.end());
      double sum = 0;
      for (const double e : each) sum += std::exp(e - top);
      log_density[i] = top + std::log(sum / each.size());
    }
    return best;
  };
  for (int round = 0; round < 2; ++round) {
    const auto [i, power] = scan();
    const double misfit = profile.settle(tip_at(i), power);
    if (round == 0) result.misfit = misfit;
  }
  scan();
  const double top = *std::max_element(log_density.begin(), log_density.end());
  double mass = 0, mean = 0, square = 0, beyond = 0;
  for (int i = 0; i < count; ++i) {
    const double p = std::exp(log_density[i] - top), tip = tip_at(i);
    mass += p, mean += p * tip, square += p * tip * tip;
    if (tip > last) beyond += p;
  }
  const double step = (end - first) / count;
  result.log_evidence = top + std::log(mass / count);
  result.mean = mean / mass;
  // A density known at points: as a histogram, whose cells have a width.
  result.std = std::sqrt(std::max(0.0, square / mass - result.mean * result.mean) + step * step / 12);
  result.beyond = beyond / mass;
  double sum = 0;
  const auto quantile = [&](double level) {
    sum = 0;
    for (int i = 0; i < count; ++i) {
      const double p = std::exp(log_density[i] - top) / mass;
      if (sum + p >= level) return first + step * (i + (level - sum) / p);
      sum += p;
    }
    return end;
  };
  result.interval = {quantile(0.025), quantile(0.975)};
  return result;
}

}  // namespace knothe::imaging
