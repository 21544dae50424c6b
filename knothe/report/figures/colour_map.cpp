#include "knothe/report/figures/colour_map.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace knothe::report {
namespace {

using Colour = std::array<double, 3>;

/// The published map at 17 even places; between them linear, which differs from the full table by less than
/// 2/255.
constexpr std::array<Colour, 17> k_viridis = {{{68, 1, 84},
                                               {72, 24, 106},
                                               {71, 45, 123},
                                               {66, 64, 134},
                                               {59, 82, 139},
                                               {51, 99, 141},
                                               {44, 114, 142},
                                               {38, 130, 142},
                                               {33, 145, 140},
                                               {31, 160, 136},
                                               {40, 174, 128},
                                               {63, 188, 115},
                                               {94, 201, 98},
                                               {132, 212, 75},
                                               {173, 220, 48},
                                               {216, 226, 25},
                                               {253, 231, 37}}};
constexpr std::array<Colour, 7> k_diverging = {{{5, 72, 140},
                                                {67, 147, 195},
                                                {170, 209, 229},
                                                {247, 247, 247},
                                                {250, 190, 160},
                                                {214, 96, 77},
                                                {150, 10, 35}}};

template <std::size_t n>
Rgb sample(const std::array<Colour, n>& table, double fraction) {
  const double at = std::clamp(fraction, 0.0, 1.0) * (n - 1);
  const auto lower = std::min<std::size_t>(at, n - 2);
  const double part = at - lower;
  const auto channel = [&](int c) -> std::uint8_t {
    return std::lround((1 - part) * table[lower][c] + part * table[lower + 1][c]);
  };
  return {channel(0), channel(1), channel(2)};
}

}  // namespace

Rgb viridis(double fraction) {
  return sample(k_viridis, fraction);
}
Rgb blue_white_red(double fraction) {
  return sample(k_diverging, fraction);
}

}  // namespace knothe::report
