#include "knothe/imaging/correlation/residual_kernel.hpp"
#include "knothe/imaging/correlation/element_residuals.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <experimental/simd>
#include <limits>

namespace knothe::imaging {

namespace {

namespace stdx = std::experimental;
using Lanes = stdx::native_simd<float>;
using Mask = Lanes::mask_type;
constexpr int k_lanes = Lanes::size();
static_assert(k_lanes <= 16, "SplineImage pads for 16 lanes");

Lanes load(const float* from) {
  return Lanes(from, stdx::element_aligned);
}

/// Σ over 6 × 6 coefficients from `first` on, each lane with its own fractions.
[[gnu::always_inline]] inline Lanes interpolated(const float* first, std::size_t stride, const Lanes& t_u,
                                                 const Lanes& t_v) {
  const auto wx = spline_weights(t_u), wy = spline_weights(t_v);
  Lanes sum = 0.0F;
  for (std::size_t b = 0; b < 6; ++b, first += stride) {
    Lanes row = wx[0] * load(first);
    for (std::size_t a = 1; a < 6; ++a) row += wx[a] * load(first + a);
    sum += wy[b] * row;
  }
  return sum;
}

/// One row of an element: displacement u_0 + u_1 X along it.
struct RowMotion {
  float u0, u1, v0, v1;
};

constexpr float k_level = 2e-3F;    // slope of v along a row, up to which it is interpolated along its path
constexpr int k_longest_row = 112;  // px, of such a row
using RowBuffer = std::array<float, k_longest_row + 2 * k_lanes>;

/// The coefficients of a row of `count` pixels and five more, interpolated down the columns: what is left is
/// to interpolate along the row, 12 loads for a vector of pixels instead of 36. Column j is taken where the
/// row's path y + v crosses it, `v_first` + v_slope j above the coefficients' third line: exact for a path
/// along the pixels; on a slope of v_slope pixels see neighbouring columns at neighbouring heights, which to
/// first order adds a multiple of v_slope ∂²g/∂x∂y: as much to one side of a speckle as to the other.
[[gnu::always_inline]] inline void interpolate_columns(const float* first, std::size_t stride, int count,
                                                       float v_first, float v_slope, const Lanes& lane,
                                                       RowBuffer& out) {
  for (int k = 0; k < count + 5; k += k_lanes) {
    const auto weight = spline_weights(Lanes(v_first + v_slope * (lane + static_cast<float>(k))));
    const float* from = first + k;
    Lanes sum = weight[0] * load(from);
    for (std::size_t b = 1; b < 6; ++b) sum += weight[b] * load(from += stride);
    sum.copy_to(out.data() + k, stdx::element_aligned);
  }
}

[[gnu::always_inline]] inline Lanes interpolated_along(const float* columns, const Lanes& t_u) {
  const auto weight = spline_weights(t_u);
  Lanes sum = weight[0] * load(columns);
  for (std::size_t a = 1; a < 6; ++a) sum += weight[a] * load(columns + a);
  return sum;
}

/// g at pixels (x … x + lanes − 1, y) displaced by (u, v); `seen` tells where the picture reaches.
Lanes deformed(const SplineImage& g, int x, int y, const Lanes& u, const Lanes& v, int count,
               const Lanes& lane, Mask& seen) {
  const Lanes floor_u = stdx::floor(u), floor_v = stdx::floor(v);
  const Lanes px = lane + u + static_cast<float>(x), py = v + static_cast<float>(y);
  seen = lane < static_cast<float>(count) && px >= 0.0F && py >= 0.0F &&
         px <= static_cast<float>(g.width() - 1) && py <= static_cast<float>(g.height() - 1);
  Lanes value = 0.0F;
  if (stdx::none_of(seen)) return value;
  Mask left = seen;
  // Displacements are smooth: nearly always one pass, two where the integer part changes.
  while (stdx::any_of(left)) {
    const int first = stdx::find_first_set(left);
    const float du = floor_u[first], dv = floor_v[first];
    const Mask now = left && floor_u == du && floor_v == dv;
    left = left && !now;
    const Lanes sum = interpolated(g.coefficient(x + static_cast<int>(du) - 2, y + static_cast<int>(dv) - 2),
                                   g.stride(), u - floor_u, v - floor_v);
    stdx::where(now, value) = sum;
  }
  return value;
}

/// Integer part of the displacement of a row of pixels; `common` if it is one for all of them, and the
/// picture reaches there: then nothing need be searched for from vector to vector, and one need not wait for
/// the other.
struct RowShift {
  bool common = false;
  float u = 0, v = 0;
};
/// From the displacements between which those of the row lie.
[[gnu::always_inline]] inline RowShift row_shift(const SplineImage& g, const ElementPixels::Row& row,
                                                 float u_min, float u_max, float v_min, float v_max) {
  const RowShift s{true, std::floor(u_min), std::floor(v_min)};
  const float last = row.x + row.count - 1, x = row.x, y = row.y;
  const bool seen =
      x + u_min >= 0 && y + v_min >= 0 && last + u_max <= g.width() - 1 && y + v_max <= g.height() - 1;
  return seen && s.u == std::floor(u_max) && s.v == std::floor(v_max) ? s : RowShift{};
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
  const auto at = [](double value) -> float { return value; };
  p.u = at(m.u[0]) + at(m.u[1]) * p.x + (at(m.u[2]) + at(m.u[3]) * p.x) * p.y;
  p.v = at(m.v[0]) + at(m.v[1]) * p.x + (at(m.v[2]) + at(m.v[3]) * p.x) * p.y;
  return p;
}

/// Between which a bilinear motion lies for natural coordinates from −1 to 1: its values at the corners (a
/// triangle's natural coordinates lie in there too).
struct MotionRange {
  float u_min = 0, u_max = 0, v_min = 0, v_max = 0;
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

/// A row is a few cache lines in four places, and the next lies elsewhere: unless they are asked for some
/// rows before they are needed the loop waits for memory most of its time.
constexpr std::size_t k_rows_ahead = 4;
constexpr int k_line = 16;  // floats in a cache line

/// Whole pixels that the middle of an element is displaced by; 0 where it makes no sense.
std::array<int, 2> whole_pixels(const ElementMotion& m) {
  const auto whole = [](double u) { return std::abs(u) < 1e6 ? static_cast<int>(std::floor(u)) : 0; };
  return {whole(m.u[0]), whole(m.v[0])};
}

[[gnu::always_inline]] inline void fetch(const ElementPixels::Row& row, const ReferenceRows& f,
                                         const SplineImage& g, const std::array<int, 2>& shift) {
  const std::size_t at = f.index(row.x, row.y);
  const float* last =  // of the six rows of coefficients, the one that the rows before did not read
      g.coefficient(std::clamp(row.x + shift[0] - 2, 0, g.width() - 1),
                    std::clamp(row.y + shift[1] + 3, 0, g.height() - 1));
  for (int k = 0; k < row.count + k_line; k += k_line)
    for (const float* from : {f.value + at, f.dx + at, f.dy + at, last}) __builtin_prefetch(from + k);
}

/// 0, 1, 2 …
Lanes lane_numbers() {
  return Lanes([](auto i) -> float { return i; });
}

/// `natural`: X and Y of each pixel from the table, instead of steps along its row.
template <bool natural>
ResidualSums sums_of(const PixelTable& table, const ElementPixels& element, const ReferenceRows& f,
                     const SplineImage& g, const ElementMotion& motion) {
  Lanes x0 = 0.0F, x1 = 0.0F, x2 = 0.0F, x3 = 0.0F, y0 = 0.0F, y1 = 0.0F, y2 = 0.0F, y3 = 0.0F;
  Lanes sum = 0.0F, squares = 0.0F, with_reference = 0.0F, used = 0.0F;
  const Lanes lane = lane_numbers();
  RowBuffer columns{};  // finite also where lanes beyond the row read it
  [[maybe_unused]] const MotionRange range = natural ? motion_range(motion) : MotionRange{};
  const auto whole = whole_pixels(motion);
  for (const auto& row : table.rows(element)) {
    fetch(table.row_ahead(row, k_rows_ahead), f, g, whole);
    const double y = row.y - element.y_origin;
    const RowMotion m = row_motion(motion, y);
    const float yy = y;
    const std::size_t at = f.index(row.x, row.y);
    const RowShift shift = [&] {
      if constexpr (natural) return row_shift(g, row, range.u_min, range.u_max, range.v_min, range.v_max);
      const float first = row.x - element.x_origin, last = row.x + row.count - 1 - element.x_origin;
      const float ua = m.u0 + m.u1 * first, ub = m.u0 + m.u1 * last, va = m.v0 + m.v1 * first,
                  vb = m.v0 + m.v1 * last;
      return row_shift(g, row, std::min(ua, ub), std::max(ua, ub), std::min(va, vb), std::max(va, vb));
    }();
    const float* coefficients = shift.common ? g.coefficient(row.x + static_cast<int>(shift.u) - 2,
                                                             row.y + static_cast<int>(shift.v) - 2)
                                             : nullptr;
    const bool level = !natural && shift.common && std::abs(m.v1) <= k_level && row.count <= k_longest_row;
    if (level) {
      const float x_first = row.x - element.x_origin;
      // The path crosses column j where X + u₀ + u₁ X is the column's place.
      const float slope = m.v1 / (1 + m.u1), x_column = x_first + shift.u - 2 - m.u0;
      interpolate_columns(coefficients, g.stride(), row.count, m.v0 + slope * x_column - shift.v, slope, lane,
                          columns);
    }
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
      const Lanes value = level ? interpolated_along(columns.data() + k, p.u - shift.u)
                          : shift.common
                              ? interpolated(coefficients + k, g.stride(), p.u - shift.u, p.v - shift.v)
                              : deformed(g, row.x + k, row.y, p.u, p.v, row.count - k, lane, seen);
      const std::size_t i = at + k;
      Lanes reference = load(f.value + i), r = reference - motion.gain * value - motion.offset, use = 1.0F;
      const Mask out = !seen || reference != reference;
      stdx::where(out, reference) = 0.0F, stdx::where(out, r) = 0.0F, stdx::where(out, use) = 0.0F;
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
    for (int i = 0; i < k_lanes; ++i) all += lanes[i];
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

namespace {

/// `put(x, y, residual)` for each pixel of an element, NaN where there is none.
template <class Put>
void each_residual(const PixelTable& table, const ElementPixels& element, const ReferenceRows& f,
                   const SplineImage& g, const ElementMotion& motion, const Put& put) {
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
      const std::size_t i = f.index(row.x + k, row.y);
      for (int l = 0; l < std::min(k_lanes, row.count - k); ++l) {
        const std::size_t s = l;
        put(row.x + k + l, row.y,
            seen[s] ? f.value[i + s] - motion.gain * value[s] - motion.offset
                    : std::numeric_limits<float>::quiet_NaN());
      }
    }
  }
}

}  // namespace

void residual_pixels(const PixelTable& table, const ElementPixels& element, const ReferenceRows& f,
                     const SplineImage& g, const ElementMotion& motion, float* out, std::size_t stride) {
  each_residual(table, element, f, g, motion,
                [&](int x, int y, float residual) { out[y * stride + x] = residual; });
}

std::vector<float> element_residuals(const PixelTable& table, const ElementPixels& element,
                                     const ReferenceRows& f, const SplineImage& g,
                                     const ElementMotion& motion) {
  std::vector<float> residuals;
  each_residual(table, element, f, g, motion, [&](int, int, float residual) {
    if (!std::isnan(residual)) residuals.push_back(residual);
  });
  return residuals;
}

}  // namespace knothe::imaging
