#include "knothe/files/vtu.hpp"

#include <fmt/format.h>

#include <bit>
#include <cctype>
#include <cmath>
#include <utility>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/base/text.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/numbers.hpp"

namespace knothe::files {

namespace {

static_assert(std::endian::native == std::endian::little, "VTU files are written as the memory has them");

const std::vector<VtkCell>& vtk_cells() {
  static const std::vector<VtkCell> all = {{1, "VTK_VERTEX", 1},
                                           {3, "VTK_LINE", 2},
                                           {5, "VTK_TRIANGLE", 3},
                                           {9, "VTK_QUAD", 4},
                                           {10, "VTK_TETRA", 4},
                                           {12, "VTK_HEXAHEDRON", 8},
                                           {13, "VTK_WEDGE", 6},
                                           {14, "VTK_PYRAMID", 5},
                                           {21, "VTK_QUADRATIC_EDGE", 3},
                                           {22, "VTK_QUADRATIC_TRIANGLE", 6},
                                           {23, "VTK_QUADRATIC_QUAD", 8},
                                           {24, "VTK_QUADRATIC_TETRA", 10},
                                           {25, "VTK_QUADRATIC_HEXAHEDRON", 20},
                                           {29, "VTK_TRIQUADRATIC_HEXAHEDRON", 27}};
  return all;
}

/// Collects the binary blocks behind the XML, each preceded by its length.
class AppendedData {
 public:
  /// The DataArray element that refers to the block it adds.
  template <class T>
  std::string add(const char* type, const std::string& name, std::size_t components,
                  std::span<const T> values, const std::string& units = {}) {
    const std::string key = units.empty() ? "/>"
                                          : fmt::format(
                                                "><InformationKey name=\"UNITS_LABEL\" "
                                                "location=\"vtkDataArray\">{}</InformationKey></DataArray>",
                                                escape_xml(units));
    const std::string element = fmt::format(
        "        <DataArray type=\"{}\" Name=\"{}\" NumberOfComponents=\"{}\" format=\"appended\" "
        "offset=\"{}\"{}\n",
        type, escape_xml(name), components, bytes_.size(), key);
    const std::uint64_t length = values.size_bytes();
    bytes_.append(reinterpret_cast<const char*>(&length), sizeof length);
    bytes_.append(reinterpret_cast<const char*>(values.data()), length);
    return element;
  }
  [[nodiscard]] const std::string& bytes() const { return bytes_; }

 private:
  std::string bytes_;
};

std::string add_fields(const std::vector<VtuField>& fields, std::size_t entries, const std::string& path,
                       AppendedData& data) {
  std::string xml;
  for (const VtuField& field : fields) {
    if (field.values.size() != entries * field.components) {
      throw UsageError(fmt::format("{}: field {} has {} values, {} x {} are needed", path, field.name,
                                   field.values.size(), entries, field.components));
    }
    for (Index i = 0; i < std::ssize(field.values); ++i) {
      if (!std::isfinite(field.values[i])) {
        throw UsageError(fmt::format("{}: field {}[{},{}] is not finite", path, field.name,
                                     i / field.components, i % field.components));
      }
    }
    xml +=
        data.add("Float64", field.name, field.components, std::span<const double>(field.values), field.units);
  }
  return xml;
}

}  // namespace

VtkCell vtk_cell(std::int64_t type) {
  for (const VtkCell& cell : vtk_cells())
    if (cell.type == type) return cell;
  return {};
}

VtkCell vtk_cell(const std::string& name) {
  std::string upper;
  for (const char c : name) upper += static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
  if (!upper.starts_with("VTK_")) upper.insert(0, "VTK_");
  for (const VtkCell& cell : vtk_cells())
    if (cell.name == upper) return cell;
  return {};
}

void write_vtu(const VtuGrid& grid, const std::string& path) {
  const std::size_t points = grid.points.size() / 3, cells = grid.cells.size() / grid.nodes_per_cell;
  const int type = vtk_cell(grid.type).type;
  if (type == 0) throw UsageError(fmt::format("{}: {} is no cell type of VTK known here", path, grid.type));
  std::vector<std::int64_t> offsets(cells);
  for (std::size_t i = 0; i < cells; ++i) offsets[i] = (i + 1) * grid.nodes_per_cell;
  const std::vector<std::uint8_t> types(cells, static_cast<std::uint8_t>(type));

  AppendedData data;
  std::string xml =
      "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" "
      "byte_order=\"LittleEndian\" header_type=\"UInt64\">\n  <UnstructuredGrid>\n";
  if (grid.time) {
    xml += fmt::format(
        "    <FieldData>\n      <DataArray type=\"Float64\" Name=\"TimeValue\" NumberOfTuples=\"1\" "
        "format=\"ascii\">{}</DataArray>\n    </FieldData>\n",
        format_number(*grid.time));
  }
  xml += fmt::format("    <Piece NumberOfPoints=\"{}\" NumberOfCells=\"{}\">\n", points, cells);
  xml += "      <PointData>\n" + add_fields(grid.point_fields, points, path, data) + "      </PointData>\n";
  xml += "      <CellData>\n" + add_fields(grid.cell_fields, cells, path, data) + "      </CellData>\n";
  xml +=
      "      <Points>\n" + data.add("Float64", "Points", 3, grid.points) + "      </Points>\n      <Cells>\n";
  xml += data.add("Int64", "connectivity", 1, grid.cells);
  xml += data.add("Int64", "offsets", 1, std::span<const std::int64_t>(offsets));
  xml += data.add("UInt8", "types", 1, std::span<const std::uint8_t>(types));
  xml += "      </Cells>\n    </Piece>\n  </UnstructuredGrid>\n  <AppendedData encoding=\"raw\">\n_";
  write_text_atomically(path, xml + data.bytes() + "\n  </AppendedData>\n</VTKFile>\n");
}

void write_pvd(std::span<const PvdEntry> entries, const std::string& path) {
  std::string xml =
      "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"0.1\" byte_order=\"LittleEndian\">\n  "
      "<Collection>\n";
  for (const PvdEntry& entry : entries) {
    xml += fmt::format("    <DataSet timestep=\"{}\" part=\"0\" file=\"{}\"/>\n", format_number(entry.time),
                       escape_xml(entry.file));
  }
  write_text_atomically(path, xml + "  </Collection>\n</VTKFile>\n");
}

}  // namespace knothe::files
