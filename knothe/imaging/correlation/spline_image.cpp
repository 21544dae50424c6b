#include "knothe/imaging/correlation/spline_image.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <experimental/simd>

#include "knothe/base/error.hpp"
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

/// √3 z^k, the impulse response of the inverse of (1/6, 4/6, 1/6).
const std::vector<float>& spline_taps() {
  static const std::vector<float> taps = [] {
    std::vector<float> made;
    const double z = std::sqrt(3.0) - 2;
    for (int k = 0; k <= 14; ++k) made.push_back(static_cast<float>(std::sqrt(3.0) * std::pow(z, k)));
    return made;
  }();
  return taps;
}

/// The four weights of the cubic B-spline at fraction t, and their derivatives.
void weights(float t, float w[4], float dw[4]) {
  const float s = 1 - t;
  w[0] = s * s * s / 6;
  w[1] = 2.0F / 3 - t * t + t * t * t / 2;
  w[2] = 2.0F / 3 - s * s + s * s * s / 2;
  w[3] = t * t * t / 6;
  dw[0] = -s * s / 2;
  dw[1] = -2 * t + 1.5F * t * t;
  dw[2] = 2 * s - 1.5F * s * s;
  dw[3] = t * t / 2;
}

}  // namespace

std::vector<float> gaussian_taps(double sigma) {
  const int radius = static_cast<int>(std::ceil(4 * sigma));
  std::vector<double> h;
  double sum = 0;
  for (int k = 0; k <= radius; ++k) {
    h.push_back(std::exp(-0.5 * k * k / (sigma * sigma)));
    sum += (k == 0 ? 1 : 2) * h.back();
  }
  std::vector<float> taps;
  for (const double value : h) taps.push_back(static_cast<float>(value / sum));
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
    for (std::size_t k = 1; k < taps.size(); ++k) {
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
    for (std::size_t k = 1; k < taps.size(); ++k) sum += taps[k] * (before(k)[x] + after(k)[x]);
    out[x] = sum;
  }
}

}  // namespace

void filter_picture(const float* in, int width, int height, std::span<const float> taps, float* out,
                    std::size_t out_stride, int threads) {
  const auto w = static_cast<std::size_t>(width), radius = taps.size() - 1,
             blocks = static_cast<std::size_t>((height + k_block_rows - 1) / k_block_rows);
  const auto row_of = [&](int y) { return in + w * static_cast<std::size_t>(reflected(y, height)); };
  parallel_for(blocks, static_cast<std::size_t>(threads), [&](std::size_t block) {
    std::vector<float> row(w + 2 * radius);  // down the columns, with its reflections at both ends
    float* centre = row.data() + radius;
    const int first = static_cast<int>(block) * k_block_rows;
    for (int y = first; y < std::min(height, first + k_block_rows); ++y) {
      filter_line(
          w, taps, row_of(y), [&](std::size_t k) { return row_of(y - static_cast<int>(k)); },
          [&](std::size_t k) { return row_of(y + static_cast<int>(k)); }, centre);
      for (std::size_t k = 1; k <= radius; ++k) {
        const int i = static_cast<int>(k);
        *(centre - k) = centre[reflected(-i, width)],
                   centre[w - 1 + k] = centre[reflected(width - 1 + i, width)];
      }
      filter_line(
          w, taps, centre, [&](std::size_t k) { return centre - k; },
          [&](std::size_t k) { return centre + k; }, out + out_stride * static_cast<std::size_t>(y));
    }
  });
}

SplineImage::SplineImage(const files::Picture& picture, double prefilter_sigma, int threads) {
  assign(picture, prefilter_sigma, threads);
}

void SplineImage::assign(const files::Picture& picture, double prefilter_sigma, int threads) {
  if (picture.width < 4 || picture.height < 4)
    throw UsageError(
        fmt::format("a picture of {} × {} pixels is too small to interpolate: at least 4 × 4 are needed",
                    picture.width, picture.height));
  width_ = picture.width;
  height_ = picture.height;
  const auto w = static_cast<std::size_t>(width_), h = static_cast<std::size_t>(height_);
  // The border takes part in loads of whole vectors, 16 floats from anywhere in a row.
  stride_ = (w + 2 * k_border + 31) / 16 * 16;
  const std::size_t size = stride_ * (h + 2 * k_border) + 2 * k_pad;
  if (coefficients_.size() != size) coefficients_.assign(size, 0.0F);
  const float* pixels = picture.pixels.data();
  if (prefilter_sigma > 0) {
    smoothed_.resize(w * h);
    filter_picture(pixels, width_, height_, gaussian_taps(prefilter_sigma), smoothed_.data(), w, threads);
    pixels = smoothed_.data();
  }
  const auto row_of = [&](int j) {
    return coefficients_.data() + k_pad + static_cast<std::size_t>(j + k_border) * stride_ + k_border;
  };
  filter_picture(pixels, width_, height_, spline_taps(), row_of(0), stride_, threads);
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
  const int i = std::clamp(static_cast<int>(std::floor(x)), 0, width_ - 1),
            j = std::clamp(static_cast<int>(std::floor(y)), 0, height_ - 1);
  float wx[4], wy[4], dx[4], dy[4];
  weights(static_cast<float>(x - i), wx, dx);
  weights(static_cast<float>(y - j), wy, dy);
  Value result{0, 0, 0};
  for (int b = 0; b < 4; ++b) {
    const float* row = coefficient(i - 1, j - 1 + b);
    const float value = wx[0] * row[0] + wx[1] * row[1] + wx[2] * row[2] + wx[3] * row[3];
    const float slope = dx[0] * row[0] + dx[1] * row[1] + dx[2] * row[2] + dx[3] * row[3];
    result.value += wy[b] * value;
    result.dx += wy[b] * slope;
    result.dy += dy[b] * value;
  }
  return result;
}

void SplineImage::at_pixels(std::vector<float>& value, std::vector<float>& dx, std::vector<float>& dy) const {
  const auto w = static_cast<std::size_t>(width_);
  value.resize(w * static_cast<std::size_t>(height_)), dx.resize(value.size()), dy.resize(value.size());
  for (int y = 0; y < height_; ++y) {
    const float *up = coefficient(0, y - 1), *here = coefficient(0, y), *down = coefficient(0, y + 1);
    float* v = value.data() + w * static_cast<std::size_t>(y);
    float* gx = dx.data() + w * static_cast<std::size_t>(y);
    float* gy = dy.data() + w * static_cast<std::size_t>(y);
    const auto down_sum = [&](std::ptrdiff_t x) { return (up[x] + 4 * here[x] + down[x]) / 6; };
    const auto down_slope = [&](std::ptrdiff_t x) { return (down[x] - up[x]) / 2; };
    for (std::ptrdiff_t x = 0; x < width_; ++x) {
      v[x] = (down_sum(x - 1) + 4 * down_sum(x) + down_sum(x + 1)) / 6;
      gx[x] = (down_sum(x + 1) - down_sum(x - 1)) / 2;
      gy[x] = (down_slope(x - 1) + 4 * down_slope(x) + down_slope(x + 1)) / 6;
    }
  }
}

}  // namespace knothe::imaging
