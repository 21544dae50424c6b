#include "knothe/assimilation/update/maximum_a_posteriori.hpp"

#include <cmath>
#include <vector>

#include "knothe/numerics/linear/symmetric_eigen.hpp"

namespace knothe::assimilation {
namespace {

constexpr int k_max_iterations = 60;
constexpr double k_border = 1e-6;  ///< of the prior's width: so near a bound is at it
constexpr double k_longest = 10;   ///< step, in widths of the widest prior

/// −log π(p | data) up to its constant, with derivatives.
class NegativeLogPosterior {
 public:
  NegativeLogPosterior(const LogLikelihood& log_likelihood, const posterior::PriorTransform& transform)
      : log_likelihood_(log_likelihood), transform_(transform) {
    const Eigen::Index d = transform.dimension();
    batch_.resize(1, d, 2);
    gradient.resize(d);
    hessian.resize(d, d);
  }

  double evaluate(const Eigen::VectorXd& p, int derivatives) {
    log_likelihood_(p.transpose(), derivatives, batch_);
    transform_.add_log_density(p.transpose(), derivatives, batch_);
    if (derivatives < 2) return -batch_.value[0];
    gradient = -batch_.gradient.row(0).transpose();
    for (Eigen::Index a = 0; a < p.size(); ++a)
      for (Eigen::Index b = 0; b < p.size(); ++b)
        hessian(a, b) = -batch_.hessian(0, posterior::packed_index(a, b));
    return -batch_.value[0];
  }

  Eigen::VectorXd gradient;
  Eigen::MatrixXd hessian;

 private:
  const LogLikelihood& log_likelihood_;
  const posterior::PriorTransform& transform_;
  posterior::LogDensityBatch batch_;
};

/// −|H|⁻¹ g on the free variables, zero on the others; eigenvalues made positive, so that it always descends.
/// Nowhere is the step longer than `longest`: beside a kink, and in an exponential, there is no curvature.
Eigen::VectorXd newton_direction(const NegativeLogPosterior& f, const std::vector<Eigen::Index>& free,
                                 double longest) {
  Eigen::VectorXd direction = Eigen::VectorXd::Zero(f.gradient.size());
  if (free.empty()) return direction;
  const numerics::SymmetricEigen eigen(f.hessian(free, free));
  const Eigen::VectorXd in_basis = eigen.eigenvectors().transpose() * Eigen::VectorXd(f.gradient(free));
  const double floor = std::max(1e-12 * eigen.eigenvalues().cwiseAbs().maxCoeff(), 1e-290);
  const Eigen::VectorXd curvature =
      eigen.eigenvalues().cwiseAbs().cwiseMax(floor).cwiseMax(in_basis.cwiseAbs() / longest);
  direction(free) = -(eigen.eigenvectors() * in_basis.cwiseQuotient(curvature));
  return direction;
}

}  // namespace

Eigen::VectorXd maximum_a_posteriori(likelihood::CollapsedLogDensity& target,
                                     const posterior::PriorTransform& transform,
                                     const Eigen::Ref<const Eigen::VectorXd>& start) {
  const LogLikelihood log_likelihood = [&target](const auto& p, int derivatives, auto& out) {
    target.evaluate_likelihood(p, derivatives, out);
  };
  return maximum_a_posteriori(log_likelihood, transform, start);
}

Eigen::VectorXd maximum_a_posteriori(const LogLikelihood& log_likelihood,
                                     const posterior::PriorTransform& transform,
                                     const Eigen::Ref<const Eigen::VectorXd>& start, double step_tolerance) {
  const Eigen::Index d = start.size();
  Eigen::VectorXd lower(d), upper(d), width(d);
  for (Eigen::Index a = 0; a < d; ++a) {
    lower[a] = transform.prior(a).lower();
    upper[a] = transform.prior(a).upper();
    if (transform.prior(a).family() == posterior::Prior::Family::lognormal)
      lower[a] = std::max(lower[a], 1e-300);
    width[a] =
        transform.prior(a).from_standard_normal(1).value - transform.prior(a).from_standard_normal(-1).value;
  }
  NegativeLogPosterior f(log_likelihood, transform);
  Eigen::VectorXd p = start.cwiseMax(lower).cwiseMin(upper);
  double value = f.evaluate(p, 2);
  for (int iteration = 0; iteration < k_max_iterations; ++iteration) {
    // A variable just inside a bound and pushed outwards is moved onto it: left where it is, it would cut
    // every step short (Bertsekas' ε-active set).
    const Eigen::VectorXd before = p;
    for (Eigen::Index a = 0; a < d; ++a) {
      if (f.gradient[a] > 0 && p[a] - lower[a] <= k_border * width[a]) p[a] = lower[a];
      if (f.gradient[a] < 0 && upper[a] - p[a] <= k_border * width[a]) p[a] = upper[a];
    }
    if (p != before) value = f.evaluate(p, 2);
    std::vector<Eigen::Index> free;
    for (Eigen::Index a = 0; a < d; ++a) {
      const bool held = (p[a] <= lower[a] && f.gradient[a] > 0) || (p[a] >= upper[a] && f.gradient[a] < 0);
      if (!held) free.push_back(a);
    }
    const Eigen::VectorXd direction = newton_direction(f, free, k_longest * width.maxCoeff());
    if ((direction.cwiseAbs().array() <= step_tolerance * width.array()).all()) break;
    bool improved = false;
    for (double length = 1; length > 1e-10; length *= 0.5) {
      const Eigen::VectorXd trial = (p + length * direction).cwiseMax(lower).cwiseMin(upper);
      const double trial_value = f.evaluate(trial, 0);
      if (trial_value <= value + 1e-4 * f.gradient.dot(trial - p) && trial != p) {
        p = trial;
        improved = true;
        break;
      }
    }
    if (!improved) break;  // rounding: nothing better within reach
    value = f.evaluate(p, 2);
  }
  return p;
}

}  // namespace knothe::assimilation
