#pragma once
/// @file A small raster drawing board: pictures in colour with lines and text, for maps over photographs.
#include <array>
#include <cstdint>
#include <string>
#include <vector>

namespace knothe::report {

using Rgb = std::array<std::uint8_t, 3>;

class Canvas {
 public:
  Canvas(int width, int height, Rgb background = {255, 255, 255});
  [[nodiscard]] int width() const { return width_; }
  [[nodiscard]] int height() const { return height_; }
  /// Mixes a colour into a pixel: opacity 1 replaces it. Outside the canvas nothing happens.
  void blend(int x, int y, Rgb colour, double opacity = 1);
  void fill(int x, int y, int width, int height, Rgb colour);
  /// A line of that thickness (px), anti-aliased.
  void line(double x0, double y0, double x1, double y1, Rgb colour, double thickness = 1);
  /// Text with its upper left corner there, letters of 5 × 7 dots, each dot `size` px. Characters the small
  /// alphabet lacks become a box.
  void text(int x, int y, const std::string& words, Rgb colour, int size = 2);
  [[nodiscard]] static int text_width(const std::string& words, int size = 2);
  /// PNG, atomically. Errors: IoError.
  void write(const std::string& path) const;

 private:
  int width_, height_;
  std::vector<std::uint8_t> pixels_;
};

}  // namespace knothe::report
