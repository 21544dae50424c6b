#include "knothe/posterior/draws/mixture_fit.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>

#include "knothe/base/error.hpp"

namespace knothe::posterior {
namespace {

using Components = std::vector<MixtureComponent>;

/// Below this share of all weight, or with fewer points than it has coordinates, a component goes.
constexpr double k_min_weight = 1e-4;

/// The lower triangle's matrix, no eigenvalue of it below `least`.
Eigen::MatrixXd at_least(const Eigen::MatrixXd& covariance, double least) {
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> axes(covariance);
  return axes.eigenvectors() * axes.eigenvalues().cwiseMax(least).asDiagonal() *
         axes.eigenvectors().transpose();
}

class Fit {
 public:
  Fit(const Eigen::Ref<const Eigen::MatrixXd>& points, const Eigen::Ref<const Eigen::VectorXd>& weights,
      const MixtureFitOptions& options)
      : points_(points),
        weights_(weights),
        max_iterations_(options.max_iterations),
        min_gain_(options.min_gain),
        min_std_(options.min_std),
        size_(options.worth > 0 ? options.worth : 1 / weights.squaredNorm()),
        d_(points.cols()),
        min_variance_(Eigen::VectorXd::Zero(d_)) {
    const Components all = one();
    if (!all.empty())
      min_variance_ =
          1e-6 * all.front().lower.rowwise().squaredNorm().array() + std::numeric_limits<double>::min();
  }

  /// One Gaussian of all points.
  [[nodiscard]] Components one() {
    Components components;
    add(weights_.array(), components);
    return components;
  }

  /// Log-likelihood per point at the end.
  double iterate(Components& components) {
    double last = -std::numeric_limits<double>::infinity(), now = last;
    for (int i = 0; i < max_iterations_; ++i) {
      now = step(components);
      if (i > 0 && now - last < min_gain_) break;
      last = now;
    }
    return now;
  }

  /// Bayes' information criterion as a log-likelihood: the larger the better.
  [[nodiscard]] double criterion(const Components& components, double log_likelihood) const {
    const double d = d_;
    const double parameters = components.size() * (1 + d + 0.5 * d * (d + 1));
    return size_ * log_likelihood - 0.5 * std::log(size_) * parameters;
  }

 private:
  /// One iteration; the log-likelihood before it.
  double step(Components& components) {
    Mixture(components).log_densities(points_, shares_);
    largest_ = shares_.col(0);
    for (Eigen::Index k = 1; k < shares_.cols(); ++k) largest_ = largest_.max(shares_.col(k));
    sum_.setZero(points_.rows());
    for (Eigen::Index k = 0; k < shares_.cols(); ++k) {
      shares_.col(k) = (shares_.col(k) - largest_).exp();
      sum_ += shares_.col(k);
    }
    const double log_likelihood = (weights_.array() * (largest_ + sum_.log())).sum();
    sum_ = weights_.array() / sum_;
    Components next;
    for (Eigen::Index k = 0; k < shares_.cols(); ++k) {
      shares_.col(k) *= sum_;
      add(shares_.col(k), next);
    }
    if (!next.empty()) components = std::move(next);
    return log_likelihood;
  }

  /// The Gaussian of points with these weights.
  void add(const Eigen::Ref<const Eigen::ArrayXd>& share, Components& components) {
    const double weight = share.sum();
    if (!(weight > k_min_weight) || weight * weight < (d_ + 2) * share.square().sum()) return;
    MixtureComponent c;
    c.weight = weight;
    c.centre.resize(d_);
    Eigen::MatrixXd covariance(d_, d_);
    for (Eigen::Index a = 0; a < d_; ++a) c.centre[a] = points_.col(a).dot(share.matrix()) / weight;
    for (Eigen::Index a = 0; a < d_; ++a) {
      weighted_ = share * (points_.col(a).array() - c.centre[a]);
      for (Eigen::Index b = 0; b <= a; ++b)
        covariance(a, b) = (weighted_ * (points_.col(b).array() - c.centre[b])).sum() / weight;
      covariance(a, a) += min_variance_[a];
    }
    if (min_std_ > 0) covariance = at_least(covariance, min_std_ * min_std_);
    const Eigen::LLT<Eigen::MatrixXd> factor(covariance);  // of the lower triangle
    if (factor.info() != Eigen::Success) return;
    c.lower = factor.matrixL();
    components.push_back(std::move(c));
  }

  const Eigen::Ref<const Eigen::MatrixXd>& points_;
  const Eigen::Ref<const Eigen::VectorXd>& weights_;
  int max_iterations_;
  double min_gain_, min_std_;
  double size_;  ///< as many points as the weights are worth
  Eigen::Index d_;
  Eigen::VectorXd min_variance_;
  Eigen::ArrayXXd shares_;
  Eigen::ArrayXd largest_, sum_, weighted_;
};

/// Two halves of each along its longest axis, with the same mean and covariance together.
Components split(const Components& components) {
  constexpr double k_apart = 0.7;  // in standard deviations of the axis, from the middle
  Components halves;
  for (const MixtureComponent& c : components) {
    const Eigen::MatrixXd covariance = c.lower * c.lower.transpose();
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> axes(covariance);
    const Eigen::VectorXd longest =
        axes.eigenvectors().rightCols<1>() * std::sqrt(axes.eigenvalues().tail<1>()[0]);
    const Eigen::LLT<Eigen::MatrixXd> factor(covariance - k_apart * k_apart * longest * longest.transpose());
    for (const double side : {-k_apart, k_apart}) {
      MixtureComponent half = c;
      half.weight *= 0.5;
      half.centre += side * longest;
      if (factor.info() == Eigen::Success) half.lower = factor.matrixL();
      halves.push_back(std::move(half));
    }
  }
  return halves;
}

}  // namespace

std::vector<MixtureComponent> fit_mixture(const Eigen::Ref<const Eigen::MatrixXd>& points,
                                          const Eigen::Ref<const Eigen::VectorXd>& weights,
                                          std::vector<MixtureComponent> start,
                                          const MixtureFitOptions& options) {
  if (points.rows() < 2) throw UsageError(fmt::format("mixture: {} points to fit one to", points.rows()));
  Fit fit(points, weights, options);
  Components best = start.empty() ? fit.one() : std::move(start);
  if (best.empty()) throw NumericalError("mixture: the points have no spread");
  double criterion = fit.criterion(best, fit.iterate(best));
  while (2 * best.size() <= options.max_components) {
    Components more = split(best);
    const double log_likelihood = fit.iterate(more);
    const double now = fit.criterion(more, log_likelihood);
    if (now <= criterion) break;
    criterion = now;
    best = std::move(more);
  }
  return best;
}

}  // namespace knothe::posterior
