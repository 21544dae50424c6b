// Gauss and Newton with a constant matrix: the hot part of a correlation.
#include <fmt/format.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>

#include "knothe/base/cancellation.hpp"
#include "knothe/base/index.hpp"
#include "knothe/base/threads.hpp"
#include "knothe/imaging/correlation/correlation_stage.hpp"

namespace knothe::imaging {

namespace {

constexpr double k_longest_step = 1.25;  // times that of Gauss and Newton
constexpr double k_small_step = 0.01;    // px, after which the residual need not be looked at again
// Of the tolerance: an element that moved less is not looked at again. So little that a field does not depend
// on where its search began.
constexpr double k_continued = 0.005;

/// Σ N ∇f r of one element.
Eigen::Matrix<double, 8, 1> right_of(const ElementPixels& element, const ResidualSums& sums) {
  Eigen::Matrix<double, 8, 1> b = Eigen::Matrix<double, 8, 1>::Zero();
  for (std::size_t a = 0; a < 4; ++a)
    for (std::size_t m = 0; m < 4; ++m) {
      b[2 * a] += element.coefficients[a][m] * sums.x[m];
      b[2 * a + 1] += element.coefficients[a][m] * sums.y[m];
    }
  return b;
}

}  // namespace

void CorrelationStage::sum_residuals(const SplineImage& deformed, const CorrelationResult& result) {
  constexpr std::size_t k_chunk = 32;  // elements per task
  std::vector<std::size_t> stale;
  for (Index e = 0; e < std::ssize(moved_); ++e) {
    if (moved_[e] <= k_continued * options_.tolerance) continue;
    moved_[e] = 0;
    if (usable_[e] != 0) stale.push_back(e);
  }
  parallel_for((stale.size() + k_chunk - 1) / k_chunk, options_.threads, [&](std::size_t chunk) {
    for (std::size_t i = chunk * k_chunk; i < std::min(stale.size(), (chunk + 1) * k_chunk); ++i) {
      const std::size_t e = stale[i];
      const ElementPixels& element = pixels_.elements()[e];
      sums_[e] = residual_sums(pixels_, element, reference_.view(), deformed, motion(e, result));
      rights_[e] = right_of(element, sums_[e]);
    }
  });
}

void CorrelationStage::look_at_all_anew() {
  moved_.assign(mesh_.elements.size(), std::numeric_limits<double>::infinity());
}

/// r − (N ∇f)ᵀ δ − (f, 1) c instead of r. What this leaves out is of second order: of a step δ the part by
/// which the gradients of the two pictures differ, i.e. their noise.
void CorrelationStage::continue_sums(const CorrelationResult& result) {
  for (Index e = 0; e < std::ssize(mesh_.elements); ++e) {
    if (usable_[e] == 0) continue;
    const Constants& k = constants_[e];
    Eigen::Matrix<double, 8, 1> d = Eigen::Matrix<double, 8, 1>::Zero();
    for (int a = 0; a < ImageMesh::nodes_of(mesh_.elements[e]); ++a)
      d.segment<2>(2 * a) = step_.segment<2>(2 * mesh_.elements[e][a]);
    const Eigen::Vector2d change = result.element_valid[e] != 0 && per_element()
                                       ? Eigen::Vector2d(element_step_[e][0], element_step_[e][1])
                                       : brightness_step_;
    // A gain's change of a thousandth is as much as a displacement of a thousandth of a pixel.
    moved_[e] += d.cwiseAbs().maxCoeff() + std::abs(change[0]);
    ResidualSums& s = sums_[e];
    const Eigen::Vector2d before(s.r_reference, s.r);
    const Eigen::Vector2d known = k.brightness.transpose() * d + k.brightness_matrix * change;
    const Eigen::Matrix<double, 8, 1> explained = k.matrix * d + k.brightness * change;
    s.r_squared += -2 * (rights_[e].dot(d) + before.dot(change)) + d.dot(explained) + change.dot(known);
    s.r_squared = std::max(0.0, s.r_squared);
    s.r_reference -= known[0], s.r -= known[1];
    rights_[e] -= explained;
  }
}

Eigen::Vector2d CorrelationStage::assemble_right(const CorrelationResult& result) {
  right_.setZero(2 * mesh_.node_count());
  Eigen::Vector2d brightness = Eigen::Vector2d::Zero();
  for (Index e = 0; e < std::ssize(mesh_.elements); ++e) {
    if (result.element_valid[e] == 0) continue;
    const auto& nodes = mesh_.elements[e];
    Eigen::Matrix<double, 8, 1> b = rights_[e];
    const Eigen::Vector2d s(sums_[e].r_reference, sums_[e].r);
    brightness += s;
    if (per_element()) b -= constants_[e].brightness * (constants_[e].brightness_matrix.inverse() * s);
    for (int a = 0; a < ImageMesh::nodes_of(nodes); ++a)
      right_.segment<2>(2 * nodes[a]) += b.segment<2>(2 * a);
  }
  return brightness;
}

/// At a large motion the gradient of the deformed picture, which M and b should have, is F⁻ᵀ ∇f and not ∇f.
/// Then M and b with ∇f are those of w = F⁻¹ δu.
Eigen::VectorXd CorrelationStage::carried(const Eigen::VectorXd& nodal) const {
  if (!large_) return nodal;
  Eigen::VectorXd result(nodal.size());
  for (Index i = 0; i < nodal.size(); i += 2) result.segment<2>(i) = large_->gradient * nodal.segment<2>(i);
  return result;
}

Eigen::VectorXd CorrelationStage::penalty_slope(const Eigen::VectorXd& displacement) const {
  if (!large_) return penalty_matrix_ * displacement;
  Eigen::VectorXd slope = penalty_matrix_ * (displacement - nodal_displacement(*large_, mesh_));
  for (Index i = 0; i < slope.size(); i += 2)
    slope.segment<2>(i) = large_->gradient.transpose() * slope.segment<2>(i).eval();
  return slope;
}

double CorrelationStage::step(CorrelationResult& result, Eigen::VectorXd& last, double& lengthening) {
  const Eigen::Vector2d brightness = assemble_right(result);
  if (penalty_ > 0) right_ -= penalty_slope(result.displacement);
  step_ = solver_.solve(right_);
  const auto add = [](double change_f, double change_1, double& gain, double& offset) {
    gain += gain * change_f, offset += change_1 + offset * change_f;
  };
  if (options_.brightness == Brightness::global) {
    const Eigen::Vector2d change = brightness_schur_.inverse() * (brightness - coupling_.transpose() * step_);
    step_ -= solved_coupling_ * change;
    brightness_step_ = change;
    add(change[0], change[1], result.gain, result.offset);
  } else if (per_element()) {
    for (Index e = 0; e < std::ssize(mesh_.elements); ++e) {
      if (result.element_valid[e] == 0) continue;
      Eigen::Matrix<double, 8, 1> du = Eigen::Matrix<double, 8, 1>::Zero();
      for (int a = 0; a < ImageMesh::nodes_of(mesh_.elements[e]); ++a)
        du.segment<2>(2 * a) = step_.segment<2>(2 * mesh_.elements[e][a]);
      const Eigen::Vector2d change =
          constants_[e].brightness_matrix.inverse() *
          (Eigen::Vector2d(sums_[e].r_reference, sums_[e].r) - constants_[e].brightness.transpose() * du);
      double gain = element_brightness_[e][0], offset = element_brightness_[e][1];
      add(change[0], change[1], gain, offset);
      element_brightness_[e] = {static_cast<float>(gain), static_cast<float>(offset)};
      element_step_[e] = {change[0], change[1]};
    }
  }
  // The noise of the reference is in M twice, so every step is too short by one share of it: by what is left
  // for the next one to do, (1 − ρ)⁻¹ is estimated (Aitken), and a picture takes three steps instead of
  // four.
  if (last.size() != 0) {
    const double left = last.dot(step_) / last.squaredNorm();
    const double longer = lengthening / (1 - std::clamp(left, -0.5, 0.5));
    lengthening = longer < k_longest_step ? std::max(1.0, longer) : 1;  // a crack leaves more: it is not that
  }
  last = step_;
  step_ *= lengthening;
  result.displacement += carried(step_);
  return step_.cwiseAbs().maxCoeff();
}

/// Residuals of no motion, so that nothing that is not finite is left.
void CorrelationStage::begin_again(const SplineImage& deformed, CorrelationResult& result) {
  result.displacement.setZero();
  result.gain = 1, result.offset = 0, result.last_step = 0;
  start_brightness(result);
  sum_residuals(deformed, result);
}

void CorrelationStage::iterate(const SplineImage& deformed, CorrelationResult& result, int most) {
  factorise(result.element_valid);
  result.converged = false;
  const double far = 2.0 * (reference_.width + reference_.height);
  Eigen::VectorXd last;
  double lengthening = 1;
  for (int k = 0; k < std::min(k_iterations_per_round, most) && !result.converged; ++k) {
    if (options_.interruptible) check_cancellation("the picture is not correlated");
    sum_residuals(deformed, result);
    result.last_step = step(result, last, lengthening);
    ++result.iterations;
    if (!std::isfinite(result.last_step) || result.displacement.cwiseAbs().maxCoeff() > far) {
      begin_again(deformed, result);
      result.message =
          "the iteration diverged: the pictures do not show the same surface, or moved too far between them";
      return;
    }
    continue_sums(result);
    result.converged = result.last_step < options_.tolerance;
  }
  if (!result.converged || result.last_step >= k_small_step) sum_residuals(deformed, result);
  result.message.clear();
  if (!result.converged)
    result.message = fmt::format(
        "after {} iterations{} displacements still change by {:.2g} px, more than the tolerance of {:.2g} px",
        result.iterations,
        result.iterations > options_.max_iterations
            ? fmt::format(" ({} and those since elements were rejected)", options_.max_iterations)
            : "",
        result.last_step, options_.tolerance);
}

}  // namespace knothe::imaging
