#include "knothe/posterior/draws/mixture.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <numbers>

#include "knothe/base/error.hpp"

namespace knothe::posterior {
namespace {

/// Points that are worked on together, in the fastest memory.
constexpr Eigen::Index k_block = 256;

void require_component(const MixtureComponent& c, Eigen::Index d) {
  if (c.centre.size() != d || c.lower.rows() != d || c.lower.cols() != d || d < 1)
    throw UsageError(
        fmt::format("mixture: a centre with {} coordinates and a factor of {} × {} in dimension {}",
                    c.centre.size(), c.lower.rows(), c.lower.cols(), d));
  if (!(c.weight > 0) || !(c.lower.diagonal().minCoeff() > 0) || !c.centre.allFinite() ||
      !c.lower.allFinite())
    throw UsageError("mixture: weights and the diagonals of the factors must be positive and finite");
}

/// log of the constant of the density of Student's t, or of a Gaussian, of unit scale.
double log_normalisation(double tails, double d) {
  if (std::isinf(tails)) return -0.5 * d * std::log(2 * std::numbers::pi);
  return std::lgamma(0.5 * (tails + d)) - std::lgamma(0.5 * tails) -
         0.5 * d * std::log(tails * std::numbers::pi);
}

}  // namespace

Mixture::Mixture(std::vector<MixtureComponent> components, double tails)
    : components_(std::move(components)), tails_(tails) {
  if (components_.empty()) throw UsageError("mixture: no components");
  if (!std::isinf(tails) && !(tails >= 2 && tails <= 1000 && std::fmod(tails, 2) == 0))
    throw UsageError(
        fmt::format("mixture: {} degrees of freedom; they are an even number or infinite", tails));
  const Eigen::Index d = dimension();
  double total = 0;
  for (const MixtureComponent& c : components_) {
    require_component(c, d);
    total += c.weight;
  }
  log_factor_.resize(std::ssize(components_));
  for (std::size_t k = 0; k < components_.size(); ++k) {
    MixtureComponent& c = components_[k];
    c.weight /= total;
    log_factor_[k] =
        std::log(c.weight) - c.lower.diagonal().array().log().sum() + log_normalisation(tails_, d);
    inverse_.emplace_back(Eigen::MatrixXd::Identity(d, d));
    c.lower.triangularView<Eigen::Lower>().solveInPlace(inverse_.back());
    whitened_.emplace_back(inverse_.back() * c.centre);
  }
}

Eigen::MatrixXd Mixture::sample(Eigen::Index n, RandomNumbers& random) const {
  Eigen::MatrixXd points;
  sample(n, random, points);
  return points;
}

Eigen::MatrixXd Mixture::points(const Eigen::Ref<const Eigen::MatrixXd>& normal) const {
  Eigen::MatrixXd points(normal.rows(), dimension());
  Eigen::Index i = 0;
  double cumulative = 0;
  for (std::size_t k = 0; k < components_.size(); ++k) {
    const MixtureComponent& c = components_[k];
    cumulative += c.weight;
    const bool last = k + 1 == components_.size();
    for (; i < points.rows() && (last || i + 0.5 < cumulative * points.rows()); ++i)
      points.row(i) = (c.centre + c.lower * normal.row(i).transpose()).transpose();
  }
  return points;
}

void Mixture::sample(Eigen::Index n, RandomNumbers& random, Eigen::MatrixXd& points) const {
  points.resize(n, dimension());
  const double offset = random.uniform();
  Eigen::Index i = 0;
  double cumulative = 0;
  Eigen::VectorXd normals(dimension());
  for (std::size_t k = 0; k < components_.size(); ++k) {
    const MixtureComponent& c = components_[k];
    cumulative += c.weight;
    const bool last = k + 1 == components_.size();
    for (; i < n && (last || i + offset < cumulative * n); ++i) {
      for (double& normal : normals) normal = random.normal();
      points.row(i) = (c.centre + stretch(random) * (c.lower * normals)).transpose();
    }
  }
}

/// Of Student's t: √(ν/χ²), χ² of ν degrees of freedom, −2 log of ν/2 uniform numbers.
double Mixture::stretch(RandomNumbers& random) const {
  if (is_gaussian()) return 1;
  double product = 1;
  for (double k = 0; k < tails_; k += 2) product *= random.uniform();
  return std::sqrt(tails_ / (-2 * std::log(product)));
}

void Mixture::log_densities(const Eigen::Ref<const Eigen::MatrixXd>& points, Eigen::ArrayXXd& out) const {
  const Eigen::Index n = points.rows(), d = dimension();
  out.resize(n, std::ssize(components_));
  Eigen::ArrayXd y(k_block);
  for (Eigen::Index begin = 0; begin < n; begin += k_block) {
    const Eigen::Index size = std::min(k_block, n - begin);
    auto whitened = y.head(size);
    for (Eigen::Index k = 0; k < out.cols(); ++k) {
      const Eigen::MatrixXd& inverse = inverse_[k];
      auto sum = out.col(k).segment(begin, size);
      sum.setZero();
      for (Eigen::Index j = 0; j < d; ++j) {
        whitened.setConstant(-whitened_[k][j]);
        for (Eigen::Index a = 0; a <= j; ++a)
          whitened += inverse(j, a) * points.col(a).segment(begin, size).array();
        sum += whitened.square();
      }
      if (is_gaussian())
        sum = log_factor_[k] - 0.5 * sum;
      else
        sum = log_factor_[k] - 0.5 * (tails_ + d) * (1 + sum / tails_).log();
    }
  }
}

void Mixture::log_density(const Eigen::Ref<const Eigen::MatrixXd>& points, Eigen::VectorXd& out) const {
  out.resize(points.rows());
  Eigen::ArrayXXd parts;
  Eigen::ArrayXd largest, sum;
  for (Eigen::Index begin = 0; begin < points.rows(); begin += k_block) {
    const Eigen::Index size = std::min(k_block, points.rows() - begin);
    log_densities(points.middleRows(begin, size), parts);
    largest = parts.col(0);
    for (Eigen::Index k = 1; k < parts.cols(); ++k) largest = largest.max(parts.col(k));
    sum = (parts.col(0) - largest).exp();
    for (Eigen::Index k = 1; k < parts.cols(); ++k) sum += (parts.col(k) - largest).exp();
    out.segment(begin, size) = (largest + sum.log()).matrix();
  }
}

/// With shares s_k of the components at a point and ∇ℓ_k = −P_k (x − m_k): ∇ℓ = Σ s_k ∇ℓ_k,
/// ∇²ℓ = Σ s_k (∇ℓ_k ∇ℓ_kᵀ − P_k) − ∇ℓ ∇ℓᵀ.
void Mixture::evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives,
                       LogDensityBatch& out) const {
  assert(is_gaussian());
  const Eigen::Index n = points.rows(), d = dimension();
  out.resize(n, d, derivatives);
  log_density(points, out.value);
  if (derivatives < 1) return;
  Eigen::ArrayXXd shares;
  log_densities(points, shares);
  shares = (shares.colwise() - out.value.array()).exp();
  out.gradient.setZero();
  if (derivatives >= 2) out.hessian.setZero();
  for (Eigen::Index k = 0; k < shares.cols(); ++k) {
    const Eigen::MatrixXd precision = inverse_[k].transpose() * inverse_[k];
    const Eigen::MatrixXd slope = (-(points.rowwise() - components_[k].centre.transpose())) * precision;
    const auto share = shares.col(k);
    out.gradient.array() += slope.array().colwise() * share;
    for (Eigen::Index a = 0; derivatives >= 2 && a < d; ++a)
      for (Eigen::Index b = 0; b <= a; ++b)
        out.hessian.col(packed_index(a, b)).array() +=
            share * (slope.col(a).array() * slope.col(b).array() - precision(a, b));
  }
  for (Eigen::Index a = 0; derivatives >= 2 && a < d; ++a)
    for (Eigen::Index b = 0; b <= a; ++b)
      out.hessian.col(packed_index(a, b)).array() -=
          out.gradient.col(a).array() * out.gradient.col(b).array();
}

}  // namespace knothe::posterior
