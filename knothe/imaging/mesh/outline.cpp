#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <map>
#include <numbers>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/imaging/mesh/outline_registration.hpp"
#include "knothe/numerics/statistics/order_statistics.hpp"

namespace knothe::imaging {

namespace {

using Complex = std::complex<double>;

constexpr double k_in_line = 1e-3;        // sine of the turn between edges that are one side
constexpr int k_cell = 4;                 // px: of the small picture in which the body is looked for
constexpr double k_separation = 0.5;      // share of the variance that two classes must explain
constexpr double k_smallest_body = 0.01;  // of the picture

bool in_line(Complex a, Complex b) {
  return std::abs(std::imag(std::conj(a) * b)) < k_in_line * std::abs(a) * std::abs(b) &&
         std::real(std::conj(a) * b) > 0;
}
Complex place(const std::array<double, 2>& p) {
  return {p[0], p[1]};
}

/// Joins the sides of a closed chain that lie in one line.
void add_joined(const std::vector<std::array<double, 2>>& corners, Outline& outline) {
  const std::size_t n = corners.size();
  const auto turn = [&](std::size_t i) {
    return !in_line(place(corners[i]) - place(corners[(i + n - 1) % n]),
                    place(corners[(i + 1) % n]) - place(corners[i]));
  };
  std::vector<std::size_t> kept;
  for (std::size_t i = 0; i < n; ++i)
    if (turn(i)) kept.push_back(i);
  for (Index k = 0; k < std::ssize(kept); ++k)
    outline.push_back({corners[kept[k]], corners[kept[(k + 1) % kept.size()]]});
}

/// Area, centre and direction of the longer axis of a plane figure.
struct Moments {
  double area = 0;
  Complex centre;
  double axis = 0;        ///< rad
  double elongation = 1;  ///< ratio of the principal second moments
};
Moments moments_of(double area, Complex first, double xx, double xy, double yy) {
  Moments m;
  m.area = area, m.centre = first / area;
  xx = xx / area - std::pow(m.centre.real(), 2), yy = yy / area - std::pow(m.centre.imag(), 2);
  xy = xy / area - m.centre.real() * m.centre.imag();
  m.axis = 0.5 * std::atan2(2 * xy, xx - yy);
  const double half = std::hypot(0.5 * (xx - yy), xy), mean = 0.5 * (xx + yy);
  m.elongation = (mean + half) / std::max(mean - half, 1e-12 * mean);
  return m;
}

Moments moments_of(const Outline& outline) {
  double area = 0, xx = 0, xy = 0, yy = 0;
  Complex first;
  for (const auto& s : outline) {  // Green's formula
    const double x0 = s.from[0], y0 = s.from[1], x1 = s.to[0], y1 = s.to[1], c = x0 * y1 - x1 * y0;
    area += c / 2;
    first += Complex(x0 + x1, y0 + y1) * c / 6.0;
    xx += c * (x0 * x0 + x0 * x1 + x1 * x1) / 12, yy += c * (y0 * y0 + y0 * y1 + y1 * y1) / 12;
    xy += c * (x0 * y1 + 2 * x0 * y0 + 2 * x1 * y1 + x1 * y0) / 24;
  }
  return moments_of(area, first, xx, xy, yy);
}

/// A small picture of one property: mean grey level, or how much it varies.
struct Property {
  int width = 0, height = 0;
  std::vector<double> value;
};
std::array<Property, 2> properties_of(const files::Picture& picture) {
  std::array<Property, 2> p;
  for (auto& one : p) one.width = picture.width / k_cell, one.height = picture.height / k_cell;
  for (int j = 0; j < p[0].height; ++j)
    for (int i = 0; i < p[0].width; ++i) {
      double sum = 0, squares = 0, n = 0;
      for (int y = std::max(0, j * k_cell - k_cell); y < std::min(picture.height, (j + 2) * k_cell); ++y)
        for (int x = std::max(0, i * k_cell - k_cell); x < std::min(picture.width, (i + 2) * k_cell); ++x) {
          const double v = picture.at(x, y);
          sum += v, squares += v * v, n += 1;
        }
      p[0].value.push_back(sum / n);
      p[1].value.push_back(std::sqrt(std::max(0.0, squares / n - (sum / n) * (sum / n))));
    }
  return p;
}

/// The largest connected part of the cells that differ from the border; empty if there is none.
std::vector<std::array<int, 2>> largest_part(const Property& p, double threshold) {
  int above = 0, border = 0;
  const auto is_high = [&](int i, int j) { return p.value[j * p.width + i] > threshold; };
  for (int i = 0; i < p.width; ++i) above += is_high(i, 0) + is_high(i, p.height - 1), border += 2;
  for (int j = 0; j < p.height; ++j) above += is_high(0, j) + is_high(p.width - 1, j), border += 2;
  const bool body_is_high = 2 * above < border;
  std::vector<char> seen(p.value.size(), 0);
  std::vector<std::array<int, 2>> best;
  for (int j = 0; j < p.height; ++j)
    for (int i = 0; i < p.width; ++i) {
      if (seen[j * p.width + i] != 0 || is_high(i, j) != body_is_high) continue;
      std::vector<std::array<int, 2>> part{{i, j}};
      seen[j * p.width + i] = 1;
      for (Index k = 0; k < std::ssize(part); ++k)
        for (const auto& [di, dj] :
             {std::array{1, 0}, std::array{-1, 0}, std::array{0, 1}, std::array{0, -1}}) {
          const int a = part[k][0] + di, b = part[k][1] + dj;
          if (a < 0 || b < 0 || a >= p.width || b >= p.height) continue;
          char& there = seen[b * p.width + a];
          if (there == 0 && is_high(a, b) == body_is_high) there = 1, part.push_back({a, b});
        }
      if (part.size() > best.size()) best = std::move(part);
    }
  return best;
}

}  // namespace

Outline polygon_outline(const std::vector<std::array<double, 2>>& corners) {
  if (corners.size() < 3)
    throw UsageError(fmt::format("the outline has {} corners: a polygon has at least three", corners.size()));
  Outline outline;
  add_joined(corners, outline);
  const double area = outline.size() < 3 ? 0 : moments_of(outline).area;
  double longest = 0;
  for (const auto& s : outline) longest = std::max(longest, std::abs(place(s.to) - place(s.from)));
  if (!(std::abs(area) > 1e-6 * longest * longest))
    throw UsageError("the outline has no area: its corners must go round the body, one after the other");
  if (area < 0)
    for (OutlineSide& s : outline) std::swap(s.from, s.to);
  return outline;
}

Outline outline_of(const ImageMesh& mesh) {
  std::map<std::array<int, 2>, int> count;
  for (const auto& nodes : mesh.elements) {
    const int n = ImageMesh::nodes_of(nodes);
    for (int a = 0; a < n; ++a) {
      const int p = nodes[a], q = nodes[(a + 1) % n];
      ++count[{std::min(p, q), std::max(p, q)}];
    }
  }
  // With y down an element whose nodes go round with a positive area has its inside to the right of an edge,
  // seen with y up: edges are taken backwards, so that the body is on their left.
  std::multimap<int, int> next;
  for (const auto& nodes : mesh.elements) {
    const int n = ImageMesh::nodes_of(nodes);
    double area = 0;
    for (int a = 0; a < n; ++a) {
      const std::size_t p = nodes[a], q = nodes[(a + 1) % n];
      area += mesh.x[p] * mesh.y[q] - mesh.x[q] * mesh.y[p];
    }
    for (int a = 0; a < n; ++a) {
      const int p = nodes[a], q = nodes[(a + 1) % n];
      if (count[{std::min(p, q), std::max(p, q)}] != 1) continue;
      if (area > 0)
        next.emplace(q, p);
      else
        next.emplace(p, q);
    }
  }
  Outline outline;
  while (!next.empty()) {
    std::vector<std::array<double, 2>> corners;
    int node = next.begin()->first;
    for (auto at = next.find(node); at != next.end(); at = next.find(node)) {
      corners.push_back({mesh.x[node], -mesh.y[node]});
      node = at->second;
      next.erase(at);
    }
    if (corners.size() >= 3) add_joined(corners, outline);
  }
  return outline;
}

PictureFrame outline_start(const files::Picture& picture, const Outline& outline, const std::string& name) {
  const auto properties = properties_of(picture);
  const std::array classes = {numerics::two_classes(properties[0].value),
                              numerics::two_classes(properties[1].value)};
  const std::size_t kind = classes[1].explained > classes[0].explained ? 1 : 0;
  const Property& p = properties[kind];
  const auto part = largest_part(p, classes[kind].threshold);
  const double cells = p.value.size();
  const std::string remedy =
      "give \"dic.scale\" and \"dic.origin\", or \"dic.pixels\" and \"dic.points\", accurate to about 20 px, "
      "as initial values";
  if (classes[kind].explained < k_separation || part.size() < k_smallest_body * cells)
    throw DataError(fmt::format("{}: error: no body stands out from what is behind it: {}", name, remedy));
  double xx = 0, xy = 0, yy = 0;
  Complex first;
  for (const auto& [i, j] : part) {
    if (i == 0 || j == 0 || i == p.width - 1 || j == p.height - 1)
      throw DataError(fmt::format("{}: error: the body reaches out of the picture: {}", name, remedy));
    const double x = (i + 0.5) * k_cell - 0.5, y = -((j + 0.5) * k_cell - 0.5);
    first += Complex(x, y), xx += x * x, xy += x * y, yy += y * y;
  }
  const Moments seen = moments_of(part.size(), first, xx, xy, yy), model = moments_of(outline);
  double turn = 0;  // from the model to the picture; a body without a longer axis is taken for upright
  if (std::min(seen.elongation, model.elongation) > 1.2)
    turn = std::remainder(seen.axis - model.axis, std::numbers::pi);
  const double scale = std::sqrt(model.area / (seen.area * k_cell * k_cell));  // m per px
  PictureFrame frame;
  frame.slope = std::polar(scale, -turn);
  frame.offset = model.centre - frame.slope * seen.centre;
  return frame;
}

}  // namespace knothe::imaging
