#include "knothe/assimilation/forecast/crack_bridge.hpp"

#include <fmt/core.h>

#include <Eigen/Cholesky>
#include <Eigen/QR>
#include <algorithm>
#include <array>
#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/numerics/linear/symmetric_eigen.hpp"
#include "knothe/numerics/statistics/random.hpp"
#include "knothe/numerics/statistics/weighted_statistics.hpp"
#include "knothe/posterior/map/samples/sample_map.hpp"

namespace knothe::assimilation {
namespace {

constexpr int k_parts_per_spacing = 4;  // points of the first pass per distance of two snapshots
constexpr Index k_max_samples = 1024;
constexpr Index k_max_mapped_axes = 4;  // of the map of the predicted field
constexpr double k_min_share = 0.1;     // of δ²: variance of the posterior along an axis that is mapped
constexpr unsigned k_seed = 1;

void check(const CrackMetaModel& meta_model, const LinearPrediction& prediction, double imposed_displacement,
           const CrackBridgeOptions& options) {
  if (!(options.prior_std > 0.0) || !std::isfinite(options.prior_std) || !std::isfinite(options.prior_mean))
    throw ProjectError(
        fmt::format("crack length: prior = {{ mean = {}, std = {} }}: both finite, std positive",
                    options.prior_mean, options.prior_std));
  if (!std::isfinite(options.threshold))
    throw ProjectError("crack length: threshold must be a finite length in m");
  const Index n = meta_model.observations();
  if (prediction.lift.size() != n || prediction.modes.rows() != n)
    throw DataError(fmt::format(
        "crack length: the crack solutions are given at {} observed dofs, the prediction's lift at {} "
        "and its modes at {}",
        n, prediction.lift.size(), prediction.modes.rows()));
  if (!prediction.lift.allFinite() || !prediction.modes.allFinite() || !std::isfinite(imposed_displacement))
    throw DataError("crack length: the prediction at the horizon is not finite");
  if (imposed_displacement == 0.0)
    throw ProjectError(
        "crack length: the imposed displacement at the horizon is 0, so the crack cannot be seen; choose "
        "a later horizon");
}

void require_discrepancy(double discrepancy_std) {
  if (!(discrepancy_std > 0.0) || !std::isfinite(discrepancy_std))
    throw NumericalError(
        fmt::format("crack length: a discrepancy of {} m: must be positive and finite", discrepancy_std));
}

/// C such that C Cᵀ = covariance + floor² I; by eigenvalues where rounding spoils Cholesky's factorisation.
Eigen::MatrixXd square_root(const Eigen::MatrixXd& covariance, double floor) {
  Eigen::MatrixXd shifted = covariance;
  shifted.diagonal().array() += floor * floor;
  const Eigen::LLT<Eigen::MatrixXd> factor(shifted);
  if (factor.info() == Eigen::Success && factor.matrixLLT().diagonal().minCoeff() > 0.1 * floor)
    return factor.matrixL();
  const numerics::SymmetricEigen eigen(covariance);
  const Eigen::MatrixXd root =
      eigen.eigenvectors() *
      (eigen.eigenvalues().cwiseMax(0.0).array() + floor * floor).sqrt().matrix().asDiagonal();
  // Lower triangular again: root rootᵀ = L Lᵀ with Lᵀ the R of rootᵀ.
  const Eigen::HouseholderQR<Eigen::MatrixXd> qr(root.transpose());
  const Eigen::MatrixXd upper = qr.matrixQR().triangularView<Eigen::Upper>();
  return upper.transpose();
}

/// Upper triangular (or trapezoidal) factor R of a = Q R, and Qᵀ b.
struct Reduced {
  Eigen::MatrixXd factor;
  Eigen::VectorXd target;
};

Reduced reduce(const Eigen::MatrixXd& a, const Eigen::VectorXd& b) {
  const Eigen::HouseholderQR<Eigen::MatrixXd> qr(a);
  const Index rows = std::min(a.rows(), a.cols());
  Reduced reduced;
  reduced.factor = qr.matrixQR().topRows(rows).triangularView<Eigen::Upper>();
  const Eigen::VectorXd rotated = qr.householderQ().adjoint() * b;
  reduced.target = rotated.head(rows);
  return reduced;
}

/// u_imp σ_k u_k, lift and A in an orthonormal basis of their span, of which the first vectors span the
/// cracks.
Eigen::MatrixXd coordinates_of(const CrackMetaModel& meta_model, const LinearPrediction& prediction,
                               double imposed_displacement, const CrackBridgeOptions& options) {
  check(meta_model, prediction, imposed_displacement, options);
  Eigen::MatrixXd all(meta_model.observations(), meta_model.modes() + 1 + prediction.modes.cols());
  all << imposed_displacement * meta_model.space(), prediction.lift, prediction.modes;
  // Columns differ by orders of magnitude; without pivoting QR keeps each column's own relative accuracy.
  const Eigen::HouseholderQR<Eigen::MatrixXd> qr(all);
  return qr.matrixQR().topRows(std::min(all.rows(), all.cols())).triangularView<Eigen::Upper>();
}

}  // namespace

CrackBridge::CrackBridge(CrackMetaModel meta_model, const LinearPrediction& prediction,
                         double imposed_displacement, const CrackBridgeOptions& options)
    : CrackBridge(std::move(meta_model),
                  coordinates_of(meta_model, prediction, imposed_displacement, options), options) {}

CrackBridge::CrackBridge(CrackMetaModel&& meta_model, const Eigen::MatrixXd& coordinates,
                         const CrackBridgeOptions& options)
    : meta_model_(std::move(meta_model)),
      options_(options),
      crack_(coordinates.leftCols(meta_model_.modes())),
      lift_(coordinates.col(meta_model_.modes())),
      modes_(coordinates.rightCols(coordinates.cols() - meta_model_.modes() - 1)),
      nearest_(meta_model_, crack_.topRows(crack_rows())) {
  const auto lengths = meta_model_.lengths();
  for (Index i = 0; i + 1 < std::ssize(lengths); ++i)
    for (int part = 0; part < k_parts_per_spacing; ++part)
      base_.push_back(lengths[i] + (lengths[i + 1] - lengths[i]) * part / k_parts_per_spacing);
  base_.push_back(lengths.back());
  base_values_ = meta_model_.coordinates(base_);
  const Eigen::Map<const Eigen::ArrayXd> base(base_.data(), std::ssize(base_));
  base_prior_ = -0.5 * ((base - options_.prior_mean) / options_.prior_std).square();
}

CrackForecast CrackBridge::update(const Eigen::Ref<const model::RowMatrix>& functions,
                                  const Eigen::Ref<const Eigen::VectorXd>& weights) const {
  if (functions.rows() > k_max_samples) {
    const auto drawn = numerics::equal_draws_along(along_crack(functions, weights), weights, k_max_samples);
    return update(functions(drawn, Eigen::all), Eigen::VectorXd::Ones(k_max_samples));
  }
  const Nearest found = nearest(functions);
  return forecast(found.length, found.square, weights);
}

CrackBridge::Nearest CrackBridge::nearest(const Eigen::Ref<const model::RowMatrix>& functions) const {
  Eigen::MatrixXd misfit = fields_of(functions);
  Nearest found{nearest_.lengths(misfit.topRows(crack_rows())), {}};
  const std::span<const double> lengths(found.length.data(), found.length.size());
  misfit.topRows(crack_rows()) -= crack_.topRows(crack_rows()) * meta_model_.coordinates(lengths);
  found.square = misfit.colwise().squaredNorm();
  return found;
}

CrackForecast CrackBridge::forecast(const Eigen::Ref<const Eigen::VectorXd>& lengths,
                                    const Eigen::Ref<const Eigen::VectorXd>& squares,
                                    const Eigen::Ref<const Eigen::VectorXd>& weights) const {
  CrackForecast forecast;
  const Eigen::VectorXd meant = lengths.unaryExpr([&](double length) { return options_.curve(length); });
  forecast.length = forecast_of_samples(meant, weights, options_.threshold, options_.error_std);
  // One of the dofs' worth is spent on the length.
  forecast.discrepancy_std = std::sqrt(std::max(squares.dot(weights), 0.0) / weights.sum() /
                                       std::max<Index>(meta_model_.observations() - 1, 1));
  return forecast;
}

ScalarForecast CrackBridge::published_by_map(const Eigen::Ref<const model::RowMatrix>& functions,
                                             const Eigen::Ref<const Eigen::VectorXd>& weights,
                                             double discrepancy_std) const {
  require_discrepancy(discrepancy_std);
  const FunctionMoments moments = moments_of_functions(functions, weights);
  const numerics::SymmetricEigen spread(modes_ * moments.covariance * modes_.transpose());
  const double noise = discrepancy_std * discrepancy_std;
  const Index k = spread.eigenvalues().size();
  Index mapped = 0;  // axes along which the posterior is wider than a part of δ
  while (mapped < std::min(k, k_max_mapped_axes) &&
         spread.eigenvalues()[k - 1 - mapped] > k_min_share * noise)
    ++mapped;
  if (mapped == 0) return published(moments, discrepancy_std);

  const Eigen::MatrixXd axes = spread.eigenvectors().rightCols(mapped);
  const Eigen::VectorXd mean = lift_ + modes_ * moments.mean;
  const Index n = std::min(k_max_samples, functions.rows());
  const model::RowMatrix drawn = functions(numerics::equal_draws(weights, n), Eigen::all);
  const Eigen::MatrixXd centred =
      (drawn.rowwise() - moments.mean.transpose()) * (axes.transpose() * modes_).transpose();
  const posterior::SampleMap map = posterior::map_from_samples(
      centred + discrepancy_std * numerics::monte_carlo_normal_points(n, mapped, k_seed));
  const Eigen::MatrixXd others = spread.eigenvectors().leftCols(k - mapped).transpose();
  const Eigen::VectorXd precision =
      (spread.eigenvalues().head(k - mapped).cwiseMax(0.0).array() + noise).inverse();
  const auto log_density = [&](std::span<const double> lengths, std::span<double> out) {
    const Eigen::MatrixXd fields = (crack_ * meta_model_.coordinates(lengths)).colwise() - mean;
    const Eigen::VectorXd log_mapped = map.log_density((axes.transpose() * fields).transpose());
    const Eigen::VectorXd rest = (others * fields).cwiseAbs2().transpose() * precision;
    for (Index i = 0; i < std::ssize(lengths); ++i) {
      const double prior = (lengths[i] - options_.prior_mean) / options_.prior_std;
      const Index row = i;
      out[i] = log_mapped[row] - 0.5 * (rest[row] + prior * prior);
    }
  };
  std::vector<double> base_log(base_.size());
  log_density(base_, base_log);
  return options_.curve(
      forecast_of_density(base_, base_log, log_density, options_.curve.inverse(options_.threshold)));
}

ScalarForecast CrackBridge::published(const FunctionMoments& moments, double discrepancy_std) const {
  require_discrepancy(discrepancy_std);
  if (moments.mean.size() != modes_.cols() || moments.covariance.rows() != modes_.cols() ||
      moments.covariance.cols() != modes_.cols())
    throw NumericalError("crack length: moments of another number of functions than the model has");
  if (!moments.mean.allFinite() || !moments.covariance.allFinite())
    throw NumericalError("crack length: the moments of the posterior are not finite");
  // S = C Cov[w] Cᵀ + δ² I in the coordinates of the basis, S = L Lᵀ.
  const Eigen::MatrixXd covariance =
      modes_ * moments.covariance.selfadjointView<Eigen::Lower>() * modes_.transpose();
  const Eigen::MatrixXd root = square_root(0.5 * (covariance + covariance.transpose()), discrepancy_std);
  const auto lower = root.triangularView<Eigen::Lower>();
  const Eigen::VectorXd target = lower.solve(lift_ + modes_ * moments.mean);
  // |L⁻¹(crack_ v − E[u])|² = |R v − t|² + a number that does not depend on l.
  const Reduced reduced = reduce(lower.solve(crack_), target);

  // The GEMM form at the points of the first pass.
  Eigen::MatrixXd fields = reduced.factor * base_values_;
  fields.colwise() -= reduced.target;
  const Eigen::VectorXd base_log = base_prior_ - 0.5 * fields.colwise().squaredNorm().transpose();

  Eigen::VectorXd value(meta_model_.modes()), field(reduced.target.size());
  const auto log_density = [&](std::span<const double> lengths, std::span<double> out) {
    for (Index i = 0; i < std::ssize(lengths); ++i) {
      meta_model_.evaluate(lengths[i], value);
      field.noalias() = reduced.factor * value;
      const double prior = (lengths[i] - options_.prior_mean) / options_.prior_std;
      out[i] = -0.5 * (prior * prior + (field - reduced.target).squaredNorm());
    }
  };
  return options_.curve(forecast_of_density(base_, {base_log.data(), base_.size()}, log_density,
                                            options_.curve.inverse(options_.threshold)));
}

Eigen::MatrixXd CrackBridge::fields_of(const Eigen::Ref<const model::RowMatrix>& functions) const {
  if (functions.cols() != modes_.cols())
    throw NumericalError("crack length: samples of another number of functions than the model has");
  return (modes_ * functions.transpose()).colwise() + lift_;
}

Eigen::VectorXd CrackBridge::along_crack(const Eigen::Ref<const model::RowMatrix>& functions,
                                         const Eigen::Ref<const Eigen::VectorXd>& weights) const {
  const Eigen::RowVectorXd mean = weights.transpose() * functions / weights.sum();
  const double length = nearest(model::RowMatrix(mean)).length[0];
  const auto lengths = meta_model_.lengths();
  const double spacing = (lengths.back() - lengths.front()) / (lengths.size() - 1);
  const Eigen::MatrixXd sides = meta_model_.coordinates(std::array{length - spacing, length + spacing});
  const Index rows = crack_rows();
  const Eigen::VectorXd tangent = crack_.topRows(rows) * (sides.col(1) - sides.col(0));
  return functions * (modes_.topRows(rows).transpose() * tangent);
}

}  // namespace knothe::assimilation
