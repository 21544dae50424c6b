#include "knothe/assimilation/inference/posterior_density.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "knothe/base/error.hpp"

namespace knothe::assimilation {
namespace {

using posterior::packed_index;

constexpr double k_log_2_pi = 1.8378770664093454836;
constexpr double k_zero_density = -1e300;  ///< log-densities below are −∞ (JSON has no infinity)
/// Points whose Jacobians are held at once.
constexpr Eigen::Index k_chunk = 256;

std::vector<Eigen::Index> finite_rows(const Eigen::Ref<const Eigen::MatrixXd>& points) {
  std::vector<Eigen::Index> rows;
  for (Eigen::Index i = 0; i < points.rows(); ++i)
    if (points.row(i).allFinite()) rows.push_back(i);
  return rows;
}

/// `part`, of some rows, in the middle of points without density.
void scatter(const posterior::LogDensityBatch& part, const std::vector<Eigen::Index>& rows, int derivatives,
             posterior::LogDensityBatch& out) {
  out.value.setConstant(-std::numeric_limits<double>::infinity());
  out.value(rows) = part.value;
  if (derivatives >= 1) out.gradient.setZero(), out.gradient(rows, Eigen::all) = part.gradient;
  if (derivatives >= 2) out.hessian.setZero(), out.hessian(rows, Eigen::all) = part.hessian;
}

}  // namespace

PosteriorDensity::PosteriorDensity(ModelEvaluator& evaluator, std::vector<posterior::Prior> priors,
                                   std::optional<Observations> observations, int highest_derivative)
    : evaluator_(&evaluator),
      transform_(std::move(priors)),
      observations_(std::move(observations)),
      highest_derivative_(highest_derivative) {
  const Eigen::Index m = evaluator.model().output_count();
  if (dimension() < 1) throw UsageError("inference needs at least one parameter");
  if (!observations_ && m != 1)
    throw DataError(fmt::format("{}: a log posterior density is one number, but the model returns {}",
                                evaluator.model().where(), m));
  if (observations_ && (observations_->values.size() != m || observations_->noise.size() != m))
    throw UsageError(fmt::format("{}: {} observations with the noise of {}, but the model returns {} values",
                                 evaluator.model().where(), observations_->values.size(),
                                 observations_->noise.size(), m));
}

std::optional<PosteriorDensity::Misfit> PosteriorDensity::misfit(const Eigen::VectorXd& p) {
  if (!observations_) return std::nullopt;
  posterior::LogDensityBatch batch;
  batch.resize(1, dimension(), 0);
  log_likelihood(p.transpose(), 0, batch);
  const Eigen::Index m = observations_->values.size();
  const double constant = 0.5 * observations_->noise.log_determinant() + 0.5 * m * k_log_2_pi;
  return Misfit{-2 * (batch.value[0] + constant), values_.col(0)};
}

Eigen::MatrixXd PosteriorDensity::parameters(const Eigen::Ref<const Eigen::MatrixXd>& z) const {
  Eigen::MatrixXd p(z.rows(), z.cols()), unused;
  transform_.evaluate(z, 0, p, unused, unused);
  return p;
}

/// Value, gradient and Hessian in p of the rows from `begin` whose points are in points_.
void PosteriorDensity::model_part(int derivatives, Eigen::Index begin, posterior::LogDensityBatch& out) {
  const Eigen::Index c = points_.cols(), d = points_.rows();
  evaluator_->evaluate(points_, values_);
  if (!observations_) return density_part(derivatives, begin, out);
  const likelihood::JointNoise& noise = observations_->noise;
  const Eigen::Index m = values_.rows();
  sensitivities_ = (-values_).colwise() + observations_->values;
  weighted_ = noise.apply(sensitivities_);
  out.value.segment(begin, c) = -0.5 * sensitivities_.cwiseProduct(weighted_).colwise().sum().transpose();
  out.value.segment(begin, c).array() -= 0.5 * noise.log_determinant() + 0.5 * m * k_log_2_pi;
  if (derivatives < 1) return;
  sensitivities_ = weighted_;
  const bool own_gradient = evaluator_->has_gradient();
  if (own_gradient) {
    evaluator_->gradient(points_, sensitivities_, gradients_);
    out.gradient.middleRows(begin, c) = gradients_.transpose();
  }
  if (own_gradient && derivatives < 2) return;
  evaluator_->jacobian(points_, jacobians_);
  if (derivatives >= 2 && evaluator_->has_hessian())
    evaluator_->hessian(points_, sensitivities_, hessians_);
  else
    hessians_.setZero(d * d, c);
  for (Eigen::Index i = 0; i < c; ++i) {
    jacobian_ = jacobians_.col(i).reshaped(m, d);
    if (!own_gradient) out.gradient.row(begin + i) = sensitivities_.col(i).transpose() * jacobian_;
    if (derivatives < 2) continue;
    weighted_ = noise.apply(jacobian_);
    for (Eigen::Index a = 0; a < d; ++a)
      for (Eigen::Index b = 0; b <= a; ++b)
        out.hessian(begin + i, packed_index(a, b)) =
            hessians_(a * d + b, i) - jacobian_.col(a).dot(weighted_.col(b));
  }
}

void PosteriorDensity::density_part(int derivatives, Eigen::Index begin, posterior::LogDensityBatch& out) {
  const Eigen::Index c = points_.cols(), d = points_.rows();
  std::vector<Eigen::Index> inside;
  for (Eigen::Index i = 0; i < c; ++i) {
    const bool is_zero = values_(0, i) <= k_zero_density;
    out.value[begin + i] = is_zero ? -std::numeric_limits<double>::infinity() : values_(0, i);
    if (!is_zero) inside.push_back(i);
  }
  if (derivatives < 1) return;
  out.gradient.middleRows(begin, c).setZero();
  if (derivatives >= 2) out.hessian.middleRows(begin, c).setZero();
  if (inside.empty()) return;
  const Eigen::MatrixXd points = points_(Eigen::all, inside);
  sensitivities_ = Eigen::MatrixXd::Ones(1, points.cols());
  if (evaluator_->has_gradient())
    evaluator_->gradient(points, sensitivities_, gradients_);
  else
    evaluator_->jacobian(points, gradients_);
  if (derivatives >= 2) evaluator_->hessian(points, sensitivities_, hessians_);
  // A neighbour at which the density is zero makes differences meaningless: none is better.
  const auto sane = [](double x) { return std::abs(x) < 1e200 ? x : 0.0; };
  for (std::size_t j = 0; j < inside.size(); ++j) {
    const Eigen::Index row = begin + inside[j], col = j;
    for (Eigen::Index a = 0; a < d; ++a) {
      out.gradient(row, a) = sane(gradients_(a, col));
      for (Eigen::Index b = 0; b <= a && derivatives >= 2; ++b)
        out.hessian(row, packed_index(a, b)) = sane(hessians_(a * d + b, col));
    }
  }
}

void PosteriorDensity::log_likelihood(const Eigen::Ref<const Eigen::MatrixXd>& p, int derivatives,
                                      posterior::LogDensityBatch& out) {
  const Eigen::Index n = p.rows(), d = p.cols();
  out.resize(n, d, derivatives);
  if (!p.allFinite()) {
    const std::vector<Eigen::Index> rows = finite_rows(p);
    posterior::LogDensityBatch part;
    log_likelihood(p(rows, Eigen::all), derivatives, part);
    return scatter(part, rows, derivatives, out);
  }
  for (Eigen::Index begin = 0; begin < n; begin += k_chunk) {
    points_ = p.middleRows(begin, std::min(k_chunk, n - begin)).transpose();
    model_part(derivatives, begin, out);
  }
  if (observations_) return;
  for (Eigen::Index i = 0; i < n; ++i)
    for (Eigen::Index k = 0; k < d; ++k) {
      const posterior::Prior& prior = transform_.prior(k);
      out.value[i] -= prior.log_density(p(i, k));
      if (derivatives >= 1) out.gradient(i, k) -= prior.log_density_slope(p(i, k));
      if (derivatives >= 2) out.hessian(i, packed_index(k, k)) -= prior.log_density_curvature(p(i, k));
    }
}

/// Adds log dp_k/dz_k with its derivatives, by formula: its derivatives from the transform would need the
/// third one.
void PosteriorDensity::add_change_of_variables(Eigen::Index k, const Eigen::Ref<const Eigen::VectorXd>& z,
                                               int derivatives, posterior::LogDensityBatch& out) const {
  const posterior::Prior& prior = transform_.prior(k);
  using Family = posterior::Prior::Family;
  const auto at_zero = prior.from_standard_normal(0);
  if (prior.family() == Family::uniform) {  // p' = width φ(z)
    out.value.array() += std::log(at_zero.first) - 0.5 * z.array().square();
    if (derivatives >= 1) out.gradient.col(k) -= z;
    if (derivatives >= 2) out.hessian.col(packed_index(k, k)).array() -= 1;
    return;
  }
  out.value.array() += std::log(at_zero.first);
  if (prior.family() == Family::normal) return;        // p' = std
  const double sigma = at_zero.first / at_zero.value;  // lognormal: p' = σ exp(μ + σ z)
  out.value += sigma * z;
  if (derivatives >= 1) out.gradient.col(k).array() += sigma;
}

void PosteriorDensity::evaluate(const Eigen::Ref<const Eigen::MatrixXd>& z, int derivatives,
                                posterior::LogDensityBatch& out) {
  const Eigen::Index n = z.rows(), d = z.cols();
  p_.resize(n, d), first_.resize(n, d), second_.resize(n, d);
  transform_.evaluate(z, derivatives, p_, first_, second_);
  if (!p_.allFinite()) {
    const std::vector<Eigen::Index> rows = finite_rows(p_);
    posterior::LogDensityBatch part;
    part.resize(std::ssize(rows), d, derivatives);
    evaluate(z(rows, Eigen::all), derivatives, part);
    return scatter(part, rows, derivatives, out);
  }
  for (Eigen::Index begin = 0; begin < n; begin += k_chunk) {
    points_ = p_.middleRows(begin, std::min(k_chunk, n - begin)).transpose();
    model_part(derivatives, begin, out);
  }
  if (observations_) transform_.add_dependence(p_, derivatives, out);
  if (derivatives >= 2) {
    for (Eigen::Index a = 0; a < d; ++a) {
      for (Eigen::Index b = 0; b <= a; ++b)
        out.hessian.col(packed_index(a, b)).array() *= first_.col(a).array() * first_.col(b).array();
      out.hessian.col(packed_index(a, a)).array() += out.gradient.col(a).array() * second_.col(a).array();
    }
  }
  if (derivatives >= 1) out.gradient.array() *= first_.array();
  if (!observations_) {
    for (Eigen::Index k = 0; k < d; ++k) add_change_of_variables(k, z.col(k), derivatives, out);
    return;
  }
  out.value.array() -= 0.5 * z.rowwise().squaredNorm().array() + 0.5 * d * k_log_2_pi;
  if (derivatives >= 1) out.gradient -= z;
  if (derivatives >= 2)
    for (Eigen::Index a = 0; a < d; ++a) out.hessian.col(packed_index(a, a)).array() -= 1;
}

}  // namespace knothe::assimilation
