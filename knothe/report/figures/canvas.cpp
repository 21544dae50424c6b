#include "knothe/report/figures/canvas.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "knothe/files/picture.hpp"

namespace knothe::report {
namespace {

/// A letter as eight rows of five dots, the highest bit on the left.
struct Glyph {
  char letter;
  std::array<std::uint8_t, 8> rows;
};
constexpr Glyph k_glyphs[] = {{' ', {0, 0, 0, 0, 0, 0, 0, 0}},        {'%', {25, 25, 2, 4, 8, 19, 19, 0}},
                              {'(', {2, 4, 8, 8, 8, 4, 2, 0}},        {')', {8, 4, 2, 2, 2, 4, 8, 0}},
                              {'*', {0, 21, 14, 31, 14, 21, 0, 0}},   {'+', {0, 4, 4, 31, 4, 4, 0, 0}},
                              {',', {0, 0, 0, 0, 0, 12, 4, 8}},       {'-', {0, 0, 0, 31, 0, 0, 0, 0}},
                              {'.', {0, 0, 0, 0, 0, 12, 12, 0}},      {'/', {1, 1, 2, 4, 8, 16, 16, 0}},
                              {'0', {14, 17, 19, 21, 25, 17, 14, 0}}, {'1', {4, 12, 4, 4, 4, 4, 14, 0}},
                              {'2', {14, 17, 1, 6, 8, 16, 31, 0}},    {'3', {14, 17, 1, 6, 1, 17, 14, 0}},
                              {'4', {2, 6, 10, 18, 31, 2, 2, 0}},     {'5', {31, 16, 30, 1, 1, 17, 14, 0}},
                              {'6', {6, 8, 16, 30, 17, 17, 14, 0}},   {'7', {31, 1, 2, 4, 8, 8, 8, 0}},
                              {'8', {14, 17, 17, 14, 17, 17, 14, 0}}, {'9', {14, 17, 17, 15, 1, 2, 12, 0}},
                              {':', {0, 12, 12, 0, 12, 12, 0, 0}},    {'=', {0, 0, 31, 0, 31, 0, 0, 0}},
                              {'_', {0, 0, 0, 0, 0, 0, 0, 31}},       {'a', {0, 0, 14, 1, 15, 17, 15, 0}},
                              {'b', {16, 16, 30, 17, 17, 17, 30, 0}}, {'c', {0, 0, 15, 16, 16, 16, 15, 0}},
                              {'d', {1, 1, 15, 17, 17, 17, 15, 0}},   {'e', {0, 0, 14, 17, 31, 16, 14, 0}},
                              {'f', {6, 8, 30, 8, 8, 8, 8, 0}},       {'g', {0, 0, 15, 17, 17, 15, 1, 14}},
                              {'h', {16, 16, 30, 17, 17, 17, 17, 0}}, {'i', {4, 0, 12, 4, 4, 4, 14, 0}},
                              {'j', {2, 0, 6, 2, 2, 2, 2, 12}},       {'k', {16, 16, 18, 20, 24, 20, 18, 0}},
                              {'l', {12, 4, 4, 4, 4, 4, 14, 0}},      {'m', {0, 0, 26, 21, 21, 21, 21, 0}},
                              {'n', {0, 0, 30, 17, 17, 17, 17, 0}},   {'o', {0, 0, 14, 17, 17, 17, 14, 0}},
                              {'p', {0, 0, 30, 17, 17, 30, 16, 16}},  {'q', {0, 0, 15, 17, 17, 15, 1, 1}},
                              {'r', {0, 0, 22, 25, 16, 16, 16, 0}},   {'s', {0, 0, 15, 16, 14, 1, 30, 0}},
                              {'t', {8, 8, 30, 8, 8, 8, 6, 0}},       {'u', {0, 0, 17, 17, 17, 17, 15, 0}},
                              {'v', {0, 0, 17, 17, 17, 10, 4, 0}},    {'w', {0, 0, 17, 17, 21, 21, 10, 0}},
                              {'x', {0, 0, 17, 10, 4, 10, 17, 0}},    {'y', {0, 0, 17, 17, 17, 15, 1, 14}},
                              {'z', {0, 0, 31, 2, 4, 8, 31, 0}}};
constexpr std::array<std::uint8_t, 8> k_unknown = {31, 17, 17, 17, 17, 17, 31, 0};
constexpr int k_advance = 6;  // dots from letter to letter

const std::array<std::uint8_t, 8>& rows_of(char letter) {
  const auto lower = static_cast<char>(letter >= 'A' && letter <= 'Z' ? letter - 'A' + 'a' : letter);
  for (const Glyph& glyph : k_glyphs)
    if (glyph.letter == lower) return glyph.rows;
  return k_unknown;
}

}  // namespace

Canvas::Canvas(int width, int height, Rgb background) : width_(width), height_(height) {
  pixels_.reserve(std::size_t{3} * width * height);
  for (int i = 0; i < width * height; ++i)
    pixels_.insert(pixels_.end(), background.begin(), background.end());
}

void Canvas::blend(int x, int y, Rgb colour, double opacity) {
  if (x < 0 || y < 0 || x >= width_ || y >= height_) return;
  const std::size_t row = y, at = 3 * (row * width_ + x);
  for (std::size_t c = 0; c < 3; ++c)
    pixels_[at + c] = std::lround((1 - opacity) * pixels_[at + c] + opacity * colour[c]);
}

void Canvas::fill(int x, int y, int width, int height, Rgb colour) {
  for (int j = y; j < y + height; ++j)
    for (int i = x; i < x + width; ++i) blend(i, j, colour);
}

void Canvas::line(double x0, double y0, double x1, double y1, Rgb colour, double thickness) {
  const double reach = 0.5 * thickness + 1, dx = x1 - x0, dy = y1 - y0, squared = dx * dx + dy * dy;
  for (int y = std::floor(std::min(y0, y1) - reach); y <= std::max(y0, y1) + reach; ++y)
    for (int x = std::floor(std::min(x0, x1) - reach); x <= std::max(x0, x1) + reach; ++x) {
      const double along = squared > 0 ? std::clamp(((x - x0) * dx + (y - y0) * dy) / squared, 0.0, 1.0) : 0;
      const double distance = std::hypot(x - x0 - along * dx, y - y0 - along * dy);
      blend(x, y, colour, std::clamp(0.5 * thickness + 0.5 - distance, 0.0, 1.0));
    }
}

void Canvas::text(int x, int y, const std::string& words, Rgb colour, int size) {
  for (const char letter : words) {
    const auto& rows = rows_of(letter);
    for (int j = 0; j < 8; ++j)
      for (int i = 0; i < 5; ++i)
        if ((rows[j] >> (4 - i) & 1) != 0) fill(x + i * size, y + j * size, size, size, colour);
    x += k_advance * size;
  }
}

int Canvas::text_width(const std::string& words, int size) {
  return std::ssize(words) * k_advance * size;
}

void Canvas::write(const std::string& path) const {
  files::write_colour_png(path, width_, height_, pixels_);
}

}  // namespace knothe::report
