#pragma once
/// @file What other programs write as their solution, read as snapshots of one point.
#include <string>
#include <vector>

#include "knothe/model/compress/snapshots.hpp"

namespace knothe::model {

/// Which file it is, and what the file itself does not say.
struct ResultOptions {
  /// By its ending: .csv (a column time, then a column for each quantity), .npy [n_t, n], .h5
  /// (docs/reference/formats.md, "Snapshots", of one point), .vtu, .pvd, .frd and .dat of CalculiX.
  std::string field;
  /// .vtu, .pvd and .frd: name of the field on the points; empty: the displacement (or the only one).
  std::string quantity;
  /// Further scalars: a CSV file with a column time and one for each; empty: none.
  std::string outputs;
  std::vector<double> times;       ///< where the file has none
  std::string time_units;          ///< likewise
  std::vector<std::string> names;  ///< .npy: of its columns; .dat: those to be taken, all if there are none
  std::vector<std::string> units;  ///< of each name; none: "1"
  std::string points;              ///< .npy: CSV file x,y,z,component of each column, instead of names
};

/// Puts quantities and outputs in known units (mm, kN, …) in SI. DataError for a name that no file can hold,
/// beginning with `where`.
void settle_units(Snapshots& solutions, const std::string& where);
/// Their times are in `units`, unless they have a unit: in s from now on, where it is known.
void state_time_units(Snapshots& solutions, const std::string& units);

/// The solution that a run has left in `folder`, without axes, in SI where its units are known. In CSV a
/// quantity's name may have its unit behind it ("force [kN]"). DataError names file and place.
[[nodiscard]] Snapshots read_result(const ResultOptions& options, const std::string& folder);

}  // namespace knothe::model
