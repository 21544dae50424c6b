#include "knothe/report/displacement_maps.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>

#include "knothe/imaging/strain.hpp"
#include "knothe/report/canvas.hpp"
#include "knothe/report/colour_map.hpp"

namespace knothe::report {
namespace {

using imaging::ImageMesh;

constexpr int k_panel_width = 640;  // px of the drawing, at most
constexpr int k_title = 30, k_bar = 110, k_gap = 16;
constexpr double k_margin = 0.03;  // of the mesh's width, shown around it
constexpr Rgb k_ink{20, 20, 20}, k_rejected{220, 30, 30}, k_crack{255, 235, 0}, k_halo{0, 0, 0};

/// A number at every pixel of the mesh, and how to paint it.
struct Map {
  std::string title;
  std::vector<float> values;  ///< of the picture's pixels; NaN where there is none
  bool has_sign = false;
  double low = 0, high = 1;
};

/// The range that 98 % of the values fill; symmetric about 0 for one with a sign only if it crosses it.
void set_range(Map& map) {
  std::vector<float> seen;
  for (const float v : map.values)
    if (std::isfinite(v)) seen.push_back(v);
  if (seen.empty()) return;
  const auto at = [&](double share) {
    const auto place =
        seen.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(seen.size() - 1));
    std::nth_element(seen.begin(), place, seen.end());
    return static_cast<double>(*place);
  };
  map.low = at(0.01), map.high = at(0.99);
  if (map.has_sign) map.high = std::max(std::abs(map.low), std::abs(map.high)), map.low = -map.high;
  if (!(map.high - map.low > 1e-9)) map.low -= 0.5e-3, map.high += 0.5e-3;
}

/// Interpolates nodal numbers to the pixels of the valid elements.
std::vector<float> over_pixels(const imaging::ImageCorrelation& correlation, const std::vector<char>& valid,
                               const std::function<double(int)>& at_node) {
  const auto& picture = correlation.reference();
  std::vector<float> out(picture.pixels.size(), std::numeric_limits<float>::quiet_NaN());
  const ImageMesh& mesh = correlation.mesh();
  const auto& table = correlation.pixels();
  for (std::size_t e = 0; e < mesh.elements.size(); ++e) {
    if (valid[e] == 0) continue;
    const auto& pixels = table.elements()[e];
    std::array<double, 4> c{};
    for (std::size_t a = 0; a < static_cast<std::size_t>(ImageMesh::nodes_of(mesh.elements[e])); ++a)
      for (std::size_t m = 0; m < 4; ++m) c[m] += pixels.coefficients[a][m] * at_node(mesh.elements[e][a]);
    for (const auto& row : table.rows(pixels))
      for (int k = 0; k < row.count; ++k) {
        const auto [x, y] = table.coordinates(pixels, row, k);
        out[picture.index(row.x + k, row.y)] = static_cast<float>(c[0] + c[1] * x + c[2] * y + c[3] * x * y);
      }
  }
  return out;
}

/// Part of the picture that is shown, and how large.
struct View {
  double x0 = 0, y0 = 0, scale = 1;  ///< drawing px per picture px
  int width = 0, height = 0;
};

View view_of(const imaging::ImageCorrelation& correlation) {
  const auto bounds = correlation.mesh().bounds();
  const auto& picture = correlation.reference();
  const double margin = std::max(10.0, k_margin * bounds.width());
  View v;
  v.x0 = std::max(0.0, bounds.x0 - margin), v.y0 = std::max(0.0, bounds.y0 - margin);
  const double width = std::min(picture.width - 1.0, bounds.x1 + margin) - v.x0,
               height = std::min(picture.height - 1.0, bounds.y1 + margin) - v.y0;
  v.scale = std::min(2.0, k_panel_width / std::max(width, height));
  v.width = static_cast<int>(width * v.scale) + 1, v.height = static_cast<int>(height * v.scale) + 1;
  return v;
}

void draw_bar(Canvas& canvas, int x, int y, int height, const Map& map) {
  constexpr int k_width = 16;
  for (int j = 0; j < height; ++j) {
    const double fraction = 1 - static_cast<double>(j) / std::max(1, height - 1);
    canvas.fill(x, y + j, k_width, 1, rgb_of(map.has_sign ? blue_white_red(fraction) : viridis(fraction)));
  }
  const int decimals = std::clamp(2 - static_cast<int>(std::floor(std::log10(map.high - map.low))), 0, 6);
  for (int tick = 0; tick <= 4; ++tick) {
    const int at = y + height - 1 - tick * (height - 1) / 4;
    canvas.fill(x + k_width, at, 4, 1, k_ink);
    const std::string number = fmt::format("{:.{}f}", map.low + (map.high - map.low) * tick / 4, decimals);
    canvas.text(x + k_width + 7, std::clamp(at - 7, y, y + height - 15), number, k_ink,
                number.size() > 6 ? 1 : 2);
  }
}

void draw_map(Canvas& canvas, int left, int top, const View& view,
              const imaging::ImageCorrelation& correlation, const std::vector<char>& valid, const Map& map) {
  const auto& picture = correlation.reference();
  canvas.text(left, top + 6, map.title, k_ink);
  top += k_title;
  for (int j = 0; j < view.height; ++j)
    for (int i = 0; i < view.width; ++i) {
      const int x = static_cast<int>(view.x0 + i / view.scale),
                y = static_cast<int>(view.y0 + j / view.scale);
      const auto grey =
          static_cast<std::uint8_t>(std::clamp(255 * picture.at(x, y) / picture.maximum, 0.0F, 255.0F));
      canvas.blend(left + i, top + j, {grey, grey, grey});
      const auto value = static_cast<double>(map.values[picture.index(x, y)]);
      if (!std::isfinite(value)) continue;
      const double fraction = (value - map.low) / (map.high - map.low);
      canvas.blend(left + i, top + j, rgb_of(map.has_sign ? blue_white_red(fraction) : viridis(fraction)),
                   0.72);
    }
  const ImageMesh& mesh = correlation.mesh();
  for (std::size_t e = 0; e < mesh.elements.size(); ++e) {
    if (valid[e] != 0) continue;
    const int n = ImageMesh::nodes_of(mesh.elements[e]);
    const auto place = [&](int a) {
      const auto node = static_cast<std::size_t>(mesh.elements[e][static_cast<std::size_t>(a % n)]);
      return std::array<double, 2>{left + (mesh.x[node] - view.x0) * view.scale,
                                   top + (mesh.y[node] - view.y0) * view.scale};
    };
    for (int a = 0; a < n; ++a)
      canvas.line(place(a)[0], place(a)[1], place(a + 1)[0], place(a + 1)[1], k_rejected, 1);
  }
  draw_bar(canvas, left + view.width + 8, top, view.height, map);
}

/// The crack's path from its mouth to its tip, a ring about the tip, and bars across the path where the 95 %
/// interval of the tip begins and ends; yellow on black, so that it shows on any colour.
void draw_crack(Canvas& canvas, int left, int top, const View& view, const imaging::CrackMeasurement& crack) {
  const auto place = [&](const std::array<double, 2>& p) {
    return std::array<double, 2>{left + (p[0] - view.x0) * view.scale,
                                 top + k_title + (p[1] - view.y0) * view.scale};
  };
  const auto stroke = [&](const std::array<double, 2>& p, const std::array<double, 2>& q) {
    const auto a = place(p), b = place(q);
    canvas.line(a[0], a[1], b[0], b[1], k_halo, 4);
    canvas.line(a[0], a[1], b[0], b[1], k_crack, 2);
  };
  std::array<double, 2> last = crack.mouth;
  for (const auto& p : crack.path) {
    if (crack.tip_in_view && p.along >= crack.length) break;
    stroke(last, {p.x, p.y});
    last = {p.x, p.y};
  }
  if (!crack.tip_in_view) return;
  stroke(last, crack.tip);
  const double ring = 7 / view.scale;
  for (int k = 0; k < 24; ++k) {
    const double a = k * std::numbers::pi / 12, b = (k + 1) * std::numbers::pi / 12;
    stroke({crack.tip[0] + ring * std::cos(a), crack.tip[1] + ring * std::sin(a)},
           {crack.tip[0] + ring * std::cos(b), crack.tip[1] + ring * std::sin(b)});
  }
  for (const double end : crack.interval)
    for (std::size_t i = 1; i < crack.path.size(); ++i) {
      const auto &p = crack.path[i - 1], &q = crack.path[i];
      if (p.along > end || q.along <= end) continue;
      const double share = (end - p.along) / (q.along - p.along), size = std::hypot(q.x - p.x, q.y - p.y);
      const double x = p.x + share * (q.x - p.x), y = p.y + share * (q.y - p.y);
      const double nx = -(q.y - p.y) / size * ring, ny = (q.x - p.x) / size * ring;
      stroke({x - nx, y - ny}, {x + nx, y + ny});
    }
}

double largest_principal(const Eigen::MatrixXd& strain, int node) {
  const double mean = 0.5 * (strain(node, 0) + strain(node, 1)),
               half = 0.5 * (strain(node, 0) - strain(node, 1));
  return mean + std::hypot(half, strain(node, 2));
}

}  // namespace

void write_displacement_maps(const std::string& path, const imaging::PictureSeries& series,
                             const imaging::PictureResult& result,
                             const std::optional<imaging::PictureFrame>& frame) {
  const imaging::ImageCorrelation& correlation = series.correlation();
  const auto& valid = result.correlation.element_valid;
  const Eigen::VectorXd u = frame ? Eigen::VectorXd(1e6 * frame->to_model(result.correlation.displacement))
                                  : result.correlation.displacement;
  const Eigen::MatrixXd strain =
      imaging::nodal_strains(correlation.mesh(), result.correlation.displacement, valid);
  const char* axes = "xyz";
  const auto title = [&](int k) {
    if (frame)
      return fmt::format("displacement {}, um", axes[frame->components()[static_cast<std::size_t>(k)]]);
    return std::string(k == 0 ? "displacement u (right), px" : "displacement v (down), px");
  };
  std::vector<Map> maps;
  for (int k = 0; k < 2; ++k)
    maps.push_back({title(k), over_pixels(correlation, valid, [&](int a) { return u[2 * a + k]; })});
  maps.push_back({"residual, grey levels", correlation.residual_picture(result.correlation), true});
  maps.push_back({"largest principal strain, per mille", over_pixels(correlation, valid, [&](int a) {
                    return 1e3 * largest_principal(strain, a);
                  })});
  const View view = view_of(correlation);
  const int width = view.width + k_bar, height = view.height + k_title;
  Canvas canvas(2 * width + 3 * k_gap, 2 * height + 3 * k_gap);
  for (int m = 0; m < 4; ++m) {
    set_range(maps[static_cast<std::size_t>(m)]);
    draw_map(canvas, k_gap + m % 2 * (width + k_gap), k_gap + m / 2 * (height + k_gap), view, correlation,
             valid, maps[static_cast<std::size_t>(m)]);
    if (result.crack && result.crack->found)
      draw_crack(canvas, k_gap + m % 2 * (width + k_gap), k_gap + m / 2 * (height + k_gap), view,
                 *result.crack);
  }
  canvas.write(path + ".png");
}

void write_deviation_maps(const std::string& path, const imaging::PictureSeries& series,
                          const Eigen::VectorXd& std) {
  const imaging::ImageCorrelation& correlation = series.correlation();
  const auto& usable = correlation.usable_elements();
  const View view = view_of(correlation);
  const int width = view.width + k_bar, height = view.height + k_title;
  Canvas canvas(2 * width + 3 * k_gap, height + 2 * k_gap);
  for (int k = 0; k < 2; ++k) {
    Map map{k == 0 ? "std of u (right), px" : "std of v (down), px",
            over_pixels(correlation, usable, [&](int a) { return std[2 * a + k]; })};
    set_range(map);
    draw_map(canvas, k_gap + k * (width + k_gap), k_gap, view, correlation, usable, map);
  }
  canvas.write(path + ".png");
}

}  // namespace knothe::report
