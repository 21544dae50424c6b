#include "knothe/posterior/prior/prior.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "knothe/base/error.hpp"
#include "knothe/numerics/statistics/normal_distribution.hpp"
#include "knothe/posterior/prior/joint_prior.hpp"

namespace knothe::posterior {

using numerics::normal_cdf;
using numerics::normal_pdf;
using numerics::normal_quantile;

namespace {

constexpr double k_infinity = std::numeric_limits<double>::infinity();
constexpr double k_log_sqrt_2_pi = 0.91893853320467274178;
constexpr double k_largest_score = 38;  // beyond, Φ is no double

}  // namespace

Prior::Prior(Family family, double location, double scale)
    : family_(family), location_(location), scale_(scale) {}

Prior Prior::normal(double mean, double std) {
  if (!(std > 0) || !std::isfinite(mean))
    throw ProjectError("a normal prior needs a finite mean and std > 0");
  return Prior(Family::normal, mean, std);
}

Prior Prior::uniform(double lower, double upper) {
  if (!(upper > lower)) throw ProjectError("a uniform prior needs upper > lower");
  Prior prior(Family::uniform, lower, upper - lower);
  prior.lower_ = lower;
  prior.upper_ = upper;
  return prior;
}

Prior Prior::lognormal(double mu, double sigma) {
  if (!(sigma > 0) || !std::isfinite(mu))
    throw ProjectError("a lognormal prior needs a finite mu and sigma > 0");
  Prior prior(Family::lognormal, mu, sigma);
  prior.lower_ = 0;
  return prior;
}

Prior Prior::with_joint(std::shared_ptr<const JointPrior> joint, std::ptrdiff_t column) const {
  Prior result = *this;
  result.joint_ = std::move(joint);
  result.column_ = column;
  return result;
}

double Prior::mean() const {
  return family_ == Family::uniform ? location_ + 0.5 * scale_ : location_;
}

double Prior::std() const {
  return family_ == Family::uniform ? scale_ / std::sqrt(12) : scale_;
}

double Prior::standardise(double p) const {
  if (family_ == Family::lognormal) return p > 0 ? (std::log(p) - location_) / scale_ : -k_infinity;
  return (p - location_) / scale_;
}

void Prior::restrict_to(double lower, double upper) {
  lower_ = std::max(lower_, lower);
  upper_ = std::min(upper_, upper);
  if (!(upper_ > lower_)) {
    kept_mass_ = 0;
  } else if (family_ == Family::uniform) {
    kept_mass_ = (upper_ - lower_) / scale_;
  } else {
    a_ = standardise(lower_);
    b_ = standardise(upper_);
    below_ = normal_cdf(a_);
    above_ = normal_cdf(-b_);
    kept_mass_ = a_ > 0 ? normal_cdf(-a_) - above_ : normal_cdf(b_) - below_;
  }
}

Prior Prior::truncated(double lower, double upper, const std::string& name) const {
  Prior result = *this;
  result.restrict_to(lower, upper);
  if (!(result.kept_mass_ >= 1e-6)) {
    throw ProjectError(fmt::format(
        "the prior of \"{}\", {}, has {:.2g} of its mass in the model's box [{:g}, {:g}] (at least 1e-6 is "
        "needed): move or widen the prior, or build the model on another box",
        name, describe(), std::max(0.0, result.kept_mass_), lower, upper));
  }
  return result;
}

bool Prior::is_affine() const {
  return family_ == Family::normal && lower_ == -k_infinity && upper_ == k_infinity;
}

double Prior::log_density(double p) const {
  if (!(p >= lower_ && p <= upper_)) return -k_infinity;
  if (family_ == Family::uniform) return -std::log(upper_ - lower_);
  if (family_ == Family::lognormal && p <= 0) return -k_infinity;
  const double s = standardise(p);
  double log_density = -0.5 * s * s - k_log_sqrt_2_pi - std::log(scale_ * kept_mass_);
  if (family_ == Family::lognormal) log_density -= std::log(p);
  return log_density;
}

double Prior::log_density_slope(double p) const {
  if (family_ == Family::uniform) return 0;
  const double s = standardise(p);
  return family_ == Family::normal ? -s / scale_ : -(s / scale_ + 1) / p;
}

double Prior::log_density_curvature(double p) const {
  if (family_ == Family::uniform) return 0;
  if (family_ == Family::normal) return -1 / (scale_ * scale_);
  return (standardise(p) / scale_ + 1 - 1 / (scale_ * scale_)) / (p * p);
}

Prior::Transformed Prior::from_standard_normal(double z) const {
  if (family_ == Family::uniform) {
    const double width = upper_ - lower_, density = normal_pdf(z) * width;
    const double value = z < 0 ? lower_ + width * normal_cdf(z) : upper_ - width * normal_cdf(-z);
    return {value, density, -z * density};
  }
  double s = z, first = 1, second = 0;
  if (below_ > 0 || above_ > 0) {
    // Φ(s) = Φ(a) + kept Φ(z), or the same seen from above, whichever is free of cancellation.
    const double lower_tail = below_ + kept_mass_ * normal_cdf(z);
    const double upper_tail = above_ + kept_mass_ * normal_cdf(-z);
    s = lower_tail < upper_tail ? normal_quantile(lower_tail) : -normal_quantile(upper_tail);
    s = std::clamp(s, a_, b_);
    first = kept_mass_ * std::exp(0.5 * (s - z) * (s + z));
    second = first * (s * first - z);
  }
  if (family_ == Family::normal) return {location_ + scale_ * s, scale_ * first, scale_ * second};
  const double value = std::clamp(std::exp(location_ + scale_ * s), lower_, upper_);
  return {value, value * scale_ * first, value * scale_ * (scale_ * first * first + second)};
}

double Prior::to_standard_normal(double p) const {
  double below = 0, above = 0;  // shares of the mass: the smaller one is free of cancellation
  if (family_ == Family::uniform) {
    below = p - lower_;
    above = upper_ - p;
  } else {
    const double s = standardise(p);
    if (!(below_ > 0 || above_ > 0)) return std::clamp(s, -k_largest_score, k_largest_score);
    below = normal_cdf(s) - below_;
    above = normal_cdf(-s) - above_;
  }
  const double all = below + above;
  const double z = normal_quantile(std::max(0.0, std::min(below, above)) / all);
  return std::copysign(std::min(-z, k_largest_score), below < above ? -1.0 : 1.0);
}

std::string Prior::describe() const {
  std::string text;
  switch (family_) {
    case Family::normal:
      text = fmt::format("normal({:g}, {:g})", location_, scale_);
      break;
    case Family::uniform:
      return fmt::format("uniform({:g}, {:g})", lower_, upper_);
    case Family::lognormal:
      text = fmt::format("lognormal({:g}, {:g})", location_, scale_);
      break;
  }
  if (kept_mass_ < 1) text += fmt::format(" truncated to [{:g}, {:g}]", lower_, upper_);
  if (joint_) text += ", of " + joint_->origin();
  return text;
}

}  // namespace knothe::posterior
