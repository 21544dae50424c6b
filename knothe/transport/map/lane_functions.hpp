#pragma once
/// @file The one-variable functions and the rectifiers for eight points at once; their meaning is that of
/// OneVariableBasis and rectifier.hpp, against which they are tested.
#include <array>
#include <cmath>

#include "knothe/transport/map/lanes.hpp"
#include "knothe/transport/map/one_variable_basis.hpp"
#include "knothe/transport/map/rectifier.hpp"

namespace knothe::transport {

using LaneValues = std::array<Lanes, k_max_order + 1>;

/// √k and 1/√k.
struct RootTable {
  std::array<double, k_max_order + 1> root{}, inverse{};
  RootTable() {
    for (std::size_t k = 1; k < root.size(); ++k)
      root[k] = std::sqrt(static_cast<double>(k)), inverse[k] = 1 / root[k];
  }
};
inline const RootTable k_lane_roots;

/// ĥ_0 … ĥ_n into out[0] … out[n].
inline void lane_polynomials(Lanes x, int n, Lanes* out) {
  out[0] = lanes(1);
  if (n >= 1) out[1] = x;
  for (int k = 2; k <= n; ++k) {
    const auto i = static_cast<std::size_t>(k);
    out[k] = (x * out[k - 1] - k_lane_roots.root[i - 1] * out[k - 2]) * k_lane_roots.inverse[i];
  }
}

/// The functions as they are where |x| is not large: Hermite polynomials, or 1, x and Hermite functions.
inline void lane_inner_functions(BasisFamily family, Lanes x, int n, Lanes* out) {
  if (family == BasisFamily::hermite) {
    lane_polynomials(x, n, out);
    return;
  }
  if (n >= 2) {
    const Lanes inside = clamp(x, k_hermite_functions_end);
    lane_polynomials(inside, n - 2, out + 2);
    const Lanes decay = exponential(-0.25 * inside * inside);
    for (int j = 2; j <= n; ++j) out[j] *= decay;
  }
  out[0] = lanes(1);
  if (n >= 1) out[1] = x;
}

inline void lane_tangent_polynomials(double radius, Lanes x, int n, Lanes* out) {
  const Lanes inside = clamp(x, radius), beyond = x - inside;
  lane_polynomials(inside, n, out);
  for (int j = n; j >= 1; --j)
    out[j] += beyond * (k_lane_roots.root[static_cast<std::size_t>(j)] * out[j - 1]);
}

/// Functions 0 … n of Φ_c.
inline void lane_constant_functions(const Parametrisation& p, Lanes x, int n, Lanes* out) {
  if (p.basis == BasisFamily::hermite_functions)
    lane_inner_functions(p.basis, x, n, out);
  else if (p.tails == Tails::polynomial)
    lane_polynomials(clamp(x, k_polynomial_limit), n, out);
  else
    lane_tangent_polynomials(p.radii.tangent, x, n, out);
}

/// τ of Φ_e.
inline Lanes lane_bent(const TailRadii& r, Lanes x) {
  const Lanes over = smaller(larger(absolute(x) - r.level, Lanes{}), lanes(2 * r.bend));
  const Lanes beyond = over - over * over / (4 * r.bend);
  return clamp(x, r.level) + (x < 0 ? -beyond : beyond);
}

/// Functions 0 … n of Φ_e.
inline void lane_monotone_functions(const Parametrisation& p, Lanes x, int n, Lanes* out) {
  if (p.tails == Tails::bent)
    lane_inner_functions(p.basis, lane_bent(p.radii, x), n, out);
  else
    lane_constant_functions(p, x, n, out);
}

/// r and r'.
struct RectifiedLanes {
  Lanes value, first;
};

inline RectifiedLanes lane_rectify(Rectifier rectifier, Lanes h) {
  if (rectifier == Rectifier::square) return {h * h, 2 * h};
  if (rectifier == Rectifier::softplus) {
    const Lanes decay = exponential(-absolute(h)), more = 1 / (1 + decay);
    return {k_softplus_scale * (larger(h, Lanes{}) + logarithm_of_one_plus(decay)),
            k_softplus_scale * (h < 0 ? decay * more : more)};
  }
  const Lanes first = exponential(smaller(h, lanes(k_exponential_limit))), over = h - k_exponential_limit;
  return {first * (1 + larger(over, Lanes{})), first};
}

/// log r and (log r)'.
struct LogRectifiedLanes {
  Lanes value, slope;
};

inline LogRectifiedLanes lane_log_rectify(Rectifier rectifier, Lanes h) {
  if (rectifier == Rectifier::square)
    return {2 * logarithm(absolute(h)), h == 0 ? Lanes{} : 2 / (h == 0 ? lanes(1) : h)};
  if (rectifier == Rectifier::softplus) {
    const auto far = h < -40;
    const RectifiedLanes r = lane_rectify(rectifier, far ? lanes(-40) : h);
    return {far ? h + k_log_softplus_scale : logarithm(r.value), far ? lanes(1) : r.first / r.value};
  }
  const Lanes over = larger(h - k_exponential_limit, Lanes{});
  return {smaller(h, lanes(k_exponential_limit)) + logarithm_of_one_plus(over), 1 / (1 + over)};
}

}  // namespace knothe::transport
