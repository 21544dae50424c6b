#include "knothe/forecast/nearest_crack.hpp"

#include <cmath>
#include <limits>

namespace knothe::forecast {

namespace {
constexpr double k_accuracy = 1e-10;  // m
}

NearestCrack::NearestCrack(const CrackMetaModel& meta_model, const Eigen::Ref<const Eigen::MatrixXd>& factor)
    : basis_(meta_model.basis()),
      fields_(factor * meta_model.coefficients()),
      gram_(fields_.transpose() * fields_) {
  const auto breaks = basis_.breaks();
  for (std::size_t j = 0; j + 1 < breaks.size(); ++j) {
    Interval interval;
    for (Eigen::Index k = 0; k < 4; ++k) {
      interval.length[k] = std::lerp(breaks[j], breaks[j + 1], (static_cast<double>(k) + 0.5) / 4);
      const auto local = basis_.evaluate(interval.length[k]);
      interval.basis.row(k) = Eigen::Map<const Eigen::RowVector4d>(local.value.data());
      interval.half_square[k] =
          0.5 * (fields_.middleCols<4>(local.first) * interval.basis.row(k).transpose()).squaredNorm();
    }
    intervals_.push_back(interval);
  }
}

Eigen::VectorXd NearestCrack::lengths(const Eigen::Ref<const Eigen::MatrixXd>& targets) const {
  const Eigen::MatrixXd products = fields_.transpose() * targets;
  Eigen::VectorXd lengths(targets.cols());
  for (Eigen::Index i = 0; i < lengths.size(); ++i) lengths[i] = nearest(products.col(i).data());
  return lengths;
}

double NearestCrack::nearest(const double* products) const {
  std::size_t best = 0;
  Eigen::Index place = 0;
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t j = 0; j < intervals_.size(); ++j) {
    const Eigen::Vector4d square =
        intervals_[j].half_square - intervals_[j].basis * Eigen::Map<const Eigen::Vector4d>(products + j);
    if (square.minCoeff() >= least) continue;
    least = square.minCoeff(&place);
    best = j;
  }
  const auto& here = intervals_[best].length;
  const double low = place > 0  ? here[place - 1]
                     : best > 0 ? intervals_[best - 1].length[3]
                                : basis_.breaks().front();
  const double high = place < 3                      ? here[place + 1]
                      : best + 1 < intervals_.size() ? intervals_[best + 1].length[0]
                                                     : basis_.breaks().back();
  return root(products, low, high);
}

double NearestCrack::root(const double* products, double low, double high) const {
  // Of the derivative b'ᵀ(FᵀF b − Fᵀt), by regula falsi with the Illinois rule: it is continuous but only
  // piecewise smooth.
  const auto derivative = [&](double length) {
    const auto local = basis_.evaluate(length);
    const Eigen::Map<const Eigen::Vector4d> b(local.value.data()), slope(local.first_derivative.data());
    return slope.dot(gram_.block<4, 4>(local.first, local.first) * b -
                     Eigen::Map<const Eigen::Vector4d>(products + local.first));
  };
  double at_low = derivative(low), at_high = derivative(high);
  if (at_low >= 0.0) return low;
  if (at_high <= 0.0) return high;
  int side = 0;
  for (int k = 0; k < 60 && high - low > k_accuracy; ++k) {
    const double root = (low * at_high - high * at_low) / (at_high - at_low);
    const double middle = root > low && root < high ? root : 0.5 * (low + high);
    const double at_middle = derivative(middle);
    if (at_middle == 0.0) return middle;
    if (at_middle < 0.0) {
      if (middle - low < k_accuracy) return middle;
      low = middle, at_low = at_middle;
      if (side < 0) at_high *= 0.5;
      side = -1;
    } else {
      if (high - middle < k_accuracy) return middle;
      high = middle, at_high = at_middle;
      if (side > 0) at_low *= 0.5;
      side = 1;
    }
  }
  return 0.5 * (low + high);
}

}  // namespace knothe::forecast
