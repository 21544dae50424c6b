#pragma once
/// @file The one-variable functions and the rectifiers for eight points at once; their meaning is that of
/// OneVariableBasis and rectifier.hpp, against which they are tested.
#include <array>
#include <cmath>

#include "knothe/base/index.hpp"
#include "knothe/posterior/map/lanes.hpp"
#include "knothe/posterior/map/one_variable_basis.hpp"
#include "knothe/posterior/map/rectifier.hpp"

namespace knothe::posterior {

using LaneValues = std::array<Lanes, k_max_order + 1>;

/// √k and 1/√k.
struct RootTable {
  std::array<double, k_max_order + 1> root{}, inverse{};
  RootTable() {
    for (Index k = 1; k < std::ssize(root); ++k) root[k] = std::sqrt(k), inverse[k] = 1 / root[k];
  }
};
inline const RootTable k_lane_roots;

/// ĥ_0 … ĥ_n into out[0] … out[n].
inline void lane_polynomials(Lanes x, int n, Lanes* out) {
  out[0] = lanes(1);
  if (n >= 1) out[1] = x;
  for (int k = 2; k <= n; ++k) {
    const std::size_t i = k;
    out[k] = (x * out[k - 1] - k_lane_roots.root[i - 1] * out[k - 2]) * k_lane_roots.inverse[i];
  }
}

/// Functions 0 … n of Φ_c.
inline void lane_constant_functions(const TailRadii& r, Lanes x, int n, Lanes* out) {
  const Lanes inside = clamp(x, r.tangent), beyond = x - inside;
  lane_polynomials(inside, n, out);
  for (int j = n; j >= 1; --j) out[j] += beyond * (k_lane_roots.root[j] * out[j - 1]);
}

/// τ of Φ_e.
inline Lanes lane_bent(const TailRadii& r, Lanes x) {
  const Lanes over = smaller(larger(absolute(x) - r.level, Lanes{}), lanes(2 * r.bend));
  const Lanes beyond = over - over * over / (4 * r.bend);
  return clamp(x, r.level) + (x < 0 ? -beyond : beyond);
}

/// Functions 0 … n of Φ_e.
inline void lane_monotone_functions(const TailRadii& r, Lanes x, int n, Lanes* out) {
  lane_polynomials(lane_bent(r, x), n, out);
}

inline Lanes lane_rectify(Rectifier rectifier, Lanes h) {
  if (rectifier == Rectifier::square) return h * h;
  if (rectifier == Rectifier::softplus)
    return k_softplus_scale * (larger(h, Lanes{}) + logarithm_of_one_plus(exponential(-absolute(h))));
  const Lanes first = exponential(smaller(h, lanes(k_exponential_limit))), over = h - k_exponential_limit;
  return first * (1 + larger(over, Lanes{}));
}

inline Lanes lane_log_rectify(Rectifier rectifier, Lanes h) {
  if (rectifier == Rectifier::square) return 2 * logarithm(absolute(h));
  if (rectifier == Rectifier::softplus) {
    const auto far = h < -40;
    return far ? h + k_log_softplus_scale : logarithm(lane_rectify(rectifier, far ? lanes(-40) : h));
  }
  const Lanes over = larger(h - k_exponential_limit, Lanes{});
  return smaller(h, lanes(k_exponential_limit)) + logarithm_of_one_plus(over);
}

}  // namespace knothe::posterior
