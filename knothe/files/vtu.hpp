#pragma once
/// @file Fields on meshes for ParaView: VTK's XML files (.vtu), and series of them (.pvd).
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace knothe::files {

/// A field on the points (or cells) of a mesh, `components` numbers each: 1 scalar, 3 vector, 9 tensor.
struct VtuField {
  std::string name;
  std::size_t components = 1;
  std::vector<double> values;  ///< [n, components]
  std::string units = {};      ///< where VTK looks for it, the key UNITS_LABEL; empty: not said
};

/// An unstructured grid of cells of one type.
struct VtuGrid {
  std::span<const double> points;       ///< [n, 3]
  std::span<const std::int64_t> cells;  ///< [c, nodes_per_cell], VTK's vertex order
  std::size_t nodes_per_cell = 8;
  std::string type = "VTK_HEXAHEDRON";  ///< VTK's name of the cell type
  std::vector<VtuField> point_fields;
  std::vector<VtuField> cell_fields;
  std::optional<double> time = std::nullopt;  ///< shown by ParaView as the file's time
};

/// Writes atomically, binary (appended raw, little-endian). A field of the wrong size, a value that is not
/// finite, an unknown cell type: UsageError. Otherwise IoError.
void write_vtu(const VtuGrid& grid, const std::string& path);

/// One file of a series at its time.
struct PvdEntry {
  double time;
  std::string file;  ///< relative to the .pvd
};

/// Writes the series atomically. IoError.
void write_pvd(std::span<const PvdEntry> entries, const std::string& path);

/// A cell type of VTK; `type` 0: none that is known here.
struct VtkCell {
  int type = 0;
  std::string name;        ///< "VTK_QUADRATIC_TETRA"
  std::size_t points = 0;  ///< of a cell
};
[[nodiscard]] VtkCell vtk_cell(std::int64_t type);
/// With or without "VTK_", any case.
[[nodiscard]] VtkCell vtk_cell(const std::string& name);

}  // namespace knothe::files
