#pragma once
/// @file A picture as a smooth function: quintic B-spline interpolation (Unser, Aldroubi, Eden 1993).
///
/// g(x, y) = Σ c_ij β⁵(x − i) β⁵(y − j). The coefficients c come from the pixels by the inverse of the filter
/// (1, 26, 66, 26, 1)/120 in both directions, whose impulse response (spline_response) is cut where it is
/// 5e-8 of the picture's contrast, by then after 21 pixels; the picture is continued by reflection at its
/// borders. Quintic, because the cubic spline moves a sharp speckle by up to 0.0014 px
/// (docs/benchmarks/imaging.md).
#include <array>
#include <span>
#include <type_traits>
#include <vector>

#include "knothe/files/picture.hpp"

namespace knothe::imaging {

/// Spline coefficient k of a row of pixels that are 0 but for one of 1 at 0: the convolution of the impulse
/// responses of the two poles of (1, 26, 66, 26, 1)/120.
[[nodiscard]] double spline_response(int k);

/// β⁵(t + 2 − a), a = 0 … 5: what the coefficients floor(x) − 2 … floor(x) + 3 count at fraction t of x.
template <class Number>
[[gnu::always_inline]] inline std::array<Number, 6> spline_weights(const Number& t) {
  const auto number = [](double value) {
    if constexpr (std::is_same_v<Number, double>)
      return value;
    else
      return Number(static_cast<float>(value));
  };
  const Number p = t * t - t, q = p * p, w = t - number(0.5), r = p * (p - number(3));
  const Number even = (p * (p - number(5)) + number(46.0 / 5)) * number(1.0 / 24),
               odd = w * (r + number(4)) * number(-1.0 / 12),
               outer_even = (number(9.0 / 5) - r) * number(1.0 / 16),
               outer_odd = w * (q - p - number(5)) * number(1.0 / 24);
  const Number last = t * t * t * t * t * number(1.0 / 120);
  return {(p + q + number(1.0 / 5)) * number(1.0 / 24) - last,
          outer_even + outer_odd,
          even + odd,
          even - odd,
          outer_even - outer_odd,
          last};
}

struct PixelGradients;
struct PixelRows;

/// Spline coefficients of a picture, with a border so that a 6 × 6 neighbourhood read a vector at a time
/// never leaves the memory.
class SplineImage {
 public:
  SplineImage() = default;
  /// `prefilter_sigma` > 0: the picture is smoothed by a Gaussian of that standard deviation (px) first.
  explicit SplineImage(const files::Picture& picture, double prefilter_sigma = 0, int threads = 1);
  /// The same into memory that is there already.
  void assign(const files::Picture& picture, double prefilter_sigma = 0, int threads = 1);

  [[nodiscard]] int width() const { return width_; }
  [[nodiscard]] int height() const { return height_; }
  /// (x, y) lies where the interpolant is made of pixels: 0 … width − 1, 0 … height − 1.
  [[nodiscard]] bool contains(double x, double y) const {
    return x >= 0 && y >= 0 && x <= width_ - 1 && y <= height_ - 1;
  }
  struct Value {
    float value, dx, dy;  ///< grey levels, grey levels per pixel
  };
  /// Value and gradient at a point of the picture.
  [[nodiscard]] Value at(double x, double y) const;

  /// Coefficient (i, j) and its neighbours: row j + 1 is `stride()` further on. −3 ≤ j ≤ height + 2; a vector
  /// of up to 16 coefficients may be read from −18 ≤ i ≤ width + 2.
  [[nodiscard]] const float* coefficient(int i, int j) const {
    return coefficients_.data() + k_pad + (j + k_border) * stride_ + i + k_border;
  }
  [[nodiscard]] std::size_t stride() const { return stride_; }

 private:
  friend PixelGradients pixel_gradients(const files::Picture& picture, double prefilter_sigma,
                                        const PixelRows& rows, int threads);
  void assign_filtered(const files::Picture& picture, std::span<const float> taps, int threads);

  static constexpr int k_border = 3;
  static constexpr std::size_t k_pad = 32;
  int width_ = 0, height_ = 0;
  std::size_t stride_ = 0;
  std::vector<float> coefficients_;
};

/// Rows first … end − 1 of a picture.
struct PixelRows {
  int first = 0, end = 0;
};
/// Some rows of a picture, after any prefilter, and its gradient there; behind the last pixel there are zeros
/// for k_vector_padding more.
struct PixelGradients {
  std::vector<float> value, dx, dy;  ///< grey levels, grey levels per px
};
inline constexpr std::size_t k_vector_padding = 16;  ///< that a vector may read beyond the last pixel
/// The gradient is that of the cubic spline, (c_{k+1} − c_{k−1})/2 across and (1, 4, 1)/6 along: as a weight
/// in Gauss–Newton it need not be exact, and it lets through less of the noise than the quintic one's.
[[nodiscard]] PixelGradients pixel_gradients(const files::Picture& picture, double prefilter_sigma,
                                             const PixelRows& rows, int threads);
/// dx of pixel_gradients at pixel k of a row that is 0 but for a pixel of 1 at 0; no prefilter.
[[nodiscard]] double slope_response(int k);

/// The filter of taps h_0, h_1 … h_n (symmetric) along rows and columns; reflection at the borders. Rows of
/// `out` are `out_stride` apart; `out` is not `in`.
void filter_picture(const float* in, int width, int height, std::span<const float> taps, float* out,
                    std::size_t out_stride, int threads);

/// Taps of a Gaussian of standard deviation sigma (px), cut at 4 sigma, sum 1.
[[nodiscard]] std::vector<float> gaussian_taps(double sigma);

}  // namespace knothe::imaging
