#include "knothe/likelihood/noise/noise_level.hpp"

#include <fmt/format.h>

#include <cmath>

#include "knothe/base/error.hpp"

namespace knothe::likelihood {

NoiseLevel::NoiseLevel(double shape, double scale) : shape_(shape), scale_(scale) {
  if (!(shape > 0) || !(scale > 0)) {
    throw UsageError(
        fmt::format("the prior of the noise level is inverse-gamma({}, {}): shape and scale must be positive",
                    shape, scale));
  }
  set(StepForm{});
}

void NoiseLevel::set(const StepForm& form) {
  exponent_ = shape_ + 0.5 * (form.used - form.discounted);
  log_normaliser_ = form.log_normaliser;
  constant_ =
      -0.5 * log_normaliser_ + shape_ * std::log(scale_) - std::lgamma(shape_) + std::lgamma(exponent_);
}

void NoiseLevel::marginalise(int derivatives, posterior::LogDensityBatch& out) const {
  const Eigen::Index n = out.value.size();
  for (Eigen::Index i = 0; i < n; ++i) {
    const double bracket = scale_ - (out.value[i] + 0.5 * log_normaliser_);  // b + Q₀/2
    const double first = exponent_ / bracket, second = first / bracket;
    out.value[i] = constant_ - exponent_ * std::log(bracket);
    if (derivatives >= 2) {
      for (Eigen::Index a = 0; a < out.gradient.cols(); ++a) {
        for (Eigen::Index b = 0; b <= a; ++b) {
          double& entry = out.hessian(i, posterior::packed_index(a, b));
          entry = first * entry + second * out.gradient(i, a) * out.gradient(i, b);
        }
      }
    }
    if (derivatives >= 1) out.gradient.row(i) *= first;
  }
}

double NoiseLevel::expected(double log_likelihood) const {
  return std::exp((constant_ - log_likelihood) / exponent_) / (exponent_ - 1);
}

}  // namespace knothe::likelihood
