#pragma once
/// @file The formats of exported fields, one function each. Private to this folder.
#include <string>
#include <vector>

#include "knothe/files/fields/exported_field.hpp"
#include "knothe/files/fields/field_text.hpp"

namespace knothe::files {

/// Tables with one point a row and a head: VIC-2D/3D, MatchID, GOM, ARAMIS, DaVis, DICe, OpenCorr, pyvale,
/// SUN-DIC, and whatever columns the user names. `format`: one of `table_formats()`, "table" or "auto".
[[nodiscard]] ExportedField read_columns(const FieldText& file, const FieldMapping& mapping);
[[nodiscard]] std::vector<std::string> table_formats();

[[nodiscard]] ExportedField read_davis_text(FieldText file,
                                            const FieldMapping& mapping);  ///< "#DaVis … 2D-vector"
[[nodiscard]] ExportedField read_aramis_text(FieldText file);  ///< index_x, index_y and three numbers
[[nodiscard]] ExportedField read_matchid_matrix(const std::string& path, const std::vector<double>& grid);
[[nodiscard]] ExportedField read_pyvale_binary(const std::string& path);  ///< .dic2d
[[nodiscard]] ExportedField read_vic_mat(const std::string& path);
[[nodiscard]] ExportedField read_istra(const std::string& path);
[[nodiscard]] std::vector<ExportedField> read_dic_exchange(const std::string& path);

}  // namespace knothe::files
