// Gauss and Newton with a constant matrix: the hot part of a correlation.
#include <fmt/format.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "knothe/base/threads.hpp"
#include "knothe/imaging/correlation/correlation_stage.hpp"

namespace knothe::imaging {

namespace {

constexpr double k_longest_step = 1.25;  // times that of Gauss and Newton
constexpr double k_small_step = 0.01;    // px, after which the residual need not be looked at again

}  // namespace

void CorrelationStage::sum_residuals(const SplineImage& deformed, const CorrelationResult& result) {
  constexpr std::size_t k_chunk = 32;  // elements per task
  const std::size_t count = mesh_.elements.size();
  parallel_for((count + k_chunk - 1) / k_chunk, static_cast<std::size_t>(options_.threads),
               [&](std::size_t chunk) {
                 for (std::size_t e = chunk * k_chunk; e < std::min(count, (chunk + 1) * k_chunk); ++e)
                   sums_[e] = usable_[e] != 0 ? residual_sums(pixels_, pixels_.elements()[e],
                                                              reference_.rows(), deformed, motion(e, result))
                                              : ResidualSums{};
               });
  sums_current_ = true;
}

/// Σ N ∇f r of one element.
Eigen::Matrix<double, 8, 1> CorrelationStage::element_right(std::size_t e) const {
  Eigen::Matrix<double, 8, 1> b;
  const auto& c = pixels_.elements()[e].coefficients;
  for (int a = 0; a < 4; ++a) {
    b[2 * a] = b[2 * a + 1] = 0;
    for (std::size_t m = 0; m < 4; ++m) {
      b[2 * a] += c[static_cast<std::size_t>(a)][m] * sums_[e].x[m];
      b[2 * a + 1] += c[static_cast<std::size_t>(a)][m] * sums_[e].y[m];
    }
  }
  return b;
}

/// r − (N ∇f)ᵀ δ − (f, 1) c instead of r. The last step is below the tolerance, a thousandth of a pixel: what
/// this leaves out is of its second order, a millionth of the residual.
void CorrelationStage::continue_sums(const CorrelationResult& result) {
  for (std::size_t e = 0; e < mesh_.elements.size(); ++e) {
    if (usable_[e] == 0) continue;
    const Constants& k = constants_[e];
    Eigen::Matrix<double, 8, 1> d = Eigen::Matrix<double, 8, 1>::Zero();
    for (int a = 0; a < ImageMesh::nodes_of(mesh_.elements[e]); ++a)
      d.segment<2>(2 * a) = step_.segment<2>(2 * mesh_.elements[e][static_cast<std::size_t>(a)]);
    const Eigen::Vector2d change = result.element_valid[e] != 0 && per_element()
                                       ? Eigen::Vector2d(element_step_[e][0], element_step_[e][1])
                                       : brightness_step_;
    ResidualSums& s = sums_[e];
    const Eigen::Vector2d before(s.r_reference, s.r);
    const Eigen::Vector2d known = k.brightness.transpose() * d + k.brightness_matrix * change;
    s.r_squared += -2 * (element_right(e).dot(d) + before.dot(change)) + d.dot(k.matrix * d) +
                   2 * d.dot(k.brightness * change) + change.dot(k.brightness_matrix * change);
    s.r_squared = std::max(0.0, s.r_squared);
    s.r_reference -= known[0], s.r -= known[1];
  }
  sums_current_ = false;
}

Eigen::Vector2d CorrelationStage::assemble_right(const CorrelationResult& result) {
  right_.setZero(2 * mesh_.node_count());
  Eigen::Vector2d brightness = Eigen::Vector2d::Zero();
  for (std::size_t e = 0; e < mesh_.elements.size(); ++e) {
    if (result.element_valid[e] == 0) continue;
    const auto& nodes = mesh_.elements[e];
    Eigen::Matrix<double, 8, 1> b = element_right(e);
    const Eigen::Vector2d s(sums_[e].r_reference, sums_[e].r);
    brightness += s;
    if (per_element()) b -= constants_[e].brightness * (constants_[e].brightness_matrix.inverse() * s);
    for (int a = 0; a < ImageMesh::nodes_of(nodes); ++a)
      right_.segment<2>(2 * nodes[static_cast<std::size_t>(a)]) += b.segment<2>(2 * a);
  }
  return brightness;
}

double CorrelationStage::step(CorrelationResult& result, Eigen::VectorXd& last, double& lengthening) {
  const Eigen::Vector2d brightness = assemble_right(result);
  if (penalty_ > 0) right_ -= penalty_matrix_ * result.displacement;
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
    for (std::size_t e = 0; e < mesh_.elements.size(); ++e) {
      if (result.element_valid[e] == 0) continue;
      Eigen::Matrix<double, 8, 1> du = Eigen::Matrix<double, 8, 1>::Zero();
      for (int a = 0; a < ImageMesh::nodes_of(mesh_.elements[e]); ++a)
        du.segment<2>(2 * a) = step_.segment<2>(2 * mesh_.elements[e][static_cast<std::size_t>(a)]);
      const Eigen::Vector2d change =
          constants_[e].brightness_matrix.inverse() *
          (Eigen::Vector2d(sums_[e].r_reference, sums_[e].r) - constants_[e].brightness.transpose() * du);
      double gain = static_cast<double>(element_brightness_[e][0]),
             offset = static_cast<double>(element_brightness_[e][1]);
      add(change[0], change[1], gain, offset);
      element_brightness_[e] = {static_cast<float>(gain), static_cast<float>(offset)};
      element_step_[e] = {change[0], change[1]};
    }
  }
  // The noise of the reference is in M twice, so every step is too short by one share of it: by what is left
  // for the next one to do, (1 − ρ)⁻¹ is learnt (Aitken), and a picture takes three steps instead of four.
  if (last.size() != 0) {
    const double left = last.dot(step_) / last.squaredNorm();
    const double longer = lengthening / (1 - std::clamp(left, -0.5, 0.5));
    lengthening = longer < k_longest_step ? std::max(1.0, longer) : 1;  // a crack leaves more: it is not that
  }
  last = step_;
  step_ *= lengthening;
  result.displacement += step_;
  sums_current_ = false;
  return step_.cwiseAbs().maxCoeff();
}

void CorrelationStage::iterate(const SplineImage& deformed, CorrelationResult& result) {
  factorise(result.element_valid);
  result.converged = false;
  const double far = 2.0 * (reference_.width + reference_.height);
  Eigen::VectorXd last;
  double lengthening = 1;
  for (int k = 0; k < std::min(k_iterations_per_round, options_.max_iterations) && !result.converged; ++k) {
    if (!sums_current_) sum_residuals(deformed, result);
    result.last_step = step(result, last, lengthening);
    ++result.iterations;
    if (!std::isfinite(result.last_step) || result.displacement.cwiseAbs().maxCoeff() > far) {
      result.displacement.setZero();
      result.message =
          "the iteration diverged: the pictures do not show the same surface, or moved too far between them";
      return;
    }
    result.converged = result.last_step < options_.tolerance;
  }
  if (result.converged && result.last_step < k_small_step)
    continue_sums(result);
  else
    sum_residuals(deformed, result);
  result.message.clear();
  if (!result.converged)
    result.message = fmt::format(
        "after {} iterations displacements still change by {:.2g} px, more than the tolerance of {:.2g} px",
        result.iterations, result.last_step, options_.tolerance);
}

}  // namespace knothe::imaging
