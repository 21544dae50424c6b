#pragma once
/// @file Priors of one parameter, and the change of variables p = F⁻¹(Φ(z)) under which a prior is N(0, 1).
#include <array>
#include <cstddef>
#include <limits>
#include <memory>
#include <string>

#include "knothe/base/enum_names.hpp"

namespace knothe::posterior {

class JointPrior;

/// Prior density π₀ of one parameter, possibly restricted to an interval and renormalised there (every prior
/// is truncated to the model's box: nothing extrapolates silently).
class Prior {
 public:
  enum class Family { normal, uniform, lognormal };

  /// Before any truncation; std, sigma > 0, upper > lower.
  [[nodiscard]] static Prior normal(double mean, double std);
  [[nodiscard]] static Prior uniform(double lower, double upper);
  /// log p is normal with mean `mu` and standard deviation `sigma`.
  [[nodiscard]] static Prior lognormal(double mu, double sigma);

  /// The same as coordinate `column` of a joint prior (`marginal_of`).
  [[nodiscard]] Prior with_joint(std::shared_ptr<const JointPrior> joint, std::ptrdiff_t column) const;

  /// The same family restricted to [lower, upper] (infinite: not restricted on that side) and renormalised.
  /// Throws ProjectError naming parameter `name` if less than 1e-6 of the untruncated prior's mass lies
  /// inside.
  [[nodiscard]] Prior truncated(double lower, double upper, const std::string& name) const;

  [[nodiscard]] Family family() const { return family_; }
  /// Mean and standard deviation before any truncation, of p, or of log p where that is normal.
  [[nodiscard]] double mean() const;
  [[nodiscard]] double std() const;
  [[nodiscard]] double lower() const { return lower_; }  ///< of the support
  [[nodiscard]] double upper() const { return upper_; }
  /// What it is part of, or nothing: then it is independent of the others.
  [[nodiscard]] const std::shared_ptr<const JointPrior>& joint() const { return joint_; }
  [[nodiscard]] std::ptrdiff_t column() const { return column_; }
  /// Neither truncated nor bounded by its family, and normal: then p = mean + std z exactly.
  [[nodiscard]] bool is_affine() const;

  /// log π₀(p), -infinity outside the support.
  [[nodiscard]] double log_density(double p) const;
  /// d log π₀/dp and d² log π₀/dp² inside the support.
  [[nodiscard]] double log_density_slope(double p) const;
  [[nodiscard]] double log_density_curvature(double p) const;

  /// p(z) = F⁻¹(Φ(z)) with dp/dz and d²p/dz², F the distribution function of this prior.
  struct Transformed {
    double value, first, second;
  };
  [[nodiscard]] Transformed from_standard_normal(double z) const;
  /// z(p) = Φ⁻¹(F(p)), its inverse; within ±38 also at the ends of the support and outside.
  [[nodiscard]] double to_standard_normal(double p) const;

  /// One line: "normal(0.9, 0.447) truncated to [0.5, 1.5]".
  [[nodiscard]] std::string describe() const;

 private:
  Prior(Family family, double location, double scale);
  void restrict_to(double lower, double upper);
  [[nodiscard]] double standardise(double p) const;

  Family family_;
  double location_, scale_;  ///< mean and std; mu and sigma; or lower and width
  double lower_ = -std::numeric_limits<double>::infinity();
  double upper_ = std::numeric_limits<double>::infinity();
  // In the standardised variable s (normal: (p − mean)/std, lognormal: (log p − mu)/sigma) the support is [a,
  // b]; of the standard normal, `below_` lies below a and `above_` above b.
  double a_ = -std::numeric_limits<double>::infinity(), b_ = std::numeric_limits<double>::infinity();
  double below_ = 0, above_ = 0;
  double kept_mass_ = 1;
  std::shared_ptr<const JointPrior> joint_;
  std::ptrdiff_t column_ = 0;
};

constexpr auto names_of(Prior::Family /*family*/) {
  using Family = Prior::Family;
  return std::to_array<Named<Family>>(
      {{Family::normal, "normal"}, {Family::uniform, "uniform"}, {Family::lognormal, "lognormal"}});
}

}  // namespace knothe::posterior
