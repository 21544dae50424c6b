#include "knothe/report/figures/registration_map.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "knothe/report/figures/canvas.hpp"

namespace knothe::report {
namespace {

constexpr int k_longest = 1200, k_min_width = 720;  // px of the drawing
constexpr int k_head = 56, k_gap = 16;
constexpr Rgb k_ink{20, 20, 20}, k_outline{0, 200, 255}, k_used{255, 235, 0}, k_unused{230, 30, 30},
    k_halo{0, 0, 0};

}  // namespace

void write_registration_map(const std::string& path, const files::Picture& picture,
                            const imaging::OutlineFit& fit) {
  const double scale = std::min(2.0, 1.0 * k_longest / std::max(picture.width, picture.height));
  const int width = picture.width * scale, height = picture.height * scale;
  Canvas canvas(std::max(k_min_width, width) + 2 * k_gap, height + k_head + 2 * k_gap);
  const double mm = 1e3 * fit.frame.scale();
  canvas.text(
      k_gap, k_gap,
      fmt::format("outline: {:.6g} +- {:.1g} mm/px, turned by {:.3f} deg", mm,
                  mm * fit.frame.relative_scale_std, 180 / std::numbers::pi * std::arg(fit.frame.slope)),
      k_ink);
  canvas.text(k_gap, k_gap + 24,
              fmt::format("edges: {} used (yellow), {} not (red), {:.2f} px about the line", fit.used,
                          std::ssize(fit.edges) - fit.used, fit.misfit),
              k_ink);
  const int top = k_gap + k_head;
  for (int j = 0; j < height; ++j)
    for (int i = 0; i < width; ++i) {
      const float level = picture.at(std::min<int>(picture.width - 1, i / scale),
                                     std::min<int>(picture.height - 1, j / scale));
      const auto grey = static_cast<std::uint8_t>(std::clamp(255 * level / picture.maximum, 0.0F, 255.0F));
      canvas.blend(k_gap + i, top + j, {grey, grey, grey});
    }
  const auto line = [&](double x0, double y0, double x1, double y1, Rgb colour, double thickness) {
    // Clipped to the picture: its sides may reach far out.
    double from = 0, to = 1;
    const auto clip = [&](double at, double step, double low, double high) {
      if (std::abs(step) < 1e-12) {
        if (at < low || at > high) to = -1;
        return;
      }
      const double a = (low - at) / step, b = (high - at) / step;
      from = std::max(from, std::min(a, b)), to = std::min(to, std::max(a, b));
    };
    clip(x0, x1 - x0, 0, picture.width - 1.0), clip(y0, y1 - y0, 0, picture.height - 1.0);
    if (from >= to) return;
    const auto at = [&](double a, double b, double t) { return (a + t * (b - a)) * scale; };
    canvas.line(k_gap + at(x0, x1, from), top + at(y0, y1, from), k_gap + at(x0, x1, to),
                top + at(y0, y1, to), colour, thickness);
  };
  for (const auto& s : fit.sides) line(s[0], s[1], s[2], s[3], k_outline, 2);
  for (const auto& e : fit.edges) {
    const double r = 3 / scale;
    if (e.used) {
      line(e.x - r, e.y, e.x + r, e.y, k_halo, 8), line(e.x - r, e.y, e.x + r, e.y, k_used, 5);
    } else {
      line(e.x - 2 * r, e.y - 2 * r, e.x + 2 * r, e.y + 2 * r, k_unused, 3);
      line(e.x - 2 * r, e.y + 2 * r, e.x + 2 * r, e.y - 2 * r, k_unused, 3);
    }
  }
  canvas.write(path);
}

}  // namespace knothe::report
