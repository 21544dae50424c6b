#include "knothe/sampling/gaussian_mixture.hpp"

#include <fmt/format.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "knothe/base/error.hpp"

namespace knothe::sampling {

GaussianMixture::GaussianMixture(std::vector<GaussianComponent> components)
    : components_(std::move(components)) {
  if (components_.empty()) throw UsageError("Gaussian mixture: no components");
  double total = 0;
  for (const auto& c : components_) {
    const Eigen::Index d = dimension();
    if (c.centre.size() != d || c.lower.rows() != d || c.lower.cols() != d || d < 1)
      throw UsageError(fmt::format(
          "Gaussian mixture: a centre with {} coordinates and a factor of {} × {} in dimension {}",
          c.centre.size(), c.lower.rows(), c.lower.cols(), d));
    if (!(c.weight > 0) || !(c.lower.diagonal().minCoeff() > 0) || !c.centre.allFinite() ||
        !c.lower.allFinite())
      throw UsageError(
          "Gaussian mixture: weights and the diagonals of the factors must be positive and finite");
    total += c.weight;
  }
  log_factor_.resize(static_cast<Eigen::Index>(components_.size()));
  for (std::size_t k = 0; k < components_.size(); ++k) {
    components_[k].weight /= total;
    log_factor_[static_cast<Eigen::Index>(k)] =
        std::log(components_[k].weight) - components_[k].lower.diagonal().array().log().sum() -
        0.5 * static_cast<double>(dimension()) * std::log(2 * std::numbers::pi);
  }
}

Eigen::MatrixXd GaussianMixture::sample(Eigen::Index n, RandomNumbers& random) const {
  const Eigen::MatrixXd normals = random.normals(n, dimension());
  Eigen::MatrixXd points(n, dimension());
  const double offset = random.uniform();
  Eigen::Index i = 0;
  double cumulative = 0;
  for (std::size_t k = 0; k < components_.size(); ++k) {
    cumulative += components_[k].weight;
    const auto& c = components_[k];
    const bool last = k + 1 == components_.size();
    for (; i < n && (last || static_cast<double>(i) + offset < cumulative * static_cast<double>(n)); ++i)
      points.row(i) = c.centre.transpose() + normals.row(i) * c.lower.transpose();
  }
  return points;
}

void GaussianMixture::log_density(const Eigen::Ref<const Eigen::MatrixXd>& points,
                                  Eigen::VectorXd& out) const {
  out.setConstant(points.rows(), -std::numeric_limits<double>::infinity());
  Eigen::MatrixXd centred;
  for (std::size_t k = 0; k < components_.size(); ++k) {
    const auto& c = components_[k];
    centred = (points.rowwise() - c.centre.transpose()).transpose();
    c.lower.triangularView<Eigen::Lower>().solveInPlace(centred);
    const double factor = log_factor_[static_cast<Eigen::Index>(k)];
    for (Eigen::Index i = 0; i < points.rows(); ++i) {
      const double term = factor - 0.5 * centred.col(i).squaredNorm();
      const double high = std::max(term, out[i]), low = std::min(term, out[i]);
      out[i] = high + std::log1p(std::exp(low - high));
    }
  }
}

}  // namespace knothe::sampling
