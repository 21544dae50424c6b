#include "knothe/offline/law/regularisation.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"

namespace knothe::offline {

void DamageRegularisationOptions::validate() const {
  const auto positive = [](double value, const char* name) {
    if (!(value > 0) || !std::isfinite(value))
      throw ProjectError(fmt::format("regularised damage: {} is {} m; it must be positive", name, value));
  };
  positive(reference_size, "reference_size");
  positive(internal_length, "internal_length");
}

double band_width(const FiniteElements& elements, std::int64_t cell) {
  double sum = 0;
  for (int a = 0; a < k_nodes_per_cell; ++a) {
    double mean = 0;
    for (int point = 0; point < k_points_per_cell; ++point)
      mean += elements.gradient(cell, point)[a] / k_points_per_cell;
    sum += std::abs(mean);
  }
  return 2 / sum;
}

std::vector<double> band_ratios(const HexahedronMesh& mesh, const FiniteElements& elements,
                                const DamageRegularisationOptions& options) {
  std::vector<double> ratios(mesh.cell_count(), 1.0);
  if (options.kind != DamageRegularisation::crack_band) return ratios;
  for (std::int64_t cell = 0; cell < mesh.cell_count(); ++cell)
    if (mesh.elastic[cell] == 0) ratios[cell] = options.reference_size / band_width(elements, cell);
  return ratios;
}

void check_band(const HexahedronMesh& mesh, const DamageRegularisationOptions& options,
                std::span<const double> ratios, const DamageParameters& parameters) {
  if (options.kind != DamageRegularisation::crack_band) return;
  const double smallest = smallest_band_ratio(parameters);
  for (Index cell = 0; cell < std::ssize(ratios); ++cell)
    if (mesh.elastic[cell] == 0 && ratios[cell] < smallest)
      throw ProjectError(fmt::format(
          "regularised damage: cell {} is {:.4g} m wide; at Y0 = {:.4g} J/m3, Ad = {:.4g} m3/J the crack "
          "band needs cells of at most {:.4g} m (else the stress would have to fall with the strain going "
          "back): take smaller elements, or a smaller box of parameters",
          mesh.names.empty() ? cell : mesh.names[cell], options.reference_size / ratios[cell],
          parameters.threshold, parameters.brittleness, options.reference_size / smallest));
}

double crack_length(const HexahedronMesh& mesh, const FiniteElements& elements,
                    std::span<const double> damage) {
  // Rows of cells that can be damaged, by the height of their centres (rounded to a micrometre).
  std::map<long, double> rows;
  double notch = std::numeric_limits<double>::infinity();
  for (std::int64_t cell = 0; cell < mesh.cell_count(); ++cell) {
    const auto centre = mesh.cell_centre(cell);
    auto& row = rows[std::lround(centre[1] * 1e6)];
    row = std::max(row, damage[cell]);
    // The notch's tip is the lowest face of the cells at mid-span.
    if (std::abs(centre[0]) > 1.01 * band_width(elements, cell) / 2) continue;
    for (int a = 0; a < k_nodes_per_cell; ++a)
      notch = std::min(notch, mesh.points[3 * mesh.cells[8 * cell + a] + 1]);
  }
  double tip = notch, above = 0, below = 0, height = 0;
  bool open = false;
  for (const auto& [micrometres, value] : rows) {
    const double y = 1e-6 * micrometres;
    if (y < notch) continue;
    above = value;
    if (value >= 0.5) {
      open = true;
      tip = y;
    } else if (open) {
      tip = height + (y - height) * (below - 0.5) / (below - above);
      break;
    } else {
      break;
    }
    below = value;
    height = y;
  }
  return tip - notch;
}

}  // namespace knothe::offline
