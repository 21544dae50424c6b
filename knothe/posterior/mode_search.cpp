#include "knothe/posterior/mode_search.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>

#include "knothe/base/error.hpp"
#include "knothe/numerics/integrate/sobol.hpp"
#include "knothe/numerics/linear/symmetric_eigen.hpp"
#include "knothe/posterior/random_numbers.hpp"

namespace knothe::posterior {

namespace {

constexpr int k_max_ascent_iterations = 80;
constexpr Eigen::Index k_wide_count = 160;
constexpr double k_epsilon = std::numeric_limits<double>::epsilon();
constexpr std::size_t k_max_starts = 8;

/// In-place Cholesky factor of the lower triangle; false where it is not positive definite. Tiny matrices, no
/// allocation.
bool factorise(Eigen::MatrixXd& a) {
  for (Eigen::Index j = 0; j < a.rows(); ++j) {
    double pivot = a(j, j);
    for (Eigen::Index k = 0; k < j; ++k) pivot -= a(j, k) * a(j, k);
    if (!(pivot > 0) || !std::isfinite(pivot)) return false;
    a(j, j) = std::sqrt(pivot);
    for (Eigen::Index i = j + 1; i < a.rows(); ++i) {
      double sum = a(i, j);
      for (Eigen::Index k = 0; k < j; ++k) sum -= a(i, k) * a(j, k);
      a(i, j) = sum / a(j, j);
    }
  }
  return true;
}

/// x ← (L Lᵀ)⁻¹ x.
void solve_factorised(const Eigen::MatrixXd& l, Eigen::VectorXd& x) {
  for (Eigen::Index i = 0; i < x.size(); ++i) {
    for (Eigen::Index k = 0; k < i; ++k) x[i] -= l(i, k) * x[k];
    x[i] /= l(i, i);
  }
  for (Eigen::Index i = x.size(); i-- > 0;) {
    for (Eigen::Index k = i + 1; k < x.size(); ++k) x[i] -= l(k, i) * x[k];
    x[i] /= l(i, i);
  }
}

/// Lower triangular L with L Lᵀ = V diag(spread²) Vᵀ.
Eigen::MatrixXd lower_factor(const Eigen::MatrixXd& vectors, const Eigen::VectorXd& spread) {
  // V diag(spread) = Lᵀ' Q: by orthogonal triangles nothing is squared, so that far too uneven spreads
  // survive.
  const Eigen::MatrixXd rows = spread.asDiagonal() * vectors.transpose();
  Eigen::MatrixXd upper = rows.householderQr().matrixQR().triangularView<Eigen::Upper>();
  for (Eigen::Index a = 0; a < upper.rows(); ++a)
    if (upper(a, a) < 0) upper.row(a) *= -1;
  return upper.transpose();
}

}  // namespace

/// Along column a of `axes` a step of spread[a] is to lower log π̄ by about ½; by more, where the value is so
/// large that rounding hides that.
void fit_spreads(CheckedDensity& target, const Eigen::VectorXd& point, double value,
                 const Eigen::MatrixXd& axes, Eigen::VectorXd& spread) {
  const Eigen::Index count = axes.cols();
  // Too short, too long: where both are known the spread lies between them.
  Eigen::VectorXd low = Eigen::VectorXd::Zero(count);
  Eigen::VectorXd high = Eigen::VectorXd::Constant(count, std::numeric_limits<double>::infinity());
  const double unit = std::max(1.0, 16 * k_epsilon * std::abs(value));
  Eigen::MatrixXd sides(2 * count, point.size());
  LogDensityBatch batch;
  for (int round = 0; round < 60; ++round) {
    for (Eigen::Index a = 0; a < count; ++a) {
      sides.row(2 * a) = (point + spread[a] * axes.col(a)).transpose();
      sides.row(2 * a + 1) = (point - spread[a] * axes.col(a)).transpose();
    }
    target.evaluate(sides, 0, batch);
    bool fits = true;
    for (Eigen::Index a = 0; a < count; ++a) {
      // At a bound the density is zero on one side; the other one tells how wide it is.
      const double up = value - batch.value[2 * a], down = value - batch.value[2 * a + 1];
      const double drop = std::isfinite(up + down) ? 0.5 * (up + down) : std::min(up, down);
      if ((drop > 0.1 * unit && drop < 4 * unit) || high[a] < 1.3 * low[a]) continue;
      fits = false;
      (drop > 0.1 * unit ? high[a] : low[a]) = spread[a];
      const double next = spread[a] * (drop > 0 ? std::clamp(std::sqrt(0.5 * unit / drop), 0.1, 4.0) : 4.0);
      const bool outside = low[a] > 0 && std::isfinite(high[a]) && !(next > low[a] && next < high[a]);
      spread[a] = std::clamp(outside ? std::sqrt(low[a] * high[a]) : next, 1e-12, 1e12);
    }
    if (fits) break;
  }
}

void ModeSearch::scan(CheckedDensity& target, bool wide) {
  const Eigen::Index d = target.dimension();
  if (scan_points_.cols() != d) {
    near_count_ = d <= 2 ? 40 : 80;
    // Beyond the dimensions of the Sobol table the scan varies the first ones only; Newton does the rest.
    const Eigen::Index scanned = std::min(d, numerics::k_sobol_max_dimension);
    scan_points_ = Eigen::MatrixXd::Zero(near_count_ + k_wide_count, d);
    scan_points_.topLeftCorner(near_count_, scanned) =
        numerics::sobol_normal_points(near_count_, scanned, 20190823);
    scan_points_.row(0).setZero();
    for (Eigen::Index i = 3; i < near_count_; i += 4) scan_points_.row(i) *= 3;
    find_neighbours();
    RandomNumbers random(20190823);
    for (Eigen::Index i = 0; i < k_wide_count; ++i) {
      const double common = 13 * random.uniform() - 6.5;
      for (Eigen::Index a = 0; a < d; ++a) {
        const double exponent = i % 2 == 0 ? common : 13 * random.uniform() - 6.5;
        scan_points_(near_count_ + i, a) = random.normal() * std::pow(10.0, exponent);
      }
    }
  }
  target.evaluate(scan_points_.topRows(near_count_), 0, batch_);
  scan_values_ = batch_.value;
  if (!wide && std::isfinite(scan_values_.maxCoeff())) return;
  const CheckedDensity::Leniency lenient(target);  // a million units away a model may well break down
  target.evaluate(scan_points_.bottomRows(k_wide_count), 0, batch_);
  scan_values_.conservativeResize(scan_points_.rows());
  scan_values_.tail(k_wide_count) = batch_.value;
}

/// The four points next to each of the near ones, itself left out.
void ModeSearch::find_neighbours() {
  neighbours_.resize(near_count_);
  for (Eigen::Index i = 0; i < near_count_; ++i) {
    const Eigen::VectorXd distances =
        (scan_points_.topRows(near_count_).rowwise() - scan_points_.row(i)).rowwise().squaredNorm();
    std::vector<Eigen::Index> order(neighbours_.size());
    std::iota(order.begin(), order.end(), Eigen::Index{0});
    auto& nearest = neighbours_[i];
    std::partial_sort(order.begin(), order.begin() + nearest.size() + 1, order.end(),
                      [&](Eigen::Index a, Eigen::Index b) { return distances[a] < distances[b]; });
    std::copy_n(order.begin() + 1, nearest.size(), nearest.begin());
  }
}

void ModeSearch::choose_starts(bool several) {
  const Eigen::Index n = scan_values_.size();
  const auto is_better = [&](Eigen::Index a, Eigen::Index b) {
    return scan_values_[a] > scan_values_[b] || (scan_values_[a] == scan_values_[b] && a < b);
  };
  order_.resize(n);
  std::iota(order_.begin(), order_.end(), Eigen::Index{0});
  std::sort(order_.begin(), order_.end(), is_better);
  starts_.assign(1, order_.front());
  // Far and near look all the same to distances; of the wide points the best few are taken.
  if (n > near_count_)
    for (std::size_t r = 1; r < order_.size() && starts_.size() < 4; ++r)
      if (order_[r] >= near_count_ && std::isfinite(scan_values_[order_[r]])) starts_.push_back(order_[r]);
  if (!several) return;
  const std::size_t most = starts_.size() + k_max_starts - 1;
  for (const Eigen::Index i : order_) {
    if (!std::isfinite(scan_values_[i]) || starts_.size() == most) break;
    if (i == starts_.front() || i >= near_count_) continue;
    const auto& nearest = neighbours_[i];
    if (std::none_of(nearest.begin(), nearest.end(), [&](Eigen::Index k) { return is_better(k, i); }))
      starts_.push_back(i);
  }
}

/// Newton's step in units of each coordinate's own curvature, which makes the search blind to how parameters
/// are scaled. Where there is none, the unit is the length over which log π̄ rises by `reach`. False: at a
/// maximum.
bool ModeSearch::newton_step(Eigen::Index i) {
  const Eigen::Index d = position_.cols();
  Climber& climber = climbers_[i];
  for (Eigen::Index a = 0; a < d; ++a) {
    const double curvature = std::abs(hessian_(i, packed_index(a, a))), slope = std::abs(gradient_(i, a));
    const double inverse = std::max(std::sqrt(curvature), slope / climber.reach);
    unit_[a] = inverse > 0 && std::isfinite(1 / inverse) ? 1 / inverse : scales_(i, a);
  }
  const auto fill = [&](double damping) {
    for (Eigen::Index a = 0; a < d; ++a)
      for (Eigen::Index b = 0; b <= a; ++b)
        matrix_(a, b) = matrix_(b, a) =
            -hessian_(i, packed_index(a, b)) * unit_[a] * unit_[b] + (a == b ? damping : 0.0);
  };
  fill(climber.damping);
  step_ = gradient_.row(i).transpose().cwiseProduct(unit_);
  const Eigen::VectorXd slope = step_;
  bool concave = factorise(matrix_);
  if (concave) {
    solve_factorised(matrix_, step_);
  } else {
    fill(0);
    if (!matrix_.allFinite() || !slope.allFinite()) return false;
    const numerics::SymmetricEigen eigen(matrix_);
    const Eigen::VectorXd size =
        (eigen.eigenvalues().cwiseAbs().array().max(1e-8) + climber.damping).matrix();
    step_ = eigen.eigenvectors() * (eigen.eigenvectors().transpose() * slope).cwiseQuotient(size);
    // Nowhere does a step try to gain more than `reach`.
    const double gain = slope.dot(step_);
    if (gain > climber.reach) step_ *= climber.reach / gain;
  }
  const double predicted = 0.5 * slope.dot(step_);
  step_ = step_.cwiseProduct(unit_);
  if (!step_.allFinite()) return false;
  if (concave && climber.damping < 1e-6 && predicted < 1e-13) {
    if (predicted > 0) position_.row(i) += step_.transpose();  // quadratic convergence: as good as exact
    return false;
  }
  if (!concave && predicted < 1e-13) return false;
  trial_.row(i) = position_.row(i) + step_.transpose();
  return trial_.row(i).allFinite();
}

/// Differences were taken over lengths that may not have suited: too short, the curvature drowns in rounding;
/// too long, it is not that of the point. True if they are to be taken again.
bool ModeSearch::rescale(Eigen::Index i, Eigen::Index row, const CheckedDensity& target) {
  constexpr int k_max_refits = 24;
  const int own = target.available_derivatives();
  Climber& climber = climbers_[i];
  if (own >= 2) return false;
  bool again = false;
  for (Eigen::Index a = 0; a < position_.cols(); ++a) {
    const double curvature = std::abs(batch_.hessian(row, packed_index(a, a))), scale = scales_(i, a);
    const double slope = std::abs(batch_.gradient(row, a));
    const double change = own == 1 ? curvature * 2 * CheckedDensity::k_gradient_step * scale
                                   : curvature * std::pow(CheckedDensity::k_value_step * scale, 2);
    const double noise =
        own == 1 ? 1e3 * k_epsilon * slope : 1e3 * k_epsilon * (1 + std::abs(batch_.value[row]));
    double better = scale;
    if (change > noise)
      better = 1 / std::sqrt(curvature);
    else if (own == 0 || slope == 0)
      better = 30 * scale;
    better = std::clamp(better, 1e-14, 1e14);
    again = again || better > 10 * scale || better < 0.1 * scale;
    scales_(i, a) = better;
  }
  return again && ++climber.refits <= k_max_refits;
}

void ModeSearch::accept(Eigen::Index i, Eigen::Index row) {
  Climber& climber = climbers_[i];
  const double value = batch_.value[row];
  if ((climber.fresh && std::isfinite(value)) || climber.refit || value > climber.value ||
      (value == climber.value && climber.damping == 0)) {
    const bool stuck = !climber.fresh && !climber.refit && value == climber.value;
    climber.value = value;
    if (!climber.refit) {
      climber.damping = climber.damping < 1e-6 ? 0 : 0.1 * climber.damping;
      if (!climber.fresh) climber.reach *= 3;
    }
    position_.row(i) = trial_.row(i);
    gradient_.row(i) = batch_.gradient.row(row);
    hessian_.row(i) = batch_.hessian.row(row);
    if (stuck) climber.iterations = std::max(climber.iterations, k_max_ascent_iterations - 3);
  } else {
    if (climber.fresh) climber.active = false;  // nothing finite where it began
    climber.damping = std::max(5 * climber.damping, 1e-2);
    climber.reach = std::max(1.0, 0.1 * climber.reach);
    if (climber.damping > 1e12) climber.active = false;
    return;
  }
  climber.fresh = false;
}

/// From the rows of `trial_`.
void ModeSearch::ascend(CheckedDensity& target, const std::function<bool()>& is_enough) {
  const Eigen::Index d = target.dimension(), m = trial_.rows();
  climbers_.assign(m, Climber{});
  position_ = trial_;
  gradient_.resize(m, d), hessian_.resize(m, d * (d + 1) / 2);
  matrix_.resize(d, d), step_.resize(d), unit_.resize(d);
  scales_.setOnes(m, d);
  while (true) {
    batch_of_.clear();
    for (Eigen::Index i = 0; i < m; ++i)
      if (climbers_[i].active) batch_of_.push_back(i);
    if (batch_of_.empty() || (is_enough && is_enough())) return;
    batch_points_.resize(std::ssize(batch_of_), d);
    batch_scales_.resize(std::ssize(batch_of_), d);
    for (std::size_t r = 0; r < batch_of_.size(); ++r) {
      batch_points_.row(r) = trial_.row(batch_of_[r]);
      batch_scales_.row(r) = scales_.row(batch_of_[r]);
    }
    target.evaluate_with_differences(batch_points_, 2, batch_scales_, batch_);
    for (std::size_t r = 0; r < batch_of_.size(); ++r) {
      const Eigen::Index i = batch_of_[r], row = r;
      Climber& climber = climbers_[i];
      const bool better = climber.fresh || climber.refit || batch_.value[row] > climber.value;
      accept(i, row);
      climber.refit = false;
      if (!climber.active) continue;
      if (better && rescale(i, row, target)) {
        climber.refit = true;
        trial_.row(i) = position_.row(i);
        continue;
      }
      climber.active = ++climber.iterations < k_max_ascent_iterations && newton_step(i);
    }
  }
}

/// Laplace's covariance is the inverse of −∇² log π̄ at the mode. Where that is flat, indefinite or says
/// little about the spread, a step of one standard deviation along an eigenvector does not lower log π̄ by
/// about ½; then the spread along it is corrected. All in units of the coordinates' own curvature.
void ModeSearch::calibrate(CheckedDensity& target, Eigen::Index climber, Mode& mode) {
  const Eigen::Index d = mode.point.size();
  for (Eigen::Index a = 0; a < d; ++a) {
    const double curvature = std::abs(hessian_(climber, packed_index(a, a)));
    const double unit = 1 / std::sqrt(curvature);
    unit_[a] =
        curvature > 0 && std::isfinite(unit) ? unit : 1;  // lengths of differences have grown without end
  }
  for (Eigen::Index a = 0; a < d; ++a)
    for (Eigen::Index b = 0; b < d; ++b)
      matrix_(a, b) = -hessian_(climber, packed_index(a, b)) * unit_[a] * unit_[b];
  const numerics::SymmetricEigen eigen(matrix_);
  const auto& vectors = eigen.eigenvectors();
  const double largest = std::max(eigen.eigenvalues().cwiseAbs().maxCoeff(), 1e-12);
  Eigen::VectorXd spread = eigen.eigenvalues().cwiseMax(1e-9 * largest).cwiseSqrt().cwiseInverse();
  fit_spreads(target, mode.point, mode.value, unit_.asDiagonal() * vectors, spread);
  mode.lower = unit_.asDiagonal() * lower_factor(vectors, spread);
}

void ModeSearch::collect(CheckedDensity& target, std::vector<Mode>& modes) {
  const Eigen::Index d = position_.cols();
  const auto same = [](const Mode& known, const Mode& mode) {
    const Eigen::VectorXd distance =
        known.lower.triangularView<Eigen::Lower>().solve((mode.point - known.point).eval());
    return distance.norm() < 0.05 + std::min(1.0, 1e-6 * known.point.norm());
  };
  for (Eigen::Index i = 0; i < position_.rows(); ++i) {
    if (climbers_[i].fresh) continue;
    const double value = climbers_[i].value;
    Mode mode{position_.row(i).transpose(), value, Eigen::MatrixXd(), 0};
    // The same mode as one that is already there, if it is near by the measure of that one's own spread.
    if (std::any_of(modes.begin(), modes.end(), [&](const Mode& known) { return same(known, mode); }))
      continue;
    calibrate(target, i, mode);
    mode.log_mass =
        mode.value + 0.5 * d * std::log(2 * std::numbers::pi) + mode.lower.diagonal().array().log().sum();
    if (std::isfinite(mode.log_mass)) modes.push_back(std::move(mode));
  }
  std::stable_sort(modes.begin(), modes.end(),
                   [](const Mode& a, const Mode& b) { return a.log_mass > b.log_mass; });
}

void ModeSearch::ascend_from(CheckedDensity& target, const Eigen::Ref<const Eigen::MatrixXd>& starts,
                             std::vector<Mode>& modes, const std::function<bool()>& is_enough) {
  if (starts.rows() == 0) return;
  const CheckedDensity::Leniency lenient(target);
  trial_ = starts;
  ascend(target, is_enough);
  collect(target, modes);
}

void ModeSearch::run(CheckedDensity& target, bool several, std::vector<Mode>& modes, ScanReach reach) {
  if (target.dimension() < 1)
    throw UsageError(fmt::format("a density in {} dimensions; there must be at least 1", target.dimension()));
  scan(target, reach == ScanReach::wide);
  if (!std::isfinite(scan_values_.maxCoeff()))
    throw NumericalError(fmt::format(
        "the density is zero at z = 0 and at {} points around it, 1e-6 to 1e6 away; centre and scale "
        "the parameters so that the mass is near 0",
        scan_values_.size() - 1));
  choose_starts(several);
  trial_.resize(std::ssize(starts_), target.dimension());
  for (std::size_t i = 0; i < starts_.size(); ++i) trial_.row(i) = scan_points_.row(starts_[i]);
  modes.clear();
  if (scan_values_.size() == near_count_) {
    ascend(target);
    collect(target, modes);
    return;
  }
  const CheckedDensity::Leniency lenient(target);
  ascend(target);
  collect(target, modes);
}

}  // namespace knothe::posterior
