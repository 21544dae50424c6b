#include "knothe/report/figures/colour_map.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace knothe::report {
namespace {

using Colour = std::array<double, 3>;

constexpr int k_levels = 32;

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
std::string sample(const std::array<Colour, n>& table, double fraction) {
  const double at = std::clamp(fraction, 0.0, 1.0) * (n - 1);
  const auto lower = std::min<std::size_t>(at, n - 2);
  const double part = at - lower;
  const auto channel = [&](int c) -> int {
    return std::lround((1 - part) * table[lower][c] + part * table[lower + 1][c]);
  };
  return fmt::format("#{:02x}{:02x}{:02x}", channel(0), channel(1), channel(2));
}

constexpr std::array<const char*, 8> k_series_light = {"#0068a8", "#c8500a", "#00805f", "#a8487e",
                                                       "#b07d00", "#2f8fc4", "#6b5bb5", "#555555"};
constexpr std::array<const char*, 8> k_series_dark = {"#5ab4f0", "#ff8c4a", "#2fcf9f", "#e58cbd",
                                                      "#f0c24a", "#8fd3ff", "#b0a2ff", "#bbbbbb"};

// Late is what matters, so late has the most contrast: dark on light paper, bright on dark.
std::string time_light(int level) {
  return viridis(0.93 * (1.0 - level / (k_levels - 1.0)));
}
std::string time_dark(int level) {
  return viridis(0.22 + 0.78 * level / (k_levels - 1.0));
}

constexpr const char* k_ink_light = "#1c2530";
constexpr const char* k_ink_dark = "#e4e8ec";
constexpr const char* k_faint_light = "#8a939c";
constexpr const char* k_faint_dark = "#87919b";
constexpr const char* k_truth_light = "#c4161c";
constexpr const char* k_truth_dark = "#ff6b62";

std::string rules(bool dark) {
  std::string css;
  for (std::size_t i = 0; i < k_series_light.size(); ++i)
    css += fmt::format(".ks{}{{color:{}}}", i, dark ? k_series_dark[i] : k_series_light[i]);
  for (int i = 0; i < k_levels; ++i)
    css += fmt::format(".kt{}{{color:{}}}", i, dark ? time_dark(i) : time_light(i));
  css += fmt::format(".ki{{color:{}}}.kf{{color:{}}}.kr{{color:{}}}", dark ? k_ink_dark : k_ink_light,
                     dark ? k_faint_dark : k_faint_light, dark ? k_truth_dark : k_truth_light);
  return css;
}

}  // namespace

std::string viridis(double fraction) {
  return sample(k_viridis, fraction);
}
std::string blue_white_red(double fraction) {
  return sample(k_diverging, fraction);
}

Paint Paint::series(int index) {
  const auto i = std::abs(index) % std::ssize(k_series_light);
  return {fmt::format("ks{}", i), k_series_light[i]};
}

Paint Paint::time(double fraction) {
  const int level = std::lround(std::clamp(fraction, 0.0, 1.0) * (k_levels - 1));
  return {fmt::format("kt{}", level), time_light(level)};
}

Paint Paint::ink() {
  return {"ki", k_ink_light};
}
Paint Paint::faint() {
  return {"kf", k_faint_light};
}
Paint Paint::truth() {
  return {"kr", k_truth_light};
}

std::string paint_css() {
  return rules(false) + "@media screen and (prefers-color-scheme:dark){" + rules(true) + "}";
}

}  // namespace knothe::report
