#include "knothe/imaging/series/textured_region.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "knothe/numerics/statistics/order_statistics.hpp"

namespace knothe::imaging {
namespace {

constexpr int k_block = 16;                  // px
constexpr double k_min_classes_apart = 0.8;  // decades between the classes' means: less is one class
constexpr double k_min_share = 0.05;         // of the blocks in either class: less is a spot
constexpr double k_floor = 0.5;              // grey levels: a blacker block is as black as that
constexpr int k_hole_rounds = 2;             // of a hole that is filled: four blocks across

/// A number for each block.
struct Blocks {
  int columns = 0, rows = 0;
  std::vector<double> value;
  [[nodiscard]] double at(int column, int row) const {
    return value[static_cast<std::size_t>(row) * columns + column];
  }
};

double log_contrast(const files::Picture& picture, int column, int row) {
  double sum = 0, squares = 0;
  constexpr double k_count = k_block * k_block;
  for (int y = row * k_block; y < (row + 1) * k_block; ++y)
    for (int x = column * k_block; x < (column + 1) * k_block; ++x) {
      const double level = picture.at(x, y);
      sum += level, squares += level * level;
    }
  const double variance = std::max(0.0, squares / k_count - std::pow(sum / k_count, 2));
  return std::log10(std::max(k_floor, std::sqrt(variance)));
}

Blocks log_contrasts(const files::Picture& picture) {
  Blocks blocks{picture.width / k_block, picture.height / k_block, {}};
  for (int row = 0; row < blocks.rows; ++row)
    for (int column = 0; column < blocks.columns; ++column)
      blocks.value.push_back(log_contrast(picture, column, row));
  return blocks;
}

/// Blocks without texture that have more than half of their neighbours textured become so.
void fill_holes(Blocks& textured) {
  const Blocks before = textured;
  for (int row = 0; row < before.rows; ++row)
    for (int column = 0; column < before.columns; ++column) {
      double around = 0, all = 0;
      for (int y = std::max(0, row - 1); y <= std::min(before.rows - 1, row + 1); ++y)
        for (int x = std::max(0, column - 1); x <= std::min(before.columns - 1, column + 1); ++x)
          around += before.at(x, y), all += 1;
      if (around > 0.6 * all) textured.value[row * before.columns + column] = 1;
    }
}

struct Rectangle {
  int x0 = 0, y0 = 0, x1 = -1, y1 = -1;  ///< blocks, inclusive
  [[nodiscard]] int area() const { return (x1 - x0 + 1) * (y1 - y0 + 1); }
};

/// For each first row, the columns that are textured from it down to each last row.
Rectangle largest_rectangle(const Blocks& textured) {
  Rectangle best;
  for (int y0 = 0; y0 < textured.rows; ++y0) {
    std::vector<char> open(textured.columns, 1);
    for (int y1 = y0; y1 < textured.rows; ++y1)
      for (int x = 0, begin = 0; x < textured.columns; ++x) {
        open[x] &= static_cast<char>(textured.at(x, y1) > 0);
        if (open[x] == 0) {
          begin = x + 1;
          continue;
        }
        const Rectangle now{begin, y0, x, y1};
        if (now.area() > best.area()) best = now;
      }
  }
  return best;
}

}  // namespace

std::optional<Region> textured_region(const files::Picture& picture, double margin) {
  Blocks blocks = log_contrasts(picture);
  const auto [threshold, explained, apart, below] = numerics::two_classes(blocks.value);
  if (!(apart > k_min_classes_apart && std::min(below, 1 - below) > k_min_share)) return std::nullopt;
  for (double& value : blocks.value) value = value > threshold ? 1 : 0;
  for (int round = 0; round < k_hole_rounds; ++round) fill_holes(blocks);
  const Rectangle found = largest_rectangle(blocks);
  const double left = found.x0 == 0 ? margin : (found.x0 + 1) * k_block,
               top = found.y0 == 0 ? margin : (found.y0 + 1) * k_block;
  const double right = found.x1 == blocks.columns - 1 ? picture.width - 1 - margin : found.x1 * k_block - 1,
               bottom = found.y1 == blocks.rows - 1 ? picture.height - 1 - margin : found.y1 * k_block - 1;
  if (right - left < 2 * k_block || bottom - top < 2 * k_block) return std::nullopt;
  return Region{left, top, right, bottom};
}

}  // namespace knothe::imaging
