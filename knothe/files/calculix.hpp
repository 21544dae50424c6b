#pragma once
/// @file Result files of CalculiX: fields on nodes (.frd, ASCII) and printed tables (.dat).
#include <cstdint>
#include <string>
#include <vector>

namespace knothe::files {

/// A field on the nodes at one time.
struct FrdField {
  std::string name;  ///< "DISP", "STRESS"
  double time = 0;
  std::vector<std::string> components;  ///< as the file calls them, without those that it only announces
  std::vector<double> values;           ///< [n, components], 0 at nodes that the file has none of
};

struct FrdContents {
  std::vector<std::int64_t> ids;  ///< [n] of the nodes, in the file's order
  std::vector<double> points;     ///< [n, 3]
  struct Cell {
    int type = 0;                     ///< 1 eight-node brick, 3 four-node tetrahedron, …
    std::vector<std::int64_t> nodes;  ///< indices into `points`
  };
  std::vector<Cell> cells;
  std::vector<FrdField> fields;  ///< in the file's order
};

/// Reads a .frd file as ccx 2 writes it (*NODE FILE, *EL FILE). Binary files, and fields that the file only
/// announces: DataError, with the line.
[[nodiscard]] FrdContents read_frd(const std::string& path);

/// One printed number over time.
struct DatSeries {
  std::string name;  ///< SET.NODE.LABEL ("TIP.12.vx"); of a total SET.LABEL
  std::vector<double> values;
};

struct DatContents {
  std::vector<double> time;
  std::vector<DatSeries> series;
};

/// Reads the tables of *NODE PRINT and *EL PRINT in a .dat file; lines that are no table are passed over.
/// DataError where a table lacks what another time has.
[[nodiscard]] DatContents read_dat(const std::string& path);

}  // namespace knothe::files
