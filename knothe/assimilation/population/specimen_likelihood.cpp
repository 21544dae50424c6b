#include "knothe/assimilation/population/specimen_likelihood.hpp"

#include <Eigen/Cholesky>
#include <cmath>

#include "knothe/numerics/linear/symmetric_eigen.hpp"
#include "knothe/numerics/statistics/weighted_statistics.hpp"
#include "knothe/posterior/prior/joint_prior.hpp"

namespace knothe::assimilation {
namespace {

using Eigen::Index;

/// Precisions of the priors (d), 0 of a flat one.
Eigen::VectorXd precisions_of(const ReferencePrior& prior) {
  return prior.std.array().isFinite().select(prior.std.array().square().inverse(), 0.0);
}

double log_determinant(const Eigen::LLT<SmallMatrix>& factor) {
  return 2 * factor.matrixLLT().diagonal().array().log().sum();
}

/// The symmetric matrix without its negative eigenvalues.
SmallMatrix positive_part(const SmallMatrix& matrix) {
  const numerics::SymmetricEigen eigen(matrix);
  if (eigen.eigenvalues()[0] >= 0) return matrix;
  return eigen.eigenvectors() * eigen.eigenvalues().cwiseMax(0).asDiagonal() *
         eigen.eigenvectors().transpose();
}

/// Of exp(c + hᵀx − ½ xᵀΛx) N(x; μ, L Lᵀ) with x = μ + L y: A = I + LᵀΛL and b = Lᵀ(h − Λμ), so that
/// y ~ N(A⁻¹b, A⁻¹).
struct Product {
  Product(const SmallVector& linear, const SmallMatrix& precision, const PopulationNormal& population)
      : pull(linear - precision * population.mean), right(population.lower.transpose() * pull) {
    SmallMatrix a = population.lower.transpose() * precision * population.lower;
    a.diagonal().array() += 1;
    factor.compute(a);
    mean = factor.solve(right);
  }
  SmallVector pull, right, mean;  ///< h − Λμ, b, A⁻¹b
  Eigen::LLT<SmallMatrix> factor;

  [[nodiscard]] double log_mass(double log_factor, const SmallVector& linear, const SmallVector& at) const {
    return log_factor + 0.5 * (linear + pull).dot(at) + 0.5 * right.dot(mean) - 0.5 * log_determinant(factor);
  }
};

}  // namespace

SpecimenLikelihood::Part SpecimenLikelihood::divided(const Eigen::VectorXd& mean,
                                                     const Eigen::MatrixXd& covariance,
                                                     const ReferencePrior& prior) {
  const Index d = mean.size();
  const Eigen::VectorXd of_prior = precisions_of(prior);
  SmallMatrix precision = Eigen::LLT<SmallMatrix>(covariance).solve(SmallMatrix::Identity(d, d));
  precision.diagonal() -= of_prior;
  precision = positive_part(precision);
  SmallMatrix of_posterior = precision;
  of_posterior.diagonal() += of_prior;
  const SmallVector pull = of_posterior * mean, prior_pull = of_prior.cwiseProduct(prior.mean);
  double log_factor = 0.5 * log_determinant(Eigen::LLT<SmallMatrix>(of_posterior)) - 0.5 * pull.dot(mean) +
                      0.5 * prior_pull.dot(prior.mean);
  for (Index k = 0; k < d; ++k)
    log_factor += std::isfinite(prior.std[k]) ? std::log(prior.std[k]) : -0.5 * k_log_two_pi;
  return {log_factor, pull - prior_pull, precision};
}

SpecimenLikelihood::SpecimenLikelihood(const std::vector<posterior::MixtureComponent>& posterior,
                                       const ReferencePrior& prior, double log_factor) {
  double total = 0;
  for (const posterior::MixtureComponent& c : posterior) total += c.weight;
  for (const posterior::MixtureComponent& c : posterior) {
    parts_.push_back(divided(c.centre, c.lower * c.lower.transpose(), prior));
    parts_.back().log_factor += log_factor + std::log(c.weight / total);
  }
  const posterior::JointPrior moments(posterior, "");
  const Part matched = divided(moments.mean(), moments.covariance(), prior);
  const numerics::SymmetricEigen eigen(matched.precision);
  // Where the data say nothing the place is open, and the distance does not depend on it.
  const Eigen::ArrayXd values = eigen.eigenvalues().array();
  const Eigen::VectorXd inverse = (values > 1e-12 * values.abs().maxCoeff()).select(values.inverse(), 0.0);
  matched_mean_ = eigen.eigenvectors() * inverse.asDiagonal() * eigen.eigenvectors().transpose() *
                  Eigen::VectorXd(matched.linear);
  matched_precision_ = matched.precision;
}

SpecimenLikelihood::SpecimenLikelihood(const Eigen::VectorXd& mean, const Eigen::MatrixXd& covariance,
                                       const ReferencePrior& prior)
    : SpecimenLikelihood({{1.0, mean, covariance.llt().matrixL()}}, prior) {}

double SpecimenLikelihood::log_integral(const PopulationNormal& population) const {
  Eigen::VectorXd masses(parts_.size());
  for (std::size_t k = 0; k < parts_.size(); ++k) {
    const Product product(parts_[k].linear, parts_[k].precision, population);
    masses[k] = product.log_mass(parts_[k].log_factor, parts_[k].linear, population.mean);
  }
  return numerics::log_sum(masses);
}

std::vector<SpecimenLikelihood::Conditional> SpecimenLikelihood::given(
    const PopulationNormal& population) const {
  std::vector<Conditional> conditionals;
  for (const Part& part : parts_) {
    const Product product(part.linear, part.precision, population);
    // A⁻¹ = U⁻¹U⁻ᵀ with A = UᵀU.
    const SmallMatrix inverse =
        product.factor.matrixU().solve(SmallMatrix::Identity(part.linear.size(), part.linear.size()));
    conditionals.push_back({product.log_mass(part.log_factor, part.linear, population.mean),
                            population.mean + population.lower * product.mean, population.lower * inverse});
  }
  return conditionals;
}

double SpecimenLikelihood::squared_distance(const PopulationNormal& population) const {
  const SmallVector linear = matched_precision_ * matched_mean_;
  const Product product(linear, matched_precision_, population);
  const double squared =
      (matched_mean_ - population.mean).dot(product.pull) - product.right.dot(product.mean);
  return std::max(0.0, squared);
}

}  // namespace knothe::assimilation
