#pragma once
/// @file A picture as a smooth function: cubic B-spline interpolation (Unser, Aldroubi, Eden 1993).
///
/// g(x, y) = Σ c_ij β³(x − i) β³(y − j). The coefficients c come from the pixels by the inverse of the filter
/// (1/6, 4/6, 1/6) in both directions, whose impulse response √3 z^|k|, z = √3 − 2, is cut after 14 pixels
/// (1e-8 of the picture's contrast); the picture is continued by reflection at its borders.
#include <span>
#include <vector>

#include "knothe/files/picture.hpp"

namespace knothe::imaging {

/// Spline coefficients of a picture, with a border so that a 4 × 4 neighbourhood read a vector at a time
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

  /// Value and gradient at all pixels, each of width × height.
  void at_pixels(std::vector<float>& value, std::vector<float>& dx, std::vector<float>& dy) const;

  /// Coefficient (i, j) and its neighbours: row j + 1 is `stride()` further on. −2 ≤ j ≤ height + 1; a vector
  /// of up to 16 coefficients may be read from −18 ≤ i ≤ width + 1.
  [[nodiscard]] const float* coefficient(int i, int j) const {
    return coefficients_.data() + k_pad + static_cast<std::size_t>(j + k_border) * stride_ + i + k_border;
  }
  [[nodiscard]] std::size_t stride() const { return stride_; }

 private:
  static constexpr int k_border = 2;
  static constexpr std::size_t k_pad = 32;
  int width_ = 0, height_ = 0;
  std::size_t stride_ = 0;
  std::vector<float> coefficients_;
  std::vector<float> smoothed_;
};

/// The filter of taps h_0, h_1 … h_n (symmetric) along rows and columns; reflection at the borders. Rows of
/// `out` are `out_stride` apart; `out` is not `in`.
void filter_picture(const float* in, int width, int height, std::span<const float> taps, float* out,
                    std::size_t out_stride, int threads);

/// Taps of a Gaussian of standard deviation sigma (px), cut at 4 sigma, sum 1.
[[nodiscard]] std::vector<float> gaussian_taps(double sigma);

}  // namespace knothe::imaging
