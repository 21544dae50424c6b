#include "knothe/sampling/mode_search.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "knothe/base/error.hpp"
#include "knothe/numerics/sobol.hpp"

namespace knothe::sampling {

namespace {

constexpr int k_max_ascent_iterations = 60;
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
  const Eigen::MatrixXd covariance = vectors * spread.cwiseAbs2().asDiagonal() * vectors.transpose();
  return covariance.llt().matrixL();
}

}  // namespace

void ModeSearch::scan(CheckedDensity& target) {
  const Eigen::Index d = target.dimension(), count = d <= 2 ? 40 : 80;
  if (scan_points_.cols() != d) {
    // Beyond the dimensions of the Sobol table the scan varies the first ones only; Newton does the rest.
    const Eigen::Index scanned = std::min(d, numerics::k_sobol_max_dimension);
    scan_points_ = Eigen::MatrixXd::Zero(count, d);
    scan_points_.leftCols(scanned) = numerics::sobol_normal_points(count, scanned, 20190823);
    scan_points_.row(0).setZero();
    for (Eigen::Index i = 3; i < count; i += 4) scan_points_.row(i) *= 3;
  }
  target.evaluate(scan_points_, 0, batch_);
  scan_values_ = batch_.value;
}

void ModeSearch::choose_starts(bool several) {
  const Eigen::Index n = scan_points_.rows();
  order_.resize(static_cast<std::size_t>(n));
  for (Eigen::Index i = 0; i < n; ++i) order_[static_cast<std::size_t>(i)] = i;
  std::stable_sort(order_.begin(), order_.end(),
                   [&](Eigen::Index a, Eigen::Index b) { return scan_values_[a] > scan_values_[b]; });
  starts_.assign(1, order_.front());
  if (!std::isfinite(scan_values_[order_.front()]))
    throw NumericalError(
        fmt::format("the density is zero at z = 0 and at {} points around it; centre and scale the "
                    "parameters so that the mass is near 0",
                    n - 1));
  if (!several) return;
  // A start is a point with no better one among its 4 nearest: the fourth smallest distance bounds the
  // neighbourhood.
  for (std::size_t r = 1; r < order_.size() && starts_.size() < k_max_starts; ++r) {
    const Eigen::Index i = order_[r];
    if (!std::isfinite(scan_values_[i])) break;
    double nearest[4] = {1e300, 1e300, 1e300, 1e300}, best_better = 1e300;
    for (std::size_t s = 0; s < order_.size(); ++s) {
      if (s == r) continue;
      const double distance = (scan_points_.row(order_[s]) - scan_points_.row(i)).squaredNorm();
      if (s < r) best_better = std::min(best_better, distance);
      if (distance < nearest[3]) {
        nearest[3] = distance;
        std::sort(nearest, nearest + 4);
      }
    }
    if (best_better > nearest[3]) starts_.push_back(i);
  }
}

bool ModeSearch::newton_step(Eigen::Index i) {
  const Eigen::Index d = position_.cols();
  Climber& climber = climbers_[static_cast<std::size_t>(i)];
  double scale = 0;
  for (Eigen::Index a = 0; a < d; ++a) scale = std::max(scale, std::abs(hessian_(i, packed_index(a, a))));
  scale = std::max(scale, 1e-8 * (1 + gradient_.row(i).norm()));
  for (int attempt = 0; attempt < 80; ++attempt) {
    for (Eigen::Index a = 0; a < d; ++a)
      for (Eigen::Index b = 0; b <= a; ++b)
        matrix_(a, b) = -hessian_(i, packed_index(a, b)) + (a == b ? climber.damping : 0.0);
    if (factorise(matrix_)) break;
    climber.damping = std::max(4 * climber.damping, 1e-3 * scale);
  }
  step_ = gradient_.row(i).transpose();
  solve_factorised(matrix_, step_);
  const double predicted = 0.5 * gradient_.row(i).dot(step_);
  if (!step_.allFinite() || (climber.damping < 1e-6 * scale && predicted < 1e-13)) {
    if (step_.allFinite() && predicted > 0)
      position_.row(i) += step_.transpose();  // quadratic convergence: as good as exact
    return false;
  }
  trial_.row(i) = position_.row(i) + step_.transpose();
  return true;
}

void ModeSearch::ascend(CheckedDensity& target) {
  const Eigen::Index d = target.dimension(), m = static_cast<Eigen::Index>(starts_.size());
  climbers_.assign(starts_.size(), Climber{});
  position_.resize(m, d), trial_.resize(m, d), gradient_.resize(m, d), hessian_.resize(m, d * (d + 1) / 2);
  matrix_.resize(d, d), step_.resize(d);
  for (Eigen::Index i = 0; i < m; ++i)
    position_.row(i) = scan_points_.row(starts_[static_cast<std::size_t>(i)]);
  trial_ = position_;
  for (bool first = true;; first = false) {
    batch_of_.clear();
    for (Eigen::Index i = 0; i < m; ++i)
      if (climbers_[static_cast<std::size_t>(i)].active) batch_of_.push_back(i);
    if (batch_of_.empty()) return;
    batch_points_.resize(static_cast<Eigen::Index>(batch_of_.size()), d);
    for (std::size_t r = 0; r < batch_of_.size(); ++r)
      batch_points_.row(static_cast<Eigen::Index>(r)) = trial_.row(batch_of_[r]);
    target.evaluate_with_differences(batch_points_, 2, batch_);
    for (std::size_t r = 0; r < batch_of_.size(); ++r) {
      const Eigen::Index i = batch_of_[r], row = static_cast<Eigen::Index>(r);
      Climber& climber = climbers_[static_cast<std::size_t>(i)];
      const double value = batch_.value[row];
      if (first || value > climber.value || (value == climber.value && climber.damping == 0)) {
        const bool stuck = !first && value == climber.value;
        climber.value = value;
        climber.damping = climber.damping < 1e-8 ? 0 : 0.1 * climber.damping;
        position_.row(i) = trial_.row(i);
        gradient_.row(i) = batch_.gradient.row(row);
        hessian_.row(i) = batch_.hessian.row(row);
        if (stuck) climber.iterations = std::max(climber.iterations, k_max_ascent_iterations - 3);
      } else {
        const double scale = hessian_.row(i).cwiseAbs().maxCoeff() + gradient_.row(i).norm();
        climber.damping = std::max(5 * climber.damping, 1e-2 * scale);
        if (climber.damping > 1e12 * (1 + scale)) climber.active = false;
      }
      if (climber.active) climber.active = ++climber.iterations < k_max_ascent_iterations && newton_step(i);
    }
  }
}

/// Laplace's covariance is the inverse of −∇² log π̄ at the mode (in matrix_). Where that is flat, indefinite
/// or says little about the spread, a step of one standard deviation along an eigenvector does not lower log
/// π̄ by about ½; then the spread along it is corrected.
void ModeSearch::calibrate(CheckedDensity& target, Mode& mode) {
  const Eigen::Index d = mode.point.size();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(matrix_);
  const auto& vectors = eigen.eigenvectors();
  const double largest = std::max(eigen.eigenvalues().cwiseAbs().maxCoeff(), 1e-12);
  Eigen::VectorXd spread = eigen.eigenvalues().cwiseMax(1e-6 * largest).cwiseSqrt().cwiseInverse();
  batch_points_.resize(2 * d, d);
  for (int round = 0; round < 30; ++round) {
    for (Eigen::Index a = 0; a < d; ++a) {
      batch_points_.row(2 * a) = (mode.point + spread[a] * vectors.col(a)).transpose();
      batch_points_.row(2 * a + 1) = (mode.point - spread[a] * vectors.col(a)).transpose();
    }
    target.evaluate(batch_points_, 0, batch_);
    bool fits = true;
    for (Eigen::Index a = 0; a < d; ++a) {
      const double drop = mode.value - 0.5 * (batch_.value[2 * a] + batch_.value[2 * a + 1]);
      if (drop > 0.1 && drop < 4) continue;
      fits = false;
      spread[a] *= drop > 0 ? std::clamp(std::sqrt(0.5 / drop), 0.1, 4.0) : 4.0;
    }
    if (fits) break;
  }
  mode.lower = lower_factor(vectors, spread);
}

void ModeSearch::collect(CheckedDensity& target, std::vector<Mode>& modes) {
  const Eigen::Index d = position_.cols();
  modes.clear();
  for (Eigen::Index i = 0; i < position_.rows(); ++i) {
    for (Eigen::Index a = 0; a < d; ++a)
      for (Eigen::Index b = 0; b < d; ++b) matrix_(a, b) = -hessian_(i, packed_index(a, b));
    Mode mode{position_.row(i).transpose(), climbers_[static_cast<std::size_t>(i)].value, Eigen::MatrixXd(),
              0};
    calibrate(target, mode);
    mode.log_mass = mode.value + 0.5 * static_cast<double>(d) * std::log(2 * std::numbers::pi) +
                    mode.lower.diagonal().array().log().sum();
    // The same mode as one that is already there, if it is near by the measure of that one's own spread.
    const bool known = std::any_of(modes.begin(), modes.end(), [&](const Mode& other) {
      const Eigen::VectorXd distance =
          other.lower.triangularView<Eigen::Lower>().solve((mode.point - other.point).eval());
      return distance.norm() < 0.05 + 1e-6 * other.point.norm();
    });
    if (!known) modes.push_back(std::move(mode));
  }
  std::stable_sort(modes.begin(), modes.end(),
                   [](const Mode& a, const Mode& b) { return a.log_mass > b.log_mass; });
}

void ModeSearch::run(CheckedDensity& target, bool several, std::vector<Mode>& modes) {
  scan(target);
  choose_starts(several);
  ascend(target);
  collect(target, modes);
}

}  // namespace knothe::sampling
