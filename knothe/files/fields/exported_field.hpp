#pragma once
/// @file Displacement fields as other programs for image correlation export them: one reader for all.
#include <array>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace knothe::files {

/// A point is lost where the value of a column compares so: "sigma < 0".
struct LostRule {
  std::string column;
  std::string compare;  ///< "<", ">", "=" or "!="
  double value = 0;

  [[nodiscard]] bool operator()(double of_point) const;
};
/// "COLUMN < NUMBER". UsageError for anything else.
[[nodiscard]] LostRule lost_rule(const std::string& text);

/// What the user declares of the files: it goes before what a format says.
struct FieldMapping {
  std::string format = "auto";  ///< or one of `field_formats()`, or "table": only what is declared here
  /// Of x, y, u, v, id: the name of the column, "#3" for the third, with a minus before it for its negative.
  std::map<std::string, std::string> columns;
  std::string units;                          ///< of positions and displacements, where the file states none
  std::optional<bool> is_current;             ///< positions are those of the loaded state
  std::optional<bool> is_up;                  ///< y and v point up
  std::optional<std::vector<LostRule>> lost;  ///< in place of the format's rules
  std::vector<double> grid;                   ///< x and y of the first point of a matrix, steps along x and y
};

/// One step of a series. What the file does not say is absent.
struct ExportedField {
  std::string path, format;
  std::vector<double> x, y;  ///< n, or empty: the file has no positions
  std::vector<double> u, v;  ///< n, or empty: the file has no displacements. NaN: the point is lost
  std::vector<std::array<double, 2>> id;         ///< n, or empty: what a point is known by in all files
  std::string position_unit, displacement_unit;  ///< "px" or a length; empty: not said
  std::optional<bool> is_current, is_up;
  std::optional<double> time;  ///< s where the file says a unit
  /// What was measured beside, by the file's names, SI where the file says a unit.
  std::map<std::string, double> scalars;
  std::string lost_by;  ///< how lost points are told, in words

  // Of settle_field:
  double position_factor = 1;  ///< what positions were multiplied by
  std::string found;           ///< what the file was taken for, in words

  [[nodiscard]] std::size_t lost_count() const;
};

/// Names of the formats.
[[nodiscard]] std::vector<std::string> field_formats();

/// The fields of a file: one, but DIC Exchange has all its times. Positions, displacements and units as they
/// stand there. Errors: DataError, with file and line, for what cannot be read, for a format that is not
/// known and for columns that are missing; it says what to declare.
[[nodiscard]] std::vector<ExportedField> read_exported_fields(const std::string& path,
                                                              const FieldMapping& mapping);

/// Brings a field into its common form: px or mm, y and v *down* as in a picture, positions of the reference.
/// `reference`: has the positions that the field lacks, or those that its displacements count from; null:
/// none is given. Errors: DataError that says which key of [data.fields] to give for what nobody has said.
void settle_field(const FieldMapping& mapping, const ExportedField* reference, ExportedField& field);

/// For a MatchID matrix of v, whose values are read with those of u: not a file of its own.
[[nodiscard]] bool is_second_matrix(const std::string& path);

}  // namespace knothe::files
