#include "knothe/imaging/crack/crack_opening.hpp"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "knothe/base/index.hpp"

namespace knothe::imaging {

namespace {

constexpr int k_iterations = 12;
constexpr double k_tolerance = 2e-3;      // px
constexpr double k_min_pixels = 0.5;      // of the window
constexpr double k_largest_residual = 3;  // of the picture's
constexpr double k_clip = 4;              // of the picture's residual: torn grains do not pull
// How much the motion may change over the window beyond what the slope of the nodes says: px, and of the
// jump.
constexpr double k_slope_freedom = 0.02, k_slope_freedom_of_jump = 0.05;

struct Edge {
  std::array<double, 2> motion{};
  Eigen::Matrix2d covariance;
};

struct WindowPixel {
  int t, s;
  double along, dt, ds;  ///< (t − path)/reach, gradient of the reference
};

/// Motion of one side at the path, by Gauss–Newton on a_0 + a_1 ξ, b_0 + b_1 ξ with the slope along the crack
/// from the nodes.
std::optional<Edge> edge_of(const CrackScene& scene, const RoughPath& path, double s_middle, int sign,
                            double gap, double reach, double margin, double variance) {
  const double t_middle = path.at(s_middle);
  const auto start = scene.side(t_middle, s_middle, sign, margin),
             other = scene.side(t_middle, s_middle, -sign, margin);
  if (!start || !other) return std::nullopt;
  const double freedom = k_slope_freedom + k_slope_freedom_of_jump * std::hypot(start->a[0] - other->a[0],
                                                                                start->b[0] - other->b[0]);
  std::vector<WindowPixel> pixels;
  Eigen::Matrix4d matrix = Eigen::Matrix4d::Zero();
  double wanted = 0;
  for (int s = std::ceil(s_middle - 0.5 * path.step); s < s_middle + 0.5 * path.step; ++s) {
    const double edge = path.at(s);
    const double near = edge + sign * gap, far = edge + sign * (gap + reach);
    for (int t = std::ceil(std::min(near, far)); t <= std::max(near, far); ++t) {
      wanted += 1;
      if (!scene.inside(t, s)) continue;
      const std::size_t i = scene.index(t, s);
      if (!scene.reference.counts(i)) continue;
      const auto gradient = scene.view.swap(scene.reference.dx[i], scene.reference.dy[i]);
      pixels.push_back({t, s, (t - edge) / reach, gradient[0], gradient[1]});
      const auto& p = pixels.back();
      const Eigen::Vector4d row(p.dt, p.dt * p.along, p.ds, p.ds * p.along);
      matrix += row * row.transpose();
    }
  }
  if (pixels.size() < std::max(20.0, k_min_pixels * wanted)) return std::nullopt;
  const double prior = variance / (freedom * freedom);
  matrix(1, 1) += prior, matrix(3, 3) += prior;
  const Eigen::LLT<Eigen::Matrix4d> factor(matrix);
  if (factor.info() != Eigen::Success) return std::nullopt;
  Eigen::Vector4d c(start->a[0], start->a[1] * reach, start->b[0], start->b[1] * reach);
  const Eigen::Vector4d begun = c;
  const double limit = k_clip * std::max(1e-3, scene.result->residual_rms);
  double squares = 0, count = 0, last = 1;
  for (int iteration = 0; iteration < k_iterations && last > k_tolerance; ++iteration) {
    Eigen::Vector4d right = Eigen::Vector4d::Zero();
    squares = count = 0;
    for (const auto& p : pixels) {
      const double beside = p.s - s_middle;
      const auto residual = scene.residual(
          p.t, p.s,
          {c[0] + c[1] * p.along + start->a[2] * beside, c[2] + c[3] * p.along + start->b[2] * beside});
      if (!residual) continue;
      squares += *residual * *residual, count += 1;
      const double r = std::clamp(*residual, -limit, limit);
      right += r * Eigen::Vector4d(p.dt, p.dt * p.along, p.ds, p.ds * p.along);
    }
    if (count < k_min_pixels * wanted) return std::nullopt;
    right[1] += prior * (begun[1] - c[1]), right[3] += prior * (begun[3] - c[3]);
    const Eigen::Vector4d step = factor.solve(right);
    c += step;
    last = step.cwiseAbs().maxCoeff();
  }
  const double rms = std::sqrt(squares / count);
  if (last > 10 * k_tolerance || rms > k_largest_residual * scene.result->residual_rms ||
      std::hypot(c[0] - begun[0], c[2] - begun[2]) > 0.5 * scene.element)
    return std::nullopt;
  Edge edge;
  edge.motion = {c[0], c[2]};
  const Eigen::Matrix4d inverse = factor.solve(Eigen::Matrix4d::Identity());
  // Where the residual is larger than elsewhere in the picture, the noise is not all that is wrong.
  const double excess = std::max(1.0, std::pow(rms / std::max(1e-9, scene.result->residual_rms), 2));
  edge.covariance << inverse(0, 0), inverse(0, 2), inverse(2, 0), inverse(2, 2);
  edge.covariance *= variance * excess;
  return edge;
}

}  // namespace

std::vector<SideJump> side_jumps(const CrackScene& scene, const RoughPath& path, double gap, double reach,
                                 double margin, double variance) {
  std::vector<SideJump> jumps;
  for (Index b = 0; b < std::ssize(path.t); ++b) {
    SideJump jump;
    jump.s = path.first + b * path.step, jump.t = path.t[b];
    const auto far = edge_of(scene, path, jump.s, 1, gap, reach, margin, variance),
               near = edge_of(scene, path, jump.s, -1, gap, reach, margin, variance);
    if (far && near) {
      jump.measured = true;
      jump.jump = {far->motion[0] - near->motion[0], far->motion[1] - near->motion[1]};
      const Eigen::Matrix2d covariance = far->covariance + near->covariance;
      jump.covariance = {covariance(0, 0), covariance(0, 1), covariance(1, 1)};
    }
    jumps.push_back(jump);
  }
  return jumps;
}

}  // namespace knothe::imaging
