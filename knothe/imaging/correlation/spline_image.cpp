#include "knothe/imaging/correlation/spline_image.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <experimental/simd>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/base/threads.hpp"

namespace knothe::imaging {

namespace {

constexpr int k_block_rows = 32;  // rows that one task of a filter does

/// Index reflected about the first and the last pixel.
int reflected(int i, int n) {
  if (n == 1) return 0;
  const int period = 2 * (n - 1);
  i = std::abs(i) % period;
  return i < n ? i : period - i;
}

constexpr int k_spline_reach = 22;       // px: by then the impulse response is 3e-8
constexpr double k_smallest_tap = 5e-8;  // smaller ones at the end are left out

/// c_k of the cubic spline, √3 z^|k| with z = √3 − 2.
double cubic_response(int k) {
  return std::sqrt(3.0) * std::pow(std::sqrt(3.0) - 2, std::abs(k));
}

/// From pixels, smoothed or not, to spline coefficients in one filter.
std::vector<float> coefficient_taps(double prefilter_sigma, double (*response)(int)) {
  const std::vector<float> smooth =
      prefilter_sigma > 0 ? gaussian_taps(prefilter_sigma) : std::vector<float>{1};
  const int radius = smooth.size() - 1;
  std::vector<double> taps;
  for (int k = 0; k <= radius + k_spline_reach; ++k) {
    double sum = 0;
    for (int j = -radius; j <= radius; ++j) sum += smooth[std::abs(j)] * response(k - j);
    taps.push_back(sum);
  }
  while (std::abs(taps.back()) < k_smallest_tap) taps.pop_back();
  return {taps.begin(), taps.end()};
}

/// d/dt of spline_weights.
std::array<float, 6> spline_slopes(float t) {
  const float p = t * t - t, w = t - 0.5F, dp = 2 * w, r = p * (p - 3), dr = (2 * p - 3) * dp;
  const float even = (2 * p - 5) * dp / 24, odd = -(r + 4 + w * dr) / 12, outer_even = -dr / 16,
              outer_odd = (p * p - p - 5 + w * (2 * p - 1) * dp) / 24, last = t * t * t * t / 24;
  return {dp * (1 + 2 * p) / 24 - last,
          outer_even + outer_odd,
          even + odd,
          even - odd,
          outer_even - outer_odd,
          last};
}

}  // namespace

double spline_response(int k) {
  // The roots of z⁴ + 26 z³ + 66 z² + 26 z + 1 within the unit circle, and partial fractions.
  static const double z1 = std::sqrt(67.5 - std::sqrt(4436.25)) + std::sqrt(26.25) - 6.5,
                      z2 = std::sqrt(67.5 + std::sqrt(4436.25)) - std::sqrt(26.25) - 6.5;
  const double scale = 120 * z1 * z2 / ((1 - z1 * z2) * (z1 - z2));
  const int n = std::abs(k);
  return scale * (z1 / (1 - z1 * z1) * std::pow(z1, n) - z2 / (1 - z2 * z2) * std::pow(z2, n));
}

std::vector<float> gaussian_taps(double sigma) {
  const int radius = std::ceil(4 * sigma);
  std::vector<double> h;
  double sum = 0;
  for (int k = 0; k <= radius; ++k) {
    h.push_back(std::exp(-0.5 * k * k / (sigma * sigma)));
    sum += (k == 0 ? 1 : 2) * h.back();
  }
  std::vector<float> taps;
  for (const double value : h) taps.push_back(value / sum);
  return taps;
}

namespace {

namespace stdx = std::experimental;
using Lanes = stdx::native_simd<float>;
constexpr std::size_t k_lanes = Lanes::size();

/// out[x] = h_0 centre[x] + Σ_k h_k (before(k)[x] + after(k)[x]), `columns` vectors at a time: the sums stay
/// in registers, so that each number is read once a tap and written once.
template <std::size_t columns, class Before, class After>
std::size_t filter_columns(std::size_t x, std::size_t width, std::span<const float> taps, const float* centre,
                           const Before& before, const After& after, float* out) {
  const auto load = [](const float* from) { return Lanes(from, stdx::element_aligned); };
  for (; x + columns * k_lanes <= width; x += columns * k_lanes) {
    std::array<Lanes, columns> sum;
    for (std::size_t c = 0; c < columns; ++c) sum[c] = taps[0] * load(centre + x + c * k_lanes);
    for (Index k = 1; k < std::ssize(taps); ++k) {
      const float *one = before(k) + x, *other = after(k) + x;
      const Lanes h = taps[k];
      for (std::size_t c = 0; c < columns; ++c)
        sum[c] += h * (load(one + c * k_lanes) + load(other + c * k_lanes));
    }
    for (std::size_t c = 0; c < columns; ++c) sum[c].copy_to(out + x + c * k_lanes, stdx::element_aligned);
  }
  return x;
}

template <class Before, class After>
void filter_line(std::size_t width, std::span<const float> taps, const float* centre, const Before& before,
                 const After& after, float* out) {
  std::size_t x = filter_columns<4>(0, width, taps, centre, before, after, out);
  x = filter_columns<1>(x, width, taps, centre, before, after, out);
  for (; x < width; ++x) {
    float sum = taps[0] * centre[x];
    for (Index k = 1; k < std::ssize(taps); ++k) sum += taps[k] * (before(k)[x] + after(k)[x]);
    out[x] = sum;
  }
}

}  // namespace

void filter_picture(const float* in, int width, int height, std::span<const float> taps, float* out,
                    std::size_t out_stride, int threads) {
  const std::size_t w = width, radius = taps.size() - 1, blocks = (height + k_block_rows - 1) / k_block_rows;
  const auto row_of = [&](int y) { return in + w * reflected(y, height); };
  parallel_for(blocks, threads, [&](std::size_t block) {
    std::vector<float> row(w + 2 * radius);  // down the columns, with its reflections at both ends
    float* centre = row.data() + radius;
    const int first = block * k_block_rows;
    for (int y = first; y < std::min(height, first + k_block_rows); ++y) {
      filter_line(
          w, taps, row_of(y), [&](std::size_t k) { return row_of(y - k); },
          [&](std::size_t k) { return row_of(y + k); }, centre);
      for (std::size_t k = 1; k <= radius; ++k) {
        const int i = k;
        *(centre - k) = centre[reflected(-i, width)],
                   centre[w - 1 + k] = centre[reflected(width - 1 + i, width)];
      }
      filter_line(
          w, taps, centre, [&](std::size_t k) { return centre - k; },
          [&](std::size_t k) { return centre + k; }, out + out_stride * y);
    }
  });
}

SplineImage::SplineImage(const files::Picture& picture, double prefilter_sigma, int threads) {
  assign(picture, prefilter_sigma, threads);
}

void SplineImage::assign(const files::Picture& picture, double prefilter_sigma, int threads) {
  assign_filtered(picture, coefficient_taps(prefilter_sigma, spline_response), threads);
}

void SplineImage::assign_filtered(const files::Picture& picture, std::span<const float> taps, int threads) {
  if (picture.width < 4 || picture.height < 4)
    throw UsageError(
        fmt::format("a picture of {} × {} pixels is too small to interpolate: at least 4 × 4 are needed",
                    picture.width, picture.height));
  width_ = picture.width;
  height_ = picture.height;
  const std::size_t w = width_, h = height_;
  // The border takes part in loads of whole vectors, 16 floats from anywhere in a row.
  stride_ = (w + 2 * k_border + 31) / 16 * 16;
  const std::size_t size = stride_ * (h + 2 * k_border) + 2 * k_pad;
  if (coefficients_.size() != size) coefficients_.assign(size, 0.0F);
  const auto row_of = [&](int j) {
    return coefficients_.data() + k_pad + (j + k_border) * stride_ + k_border;
  };
  filter_picture(picture.pixels.data(), width_, height_, taps, row_of(0), stride_, threads);
  for (int j = 0; j < height_; ++j) {
    float* row = row_of(j);
    for (int k = 1; k <= k_border; ++k)
      row[-k] = row[reflected(-k, width_)], row[width_ - 1 + k] = row[reflected(width_ - 1 + k, width_)];
  }
  for (int k = 1; k <= k_border; ++k)
    for (const int j : {-k, height_ - 1 + k})
      std::copy_n(row_of(reflected(j, height_)) - k_border, w + 2 * k_border, row_of(j) - k_border);
}

SplineImage::Value SplineImage::at(double x, double y) const {
  const int i = std::clamp<int>(std::floor(x), 0, width_ - 1),
            j = std::clamp<int>(std::floor(y), 0, height_ - 1);
  const float tx = x - i, ty = y - j;
  const auto wx = spline_weights(tx), wy = spline_weights(ty), dx = spline_slopes(tx), dy = spline_slopes(ty);
  Value result{0, 0, 0};
  for (int b = 0; b < 6; ++b) {
    const float* row = coefficient(i - 2, j - 2 + b);
    const std::size_t r = b;
    float value = 0, slope = 0;
    for (std::size_t a = 0; a < 6; ++a) value += wx[a] * row[a], slope += dx[a] * row[a];
    result.value += wy[r] * value;
    result.dx += wy[r] * slope;
    result.dy += dy[r] * value;
  }
  return result;
}

double slope_response(int k) {
  return (cubic_response(k + 1) - cubic_response(k - 1)) / 2;
}

PixelGradients pixel_gradients(const files::Picture& picture, double prefilter_sigma, const PixelRows& rows,
                               int threads) {
  SplineImage cubic;
  cubic.assign_filtered(picture, coefficient_taps(prefilter_sigma, cubic_response), threads);
  PixelGradients made;
  const std::size_t width = picture.width;
  for (auto* values : {&made.value, &made.dx, &made.dy})
    values->resize(width * (rows.end - rows.first) + k_vector_padding);
  for (int y = rows.first; y < rows.end; ++y) {
    const float *up = cubic.coefficient(0, y - 1), *here = cubic.coefficient(0, y),
                *down = cubic.coefficient(0, y + 1);
    const std::size_t at = width * (y - rows.first);
    float *v = made.value.data() + at, *gx = made.dx.data() + at, *gy = made.dy.data() + at;
    const auto down_sum = [&](std::ptrdiff_t x) { return (up[x] + 4 * here[x] + down[x]) / 6; };
    const auto down_slope = [&](std::ptrdiff_t x) { return (down[x] - up[x]) / 2; };
    for (std::ptrdiff_t x = 0; x < picture.width; ++x) {
      v[x] = (down_sum(x - 1) + 4 * down_sum(x) + down_sum(x + 1)) / 6;
      gx[x] = (down_sum(x + 1) - down_sum(x - 1)) / 2;
      gy[x] = (down_slope(x - 1) + 4 * down_slope(x) + down_slope(x + 1)) / 6;
    }
  }
  return made;
}

}  // namespace knothe::imaging
