#include "knothe/report/figures/displacement_maps.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>

#include "knothe/imaging/crack/strain.hpp"
#include "knothe/numerics/linear/symmetric_eigen.hpp"
#include "knothe/report/figures/canvas.hpp"
#include "knothe/report/figures/colour_map.hpp"

namespace knothe::report {
namespace {

using imaging::ImageMesh;

constexpr int k_panel_width = 640;  // px of the drawing, at most
constexpr int k_head = 28, k_title = 30, k_foot = 46, k_axis = 76, k_bar = 110, k_gap = 16;
constexpr double k_margin = 0.03;   // of the mesh's width, shown around it
constexpr double k_upright = 5e-3;  // rad: a camera turned by less is drawn as if it were not
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
  const auto at = [&](double share) -> double {
    const auto place = seen.begin() + static_cast<std::ptrdiff_t>(share * (seen.size() - 1));
    std::nth_element(seen.begin(), place, seen.end());
    return *place;
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
    for (int a = 0; a < ImageMesh::nodes_of(mesh.elements[e]); ++a)
      for (std::size_t m = 0; m < 4; ++m) c[m] += pixels.coefficients[a][m] * at_node(mesh.elements[e][a]);
    for (const auto& row : table.rows(pixels))
      for (int k = 0; k < row.count; ++k) {
        const auto [x, y] = table.coordinates(pixels, row, k);
        out[picture.index(row.x + k, row.y)] = c[0] + c[1] * x + c[2] * y + c[3] * x * y;
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

/// Round numbers between two, three to seven of them.
std::vector<double> round_numbers(double low, double high) {
  const double raw = (high - low) / 5, power = std::pow(10.0, std::floor(std::log10(raw)));
  const double step = power * (raw > 5 * power ? 10 : raw > 2 * power ? 5 : raw > power ? 2 : 1);
  std::vector<double> numbers;
  for (double k = std::ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; ++k)
    numbers.push_back(k == 0 ? 0.0 : k * step);
  return numbers;
}
/// As many decimals as their differences need.
std::string number_text(double number, const std::vector<double>& among) {
  const double step = among.size() > 1 ? among[1] - among[0] : 1;
  return fmt::format("{:.{}f}", number, std::clamp<int>(std::ceil(-std::log10(step) - 1e-9), 0, 6));
}

void draw_bar(Canvas& canvas, int x, int y, int height, const Map& map) {
  constexpr int k_width = 16;
  for (int j = 0; j < height; ++j) {
    const double fraction = 1 - 1.0 * j / std::max(1, height - 1);
    canvas.fill(x, y + j, k_width, 1, map.has_sign ? blue_white_red(fraction) : viridis(fraction));
  }
  const std::vector<double> numbers = round_numbers(map.low, map.high);
  for (const double number : numbers) {
    const int at = y + height - 1 - std::lround((number - map.low) / (map.high - map.low) * (height - 1));
    canvas.fill(x + k_width / 2, at, k_width / 2, 2,
                k_ink);  // inside the bar: beside it, it would be a minus
    const std::string text = number_text(number, numbers);
    canvas.text(x + k_width + 5, std::clamp(at - 7, y, y + height - 15), text, k_ink,
                text.size() > 6 ? 1 : 2);
  }
}

/// Ticks below and to the left of a map: places in the picture, px, or in the model, mm, where the camera is
/// not turned against it by more than can be seen.
void draw_axes(Canvas& canvas, int left, int top, const View& view,
               const std::optional<imaging::PictureFrame>& frame) {
  const bool in_mm = frame && std::abs(std::arg(frame->slope)) < k_upright;
  const double x1 = view.x0 + view.width / view.scale, y1 = view.y0 + view.height / view.scale;
  const auto place = [&](double x, double y) {
    if (!in_mm) return std::array<double, 2>{x, y};
    const auto p = frame->model_point(x, y);
    const auto c = frame->components();
    return std::array<double, 2>{1e3 * p[c[0]], 1e3 * p[c[1]]};
  };
  const auto from = place(view.x0, view.y0), to = place(x1, y1);
  const char* axes = "xyz";
  const auto name = [&](std::size_t k) {
    return in_mm ? fmt::format("{} mm", axes[frame->components()[k]]) : std::string(k == 0 ? "x px" : "y px");
  };
  const auto along = round_numbers(std::min(from[0], to[0]), std::max(from[0], to[0]));
  for (const double number : along) {
    const int at = left + std::lround((number - from[0]) / (to[0] - from[0]) * (view.width - 1));
    canvas.fill(at, top + view.height, 1, 5, k_ink);
    const std::string text = number_text(number, along);
    const int half = Canvas::text_width(text) / 2;
    if (at + half < left + view.width - Canvas::text_width(name(0)) - 4)
      canvas.text(at - half, top + view.height + 8, text, k_ink);
  }
  canvas.text(left + view.width - Canvas::text_width(name(0)), top + view.height + 8, name(0), k_ink);
  const auto up = round_numbers(std::min(from[1], to[1]), std::max(from[1], to[1]));
  for (const double number : up) {
    const int at = top + std::lround((number - from[1]) / (to[1] - from[1]) * (view.height - 1));
    canvas.fill(left - 5, at, 5, 1, k_ink);
    const std::string text = number_text(number, up);
    if (at - 8 > top + 14) canvas.text(left - 8 - Canvas::text_width(text), at - 8, text, k_ink);
  }
  canvas.text(left - 8 - Canvas::text_width(name(1)), top, name(1), k_ink);
}

void draw_map(Canvas& canvas, int left, int top, const View& view,
              const imaging::ImageCorrelation& correlation, const std::vector<char>& valid, const Map& map,
              const std::optional<imaging::PictureFrame>& frame) {
  const auto& picture = correlation.reference();
  canvas.text(left, top + 6, map.title, k_ink);
  draw_axes(canvas, left, top + k_title, view, frame);
  top += k_title;
  for (int j = 0; j < view.height; ++j)
    for (int i = 0; i < view.width; ++i) {
      const int x = view.x0 + i / view.scale, y = view.y0 + j / view.scale;
      const auto grey =
          static_cast<std::uint8_t>(std::clamp(255 * picture.at(x, y) / picture.maximum, 0.0F, 255.0F));
      canvas.blend(left + i, top + j, {grey, grey, grey});
      const double value = map.values[picture.index(x, y)];
      if (!std::isfinite(value)) continue;
      const double fraction = (value - map.low) / (map.high - map.low);
      canvas.blend(left + i, top + j, map.has_sign ? blue_white_red(fraction) : viridis(fraction), 0.72);
    }
  const ImageMesh& mesh = correlation.mesh();
  for (std::size_t e = 0; e < mesh.elements.size(); ++e) {
    if (valid[e] != 0) continue;
    const int n = ImageMesh::nodes_of(mesh.elements[e]);
    const auto place = [&](int a) {
      const std::size_t node = mesh.elements[e][a % n];
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
    if (p.along < 0) {  // before the crack's origin: a notch
      last = {p.x, p.y};
      continue;
    }
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

/// What was measured and how well, in one line that fits.
std::string head_of(const imaging::PictureSeries& series, const imaging::PictureResult& r, double std,
                    const std::optional<imaging::PictureFrame>& frame) {
  const std::string name = r.picture.substr(r.picture.find_last_of('/') + 1);
  const auto& c = r.correlation;
  std::string text = name + ": ";
  if (r.missing) {
    text += "NOT MEASURED";
  } else {
    text += fmt::format("noise of a displacement {:.4f} px", std);
    if (frame) text += fmt::format(" = {:.2f} um", 1e6 * frame->scale() * std);
  }
  text += fmt::format(", residual {:.2f} levels, {} iterations", c.residual_rms, c.iterations);
  if (c.elements_rejected > 0)
    text += fmt::format(", {} of {} elements out", c.elements_rejected,
                        series.correlation().mesh().element_count());
  if (!r.reference.empty()) text += ", reference replaced";
  return text;
}

/// The key to lines and colours, with what the tip of a crack is.
std::vector<std::string> foot_of(const imaging::PictureResult& r,
                                 const std::optional<imaging::PictureFrame>& frame) {
  std::vector<std::string> lines{
      "red frames: not measured. colours: 1 to 99 % of values. drawn on the reference"};
  if (!r.crack || !r.crack->found) return lines;
  const auto& crack = *r.crack;
  const double unit = frame ? 1e3 * frame->scale() : 1;
  const char* name = frame ? "mm" : "px";
  lines.push_back(
      crack.tip_in_view
          ? fmt::format("yellow: crack, {:.4g} +- {:.2g} {} long. ring: tip, bars: 95 % interval. open at "
                        "the mouth by {:.3g} {}",
                        unit * crack.length, unit * crack.length_std, name,
                        frame ? 1e3 * unit * crack.mouth_opening : crack.mouth_opening, frame ? "um" : name)
          : fmt::format("yellow: crack, right through the field, at least {:.4g} {} long",
                        unit * crack.length, name));
  return lines;
}

Canvas canvas_for(const View& view, int columns, int rows) {
  const int width = k_axis + view.width + k_bar, height = view.height + k_title + 2 * k_gap;
  return {columns * (width + k_gap) + k_gap, k_head + rows * (height + k_gap) + k_gap + k_foot};
}

/// Upper left corner of a panel's title.
std::array<int, 2> corner_of(const View& view, int column, int row) {
  return {k_gap + k_axis + column * (k_axis + view.width + k_bar + k_gap),
          k_gap + k_head + row * (view.height + k_title + 3 * k_gap)};
}

/// Four maps over the reference, with what is to be said above and below them.
void write_four(const std::string& path, const imaging::ImageCorrelation& correlation,
                const std::vector<char>& valid, std::vector<Map> maps, const std::string& head,
                const imaging::PictureResult& result, const std::optional<imaging::PictureFrame>& frame) {
  const View view = view_of(correlation);
  Canvas canvas = canvas_for(view, 2, 2);
  canvas.text(k_gap, k_gap, head, k_ink);
  for (int m = 0; m < 4; ++m) {
    set_range(maps[m]);
    const auto [left, top] = corner_of(view, m % 2, m / 2);
    draw_map(canvas, left, top, view, correlation, valid, maps[m], frame);
    if (result.crack && result.crack->found) draw_crack(canvas, left, top, view, *result.crack);
  }
  int line = canvas.height() - k_foot;
  for (const std::string& text : foot_of(result, frame)) canvas.text(k_gap, line, text, k_ink), line += 20;
  canvas.write(path + ".png");
}

}  // namespace

void write_displacement_maps(const std::string& path, const imaging::PictureSeries& series,
                             const imaging::PictureResult& result, double noise_std,
                             const std::optional<imaging::PictureFrame>& frame) {
  const imaging::ImageCorrelation& correlation = series.correlation();
  const auto& valid = result.correlation.element_valid;
  const Eigen::VectorXd u =
      frame ? Eigen::VectorXd(1e6 * frame->to_model(correlation.mesh(), result.correlation.displacement))
            : result.correlation.displacement;
  const Eigen::MatrixXd strain =
      imaging::nodal_strains(correlation.mesh(), result.correlation.displacement, valid);
  const char* axes = "xyz";
  const auto title = [&](int k) {
    if (frame) return fmt::format("displacement {}, um", axes[frame->components()[k]]);
    return std::string(k == 0 ? "displacement u (right), px" : "displacement v (down), px");
  };
  std::vector<Map> maps;
  for (int k = 0; k < 2; ++k)
    maps.push_back({title(k), over_pixels(correlation, valid, [&](int a) { return u[2 * a + k]; })});
  maps.push_back({"residual, grey levels", correlation.residual_picture(result.correlation), true});
  maps.push_back({"largest principal strain, mm/m", over_pixels(correlation, valid, [&](int a) {
                    return 1e3 * largest_principal(strain, a);
                  })});
  write_four(path, correlation, valid, std::move(maps), head_of(series, result, noise_std, frame), result,
             frame);
}

void write_surface_maps(const std::string& path, const imaging::StereoSeries& series,
                        const imaging::StereoResult& result) {
  const imaging::ImageCorrelation& correlation = series.camera(0).correlation();
  const std::vector<char> valid = series.valid_elements(result);
  const Eigen::MatrixXd strain =
      imaging::surface_strains(series.surface().points, result.motion, correlation.mesh().elements);
  std::vector<Map> maps;
  for (int k = 0; k < 3; ++k)
    maps.push_back({fmt::format("displacement {}, um", "xyz"[k]), over_pixels(correlation, valid, [&](int a) {
                      return 1e6 * result.motion.displacement[3 * a + k];
                    })});
  maps.push_back({"largest principal strain, mm/m", over_pixels(correlation, valid, [&](int a) {
                    const auto e = strain.col(a);
                    Eigen::Matrix3d tensor;
                    tensor << e[0], e[3], e[5], e[3], e[1], e[4], e[5], e[4], e[2];
                    return 1e3 * numerics::SymmetricEigen(tensor).eigenvalues()[2];
                  })});
  const imaging::PictureResult& first = result.pictures.front();
  const double measured = std::count(result.motion.measured.begin(), result.motion.measured.end(), 1);
  write_four(path, correlation, valid, std::move(maps),
             fmt::format("{}: std of a displacement {:.2f} um, cameras contradict each other by {:.3f} px",
                         first.picture.substr(first.picture.find_last_of('/') + 1),
                         1e6 * result.std().sum() / (3 * measured), result.motion.epipolar_rms),
             first, std::nullopt);
}

void write_deviation_maps(const std::string& path, const imaging::PictureSeries& series,
                          const Eigen::VectorXd& std, const std::optional<imaging::PictureFrame>& frame) {
  const imaging::ImageCorrelation& correlation = series.correlation();
  const auto& usable = correlation.usable_elements();
  const View view = view_of(correlation);
  Canvas canvas = canvas_for(view, 2, 1);
  canvas.text(k_gap, k_gap, "predicted standard deviation of displacements, from pattern and noise", k_ink);
  for (int k = 0; k < 2; ++k) {
    Map map{k == 0 ? "std of u (right), px" : "std of v (down), px",
            over_pixels(correlation, usable, [&](int a) { return std[2 * a + k]; })};
    if (frame) {
      map.title = fmt::format("std of displacement {}, um", "xyz"[frame->components()[k]]);
      const float micrometres = 1e6 * frame->scale();
      for (float& v : map.values) v *= micrometres;
    }
    set_range(map);
    const auto [left, top] = corner_of(view, k, 0);
    draw_map(canvas, left, top, view, correlation, usable, map, frame);
  }
  canvas.text(k_gap, canvas.height() - k_foot,
              "red frames: elements without texture. colours span 1 to 99 % of the values", k_ink);
  canvas.write(path + ".png");
}

}  // namespace knothe::report
