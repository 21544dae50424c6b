#include "knothe/offline/mesh/beam_mesh.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/offline/mesh/structured_grid.hpp"

namespace knothe::offline {
namespace {

constexpr double k_near = 1e-7;  // m; far below any element, far above rounding

std::size_t whole(double ratio) {
  return std::max(1.0, std::round(ratio));
}

/// x ≥ 0 half of the grid: notch or middle column(s), fine mesh, graded to the support and on to the end.
std::vector<double> positive_positions(const BeamOptions& options, double half_notch) {
  std::vector<double> x;
  const auto columns = whole(2 * half_notch / options.element);
  for (std::size_t i = 0; i <= columns; ++i) {
    const double position = -half_notch + 2 * half_notch * i / columns;
    if (position > -k_near) x.push_back(std::max(position, 0.0));
  }
  const auto append = [&x](const std::vector<double>& positions) {
    x.insert(x.end(), positions.begin() + 1, positions.end());
  };
  // Whole elements up to the first position at or beyond the refined half width.
  const double count = std::ceil((options.refined_half_width - half_notch) / options.element - 1e-6);
  const double refined = half_notch + std::max(count, 1.0) * options.element;
  append(uniform_positions(half_notch, refined, whole(count)));
  append(
      graded_positions(refined, options.support, options.element, options.growth, options.largest_element));
  append(graded_positions(options.support, options.length / 2, options.largest_element, 1.0,
                          options.largest_element));
  return x;
}

}  // namespace

void BeamOptions::validate() const {
  const auto refuse = [](const std::string& why) { throw ProjectError("beam: " + why); };
  const auto positive = [&](double value, const char* name) {
    if (!(value > 0) || !std::isfinite(value))
      refuse(fmt::format("{} is {}; it must be positive (in m)", name, value));
  };
  positive(length, "length");
  positive(height, "height");
  positive(half_thickness, "half_thickness");
  positive(element, "element");
  positive(notch_width, "notch_width");
  positive(largest_element, "largest_element");
  if (layers < 1 || layers > 100) refuse(fmt::format("layers is {}; it must be from 1 to 100", layers));
  if (element > height / 4)
    refuse(fmt::format("element is {} m; the height of {} m needs at least four elements", element, height));
  if (element < height / 400)
    refuse(fmt::format("element is {} m, more than 400 over the height; did you mean metres?", element));
  if (!(notch_depth >= 0) || notch_depth > height - 2 * element)
    refuse(fmt::format("notch_depth is {} m; it must leave two elements of the height of {} m", notch_depth,
                       height));
  if (!(growth >= 1.0 && growth <= 3.0)) refuse(fmt::format("growth is {}; it must be from 1 to 3", growth));
  if (largest_element < element)
    refuse(fmt::format("largest_element is {} m, less than element, {} m", largest_element, element));
  if (!(support < length / 2))
    refuse(fmt::format("support is {} m; the beam ends at {} m", support, length / 2));
  const double half_notch = std::max(notch_width, element) / 2;
  if (!(refined_half_width > half_notch) || refined_half_width + 2 * element > support)
    refuse(
        fmt::format("refined_half_width is {} m; it must be between the notch ({} m) and the supports ({} m)",
                    refined_half_width, half_notch, support));
  if (!(load_half_width >= 0 && load_half_width < refined_half_width))
    refuse(fmt::format("load_half_width is {} m; it must be inside the refined part ({} m)", load_half_width,
                       refined_half_width));
  if (!(protected_half_width >= 0) || !(protected_depth >= 0 && protected_depth < height))
    refuse(fmt::format(
        "protected_half_width and protected_depth are {} and {} m; they must be 0 or positive, the depth "
        "less than the height",
        protected_half_width, protected_depth));
  if (!(support_stiffness >= 0) || !std::isfinite(support_stiffness))
    refuse(fmt::format("support_stiffness is {} N/m; it must be positive, or 0 for rigid supports",
                       support_stiffness));
  if (!(std::abs(load_offset) <= 0.01))
    refuse(fmt::format("load_offset is {} m; it must be within 0.01 m of mid-span", load_offset));
}

BeamGrid beam_grid(const BeamOptions& options) {
  options.validate();
  BeamGrid grid;
  // A notch narrower than an element is one element wide.
  grid.notch_half_width = std::max(options.notch_width, options.element) / 2;
  const std::vector<double> right = positive_positions(options, grid.notch_half_width);
  for (auto position = right.rbegin(); position != right.rend(); ++position)
    if (*position > k_near) grid.x.push_back(-*position);
  grid.x.insert(grid.x.end(), right.begin(), right.end());

  if (options.notch_depth > k_near) {
    grid.y = uniform_positions(0, options.notch_depth, whole(options.notch_depth / options.element));
    grid.notch_depth = options.notch_depth;
    grid.y.pop_back();
  }
  const auto above = uniform_positions(grid.notch_depth, options.height,
                                       whole((options.height - grid.notch_depth) / options.element));
  grid.y.insert(grid.y.end(), above.begin(), above.end());
  grid.z = uniform_positions(0, options.half_thickness, options.layers);
  return grid;
}

void mark_beam(HexahedronMesh& mesh, const BeamOptions& options) {
  const auto near = [](double a, double b) { return std::abs(a - b) < k_near; };
  mesh.support_left =
      nodes_where(mesh, [&](double x, double y, double) { return near(x, -options.support) && near(y, 0); });
  mesh.support_right =
      nodes_where(mesh, [&](double x, double y, double) { return near(x, options.support) && near(y, 0); });
  // At least the upper nodes nearest to mid-span: with very large elements none is inside the strip.
  double strip = options.length;
  for (const auto node : nodes_where(mesh, [&](double, double y, double) { return near(y, options.height); }))
    strip = std::min(strip, std::abs(mesh.points[3 * node]));
  strip = std::max(strip, options.load_half_width) + k_near;
  mesh.load = nodes_where(
      mesh, [&](double x, double y, double) { return near(y, options.height) && std::abs(x) < strip; });
  mesh.symmetry = nodes_where(mesh, [&](double, double, double z) { return near(z, 0); });
  mesh.left_face = nodes_where(mesh, [&](double x, double, double) { return near(x, -options.length / 2); });
  mesh.left_support = options.left_support;
  find_crack_mouth(mesh);
}

namespace {

/// Shears the mesh: the whole offset at the load strip, none below 0.6 of the height and at the border of the
/// refined part.
void shift_load(HexahedronMesh& mesh, const BeamOptions& options) {
  const double whole_width = std::min(0.02, 0.5 * options.refined_half_width), none = 0.6 * options.height;
  for (std::int64_t node = 0; node < mesh.node_count(); ++node) {
    double& x = mesh.points[3 * node];
    const double y = mesh.points[3 * node + 1];
    const double along = std::clamp(
        (options.refined_half_width - std::abs(x)) / (options.refined_half_width - whole_width), 0.0, 1.0);
    x += options.load_offset * along * std::clamp((y - none) / (options.height - none), 0.0, 1.0);
  }
}

}  // namespace

HexahedronMesh beam_mesh(const BeamOptions& options) {
  const BeamGrid grid = beam_grid(options);
  HexahedronMesh mesh = structured_grid(grid.x, grid.y, grid.z, [&](const std::array<double, 3>& centre) {
    return !(std::abs(centre[0]) < grid.notch_half_width && centre[1] < grid.notch_depth);
  });
  mark_beam(mesh, options);
  const double upper_row = (grid.y[grid.y.size() - 2] + options.height) / 2;
  const double protected_from = std::min(options.height - options.protected_depth, upper_row) - k_near;
  for (std::int64_t cell = 0; cell < mesh.cell_count(); ++cell) {
    const auto centre = mesh.cell_centre(cell);
    const bool outside = std::abs(centre[0]) > options.refined_half_width;
    const bool under_load = centre[1] > protected_from && std::abs(centre[0]) < options.protected_half_width;
    mesh.elastic[cell] = outside || under_load ? 1 : 0;
  }
  mesh.support_stiffness = options.support_stiffness / 2;
  if (options.load_offset != 0) shift_load(mesh, options);
  validate(mesh, "beam");
  return mesh;
}

}  // namespace knothe::offline
