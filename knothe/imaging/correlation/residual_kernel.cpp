#include "knothe/imaging/correlation/residual_kernel.hpp"

#include <algorithm>
#include <cmath>
#include <experimental/simd>
#include <limits>

namespace knothe::imaging {

namespace {

namespace stdx = std::experimental;
using Lanes = stdx::native_simd<float>;
using Mask = Lanes::mask_type;
constexpr int k_lanes = static_cast<int>(Lanes::size());
static_assert(k_lanes <= 16, "SplineImage pads for 16 lanes");

Lanes load(const float* from) {
  return Lanes(from, stdx::element_aligned);
}

/// Weights of the cubic B-spline at fraction t.
[[gnu::always_inline]] inline void weights(const Lanes& t, Lanes w[4]) {
  const Lanes s = 1.0F - t, t2 = t * t, s2 = s * s;
  w[0] = s2 * s * (1.0F / 6);
  w[3] = t2 * t * (1.0F / 6);
  w[1] = 2.0F / 3 - t2 + 3.0F * w[3];
  w[2] = 2.0F / 3 - s2 + 3.0F * w[0];
}

/// One row of an element: displacement u_0 + u_1 X along it.
struct RowMotion {
  float u0, u1, v0, v1;
};

/// g at pixels (x … x + lanes − 1, y) displaced by (u, v); `seen` tells where the picture reaches.
Lanes deformed(const SplineImage& g, int x, int y, const Lanes& u, const Lanes& v, int count,
               const Lanes& lane, Mask& seen) {
  const Lanes floor_u = stdx::floor(u), floor_v = stdx::floor(v);
  const Lanes px = lane + u + static_cast<float>(x), py = v + static_cast<float>(y);
  seen = lane < static_cast<float>(count) && px >= 0.0F && py >= 0.0F &&
         px <= static_cast<float>(g.width() - 1) && py <= static_cast<float>(g.height() - 1);
  Lanes value = 0.0F;
  if (stdx::none_of(seen)) return value;
  Lanes wx[4], wy[4];
  weights(u - floor_u, wx);
  weights(v - floor_v, wy);
  Mask left = seen;
  // Displacements are smooth: nearly always one pass, two where the integer part changes.
  while (stdx::any_of(left)) {
    const int first = stdx::find_first_set(left);
    const float du = floor_u[first], dv = floor_v[first];
    const Mask now = left && floor_u == du && floor_v == dv;
    left = left && !now;
    const float* row = g.coefficient(x + static_cast<int>(du) - 1, y + static_cast<int>(dv) - 1);
    Lanes sum = 0.0F;
    for (int b = 0; b < 4; ++b, row += g.stride())
      sum +=
          wy[b] * (wx[0] * load(row) + wx[1] * load(row + 1) + wx[2] * load(row + 2) + wx[3] * load(row + 3));
    stdx::where(now, value) = sum;
  }
  return value;
}

/// The same where the integer part of the displacement is one for all of a row and everything is seen: no
/// search for it from vector to vector, so that one need not wait for the other.
[[gnu::always_inline]] inline Lanes deformed_at(const float* first, std::size_t stride, const Lanes& t_u,
                                                const Lanes& t_v) {
  Lanes wx[4], wy[4];
  weights(t_u, wx);
  weights(t_v, wy);
  Lanes sum = 0.0F;
  for (int b = 0; b < 4; ++b, first += stride)
    sum += wy[b] * (wx[0] * load(first) + wx[1] * load(first + 1) + wx[2] * load(first + 2) +
                    wx[3] * load(first + 3));
  return sum;
}

/// Integer part of the displacement of a row of pixels; `common` if it is one for all of them, and the
/// picture reaches there.
struct RowShift {
  bool common = false;
  float u = 0, v = 0;
};
/// From the displacements between which those of the row lie.
[[gnu::always_inline]] inline RowShift row_shift(const SplineImage& g, const ElementPixels::Row& row,
                                                 float u_least, float u_most, float v_least, float v_most) {
  const RowShift s{true, std::floor(u_least), std::floor(v_least)};
  const auto last = static_cast<float>(row.x + row.count - 1), x = static_cast<float>(row.x),
             y = static_cast<float>(row.y);
  const bool seen = x + u_least >= 0 && y + v_least >= 0 &&
                    last + u_most <= static_cast<float>(g.width() - 1) &&
                    y + v_most <= static_cast<float>(g.height() - 1);
  return seen && s.u == std::floor(u_most) && s.v == std::floor(v_most) ? s : RowShift{};
}

/// u = u₀ + u₁X + u₂Y + u₃XY along a row, where Y is one number.
RowMotion row_motion(const ElementMotion& m, double y) {
  return {static_cast<float>(m.u[0] + m.u[2] * y), static_cast<float>(m.u[1] + m.u[3] * y),
          static_cast<float>(m.v[0] + m.v[2] * y), static_cast<float>(m.v[1] + m.v[3] * y)};
}

/// Where the next pixels are in their element (X, Y), and how they are displaced.
struct Pixels {
  Lanes x, y, u, v;
};
Pixels natural_pixels(const float* xi, const float* eta, const ElementMotion& m) {
  Pixels p{load(xi), load(eta), 0.0F, 0.0F};
  const auto at = [](double value) { return static_cast<float>(value); };
  p.u = at(m.u[0]) + at(m.u[1]) * p.x + (at(m.u[2]) + at(m.u[3]) * p.x) * p.y;
  p.v = at(m.v[0]) + at(m.v[1]) * p.x + (at(m.v[2]) + at(m.v[3]) * p.x) * p.y;
  return p;
}

/// Between which a bilinear motion lies for natural coordinates from −1 to 1: its values at the corners (a
/// triangle's natural coordinates lie in there too).
struct MotionRange {
  float u_least = 0, u_most = 0, v_least = 0, v_most = 0;
};
MotionRange motion_range(const ElementMotion& m) {
  const auto ends = [](const std::array<double, 4>& c) {
    const double across = std::abs(c[1] + c[3]), other = std::abs(c[1] - c[3]);
    return std::array<float, 2>{static_cast<float>(std::min(c[0] + c[2] - across, c[0] - c[2] - other)),
                                static_cast<float>(std::max(c[0] + c[2] + across, c[0] - c[2] + other))};
  };
  const auto u = ends(m.u), v = ends(m.v);
  return {u[0], u[1], v[0], v[1]};
}

/// 0, 1, 2 …
Lanes lane_numbers() {
  return Lanes([](auto i) { return static_cast<float>(i); });
}

/// `natural`: X and Y of each pixel from the table, instead of steps along its row.
template <bool natural>
ResidualSums sums_of(const PixelTable& table, const ElementPixels& element, const ReferenceRows& f,
                     const SplineImage& g, const ElementMotion& motion) {
  Lanes x0 = 0.0F, x1 = 0.0F, x2 = 0.0F, x3 = 0.0F, y0 = 0.0F, y1 = 0.0F, y2 = 0.0F, y3 = 0.0F;
  Lanes sum = 0.0F, squares = 0.0F, with_reference = 0.0F, used = 0.0F;
  const Lanes lane = lane_numbers();
  [[maybe_unused]] const MotionRange range = natural ? motion_range(motion) : MotionRange{};
  for (const auto& row : table.rows(element)) {
    const double y = row.y - element.y_origin;
    const RowMotion m = row_motion(motion, y);
    const auto yy = static_cast<float>(y);
    const std::size_t at = static_cast<std::size_t>(row.y) * f.stride + static_cast<std::size_t>(row.x);
    const RowShift shift = [&] {
      if constexpr (natural)
        return row_shift(g, row, range.u_least, range.u_most, range.v_least, range.v_most);
      const auto first = static_cast<float>(row.x - element.x_origin),
                 last = static_cast<float>(row.x + row.count - 1 - element.x_origin);
      const float ua = m.u0 + m.u1 * first, ub = m.u0 + m.u1 * last, va = m.v0 + m.v1 * first,
                  vb = m.v0 + m.v1 * last;
      return row_shift(g, row, std::min(ua, ub), std::max(ua, ub), std::min(va, vb), std::max(va, vb));
    }();
    const float* coefficients = shift.common ? g.coefficient(row.x + static_cast<int>(shift.u) - 1,
                                                             row.y + static_cast<int>(shift.v) - 1)
                                             : nullptr;
    for (int k = 0; k < row.count; k += k_lanes) {
      Pixels p;
      if constexpr (natural) {
        p = natural_pixels(table.xi(row) + k, table.eta(row) + k, motion);
      } else {
        p.x = lane + static_cast<float>(row.x + k - element.x_origin);
        p.u = m.u0 + m.u1 * p.x, p.v = m.v0 + m.v1 * p.x;
      }
      const Lanes& x = p.x;
      Mask seen = lane < static_cast<float>(row.count - k);
      const Lanes value = shift.common
                              ? deformed_at(coefficients + k, g.stride(), p.u - shift.u, p.v - shift.v)
                              : deformed(g, row.x + k, row.y, p.u, p.v, row.count - k, lane, seen);
      const std::size_t i = at + static_cast<std::size_t>(k);
      const Lanes reference = load(f.value + i);
      Lanes use = load(f.use + i);
      stdx::where(!seen, use) = 0.0F;
      const Lanes r = use * (reference - motion.gain * value - motion.offset);
      const Lanes gx = r * load(f.dx + i), gy = r * load(f.dy + i), gxx = gx * x, gyx = gy * x;
      x0 += gx, x1 += gxx, y0 += gy, y1 += gyx;
      if constexpr (natural)
        x2 += gx * p.y, x3 += gxx * p.y, y2 += gy * p.y, y3 += gyx * p.y;
      else
        x2 += gx * yy, x3 += gxx * yy, y2 += gy * yy, y3 += gyx * yy;
      sum += r, squares += r * r, with_reference += r * reference, used += use;
    }
  }
  const auto total = [](const Lanes& lanes) {
    double all = 0;
    for (int i = 0; i < k_lanes; ++i) all += static_cast<double>(lanes[static_cast<std::size_t>(i)]);
    return all;
  };
  return {{total(x0), total(x1), total(x2), total(x3)},
          {total(y0), total(y1), total(y2), total(y3)},
          total(sum),
          total(squares),
          total(with_reference),
          total(used)};
}

}  // namespace

ResidualSums residual_sums(const PixelTable& table, const ElementPixels& element, const ReferenceRows& f,
                           const SplineImage& g, const ElementMotion& motion) {
  return element.natural ? sums_of<true>(table, element, f, g, motion)
                         : sums_of<false>(table, element, f, g, motion);
}

void residual_pixels(const PixelTable& table, const ElementPixels& element, const ReferenceRows& f,
                     const SplineImage& g, const ElementMotion& motion, float* out, std::size_t stride) {
  const Lanes lane = lane_numbers();
  for (const auto& row : table.rows(element)) {
    const RowMotion m = row_motion(motion, row.y - element.y_origin);
    for (int k = 0; k < row.count; k += k_lanes) {
      Lanes u, v;
      if (element.natural) {
        const Pixels p = natural_pixels(table.xi(row) + k, table.eta(row) + k, motion);
        u = p.u, v = p.v;
      } else {
        const Lanes x = lane + static_cast<float>(row.x + k - element.x_origin);
        u = m.u0 + m.u1 * x, v = m.v0 + m.v1 * x;
      }
      Mask seen;
      const Lanes value = deformed(g, row.x + k, row.y, u, v, row.count - k, lane, seen);
      const std::size_t i = static_cast<std::size_t>(row.y) * f.stride + static_cast<std::size_t>(row.x + k);
      for (int l = 0; l < std::min(k_lanes, row.count - k); ++l) {
        const auto s = static_cast<std::size_t>(l);
        out[static_cast<std::size_t>(row.y) * stride + static_cast<std::size_t>(row.x + k + l)] =
            seen[s] && f.use[i + s] > 0 ? f.value[i + s] - motion.gain * value[s] - motion.offset
                                        : std::numeric_limits<float>::quiet_NaN();
      }
    }
  }
}

}  // namespace knothe::imaging
