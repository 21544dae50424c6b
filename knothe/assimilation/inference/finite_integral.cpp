#include "knothe/assimilation/inference/finite_integral.hpp"

#include <fmt/format.h>

#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/posterior/checked_density.hpp"

namespace knothe::assimilation {
namespace {

constexpr int k_decades = 6;
constexpr double k_falls = 0.1;

/// Whether the mass around the ray from `mode` along column k of L falls from one power of ten of the
/// distance to the next: π̄ there times the widths across the ray, which a cusp's or a funnel's narrow.
bool mass_falls(posterior::CheckedDensity& target, const posterior::Mode& mode, Eigen::Index k, double sign) {
  const Eigen::Index d = mode.point.size();
  Eigen::MatrixXd across(d, d - 1);
  across << mode.lower.leftCols(k), mode.lower.rightCols(d - 1 - k);
  Eigen::VectorXd width = Eigen::VectorXd::Ones(d - 1);
  posterior::LogDensityBatch batch;
  double before = 0;
  for (int decade = 1; decade <= k_decades; ++decade) {
    const double r = std::pow(10.0, decade);
    const Eigen::VectorXd point = mode.point + sign * r * mode.lower.col(k);
    target.evaluate(point.transpose(), 0, batch);
    const double value = batch.value[0];
    if (!std::isfinite(value)) return true;
    if (d > 1) posterior::fit_spreads(target, point, value, across, width);
    const double mass = value + std::log(r) + width.array().log().sum();
    if (decade > 1 && mass < before - k_falls) return true;
    before = mass;
  }
  return false;
}

}  // namespace

void require_finite_integral(PosteriorDensity& posterior, const posterior::Mode& mode,
                             const std::vector<std::string>& names) {
  const Eigen::Index d = posterior.dimension();
  posterior::CheckedDensity target(posterior);
  const posterior::CheckedDensity::Leniency lenient(target);
  // Rays that have not fallen yet: column k of L, upwards or downwards.
  struct Ray {
    Eigen::VectorXd direction;
    double mass;  ///< log of π̄ r^d where it was looked at last
    Eigen::Index k;
    double sign;
  };
  std::vector<Ray> rays;
  for (Eigen::Index k = 0; k < d; ++k)
    for (const double sign : {1.0, -1.0}) rays.push_back({sign * mode.lower.col(k), 0, k, sign});
  posterior::LogDensityBatch batch;
  for (int decade = 1; decade <= k_decades && !rays.empty(); ++decade) {
    const double r = std::pow(10.0, decade);
    Eigen::MatrixXd points(std::ssize(rays), d);
    for (std::size_t i = 0; i < rays.size(); ++i)
      points.row(i) = (mode.point + r * rays[i].direction).transpose();
    target.evaluate(points, 0, batch);
    std::vector<Ray> left;
    for (std::size_t i = 0; i < rays.size(); ++i) {
      const double mass = batch.value[i] + d * std::log(r);
      if (!std::isfinite(mass) || (decade > 1 && mass < rays[i].mass - k_falls)) continue;
      left.push_back({rays[i].direction, mass, rays[i].k, rays[i].sign});
    }
    rays = std::move(left);
  }
  std::erase_if(rays, [&](const Ray& ray) { return mass_falls(target, mode, ray.k, ray.sign); });
  if (rays.empty()) return;
  // In words: the parameters that change along the ray, and which way.
  const Eigen::MatrixXd ends = posterior.parameters(
      (Eigen::MatrixXd(2, d) << mode.point.transpose(), (mode.point + 10 * rays[0].direction).transpose())
          .finished());
  const double most = rays[0].direction.cwiseAbs().maxCoeff();
  std::string way;
  for (Eigen::Index k = 0; k < d; ++k) {
    if (std::abs(rays[0].direction[k]) < 0.1 * most) continue;
    const std::size_t i = k;
    way += fmt::format("{}{} {}", way.empty() ? "" : ", ", ends(1, k) > ends(0, k) ? "growing" : "falling",
                       i < names.size() ? names[i] : fmt::format("p[{}]", k));
  }
  throw NumericalError(
      fmt::format("not trusted: the density has no finite integral: towards {} it does not fall, or more "
                  "slowly than 1/distance^{} (from "
                  "10 to a million of its own widths off its mode), so that no posterior belongs to it. Give "
                  "all parameters a proper prior "
                  "in the density, or bounds (prior = \"uniform\" under [parameters])",
                  way, d));
}

}  // namespace knothe::assimilation
