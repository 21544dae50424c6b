#include "knothe/files/fields/exported_field.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <zlib.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <functional>

#include "knothe/base/error.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/fields/field_text.hpp"
#include "knothe/files/hdf5.hpp"
#include "knothe/files/testing/recorded_data.hpp"
#include "knothe/files/testing/test_folder.hpp"

namespace knothe::files {
namespace {

/// The plate of all these tests: u = 0.01 x, v = -0.003 y (mm, y up) on 5 × 3 points, of which two are lost.
struct PlatePoint {
  double x, y;
  [[nodiscard]] double u() const { return 0.01 * x; }
  [[nodiscard]] double v() const { return -0.003 * y; }
  [[nodiscard]] bool lost() const { return (x == 10 && y == 5) || (x == 20 && y == 10); }
};

std::vector<PlatePoint> plate() {
  std::vector<PlatePoint> points;
  for (const double y : {10, 5, 0})
    for (const double x : {0, 5, 10, 15, 20}) points.push_back({x, y});
  return points;
}

/// A settled field back in mm with y up: x, y, u, v of each point that is not lost.
std::vector<std::array<double, 4>> in_mm(const ExportedField& field) {
  const bool pixels = field.position_unit == "px";
  const double mm = field.displacement_unit == "px" ? 0.05 : 1;
  std::vector<std::array<double, 4>> points;
  for (std::size_t i = 0; i < field.x.size(); ++i) {
    if (std::isnan(field.u[i])) continue;
    const double x = pixels ? 0.05 * (field.x[i] - 100) : field.x[i],
                 y = pixels ? 0.05 * (350 - field.y[i]) : -field.y[i];
    points.push_back({x, y, mm * field.u[i], -mm * field.v[i]});
  }
  return points;
}

void expect_plate(const ExportedField& field, const std::function<bool(const PlatePoint&)>& lost,
                  double load = 1) {
  const auto points = in_mm(field);
  std::size_t found = 0;
  for (const PlatePoint& wanted : plate()) {
    if (lost(wanted)) continue;
    const auto same = std::find_if(points.begin(), points.end(), [&](const auto& p) {
      return std::hypot(p[0] - wanted.x, p[1] - wanted.y) < 1e-6;
    });
    ASSERT_NE(same, points.end()) << field.path << ": no point at " << wanted.x << ", " << wanted.y;
    EXPECT_NEAR((*same)[2], load * wanted.u(), 1e-6) << field.path << " at " << wanted.x << ", " << wanted.y;
    EXPECT_NEAR((*same)[3], load * wanted.v(), 1e-6) << field.path << " at " << wanted.x << ", " << wanted.y;
    ++found;
  }
  EXPECT_EQ(points.size(), found) << field.path << ": points that are lost have numbers";
}

bool two_lost(const PlatePoint& point) {
  return point.lost();
}

class ExportedFields : public ::testing::Test {
 protected:
  ExportedField read(const std::string& name, const std::string& bytes, FieldMapping mapping = {}) {
    const std::string path = folder_.file(name);
    write_text_atomically(path, bytes);
    ExportedField field = read_exported_fields(path, mapping).back();
    settle_field(mapping, nullptr, field);
    return field;
  }
  /// What is said of a file that is refused.
  std::string complaint(const std::string& name, const std::string& bytes, FieldMapping mapping = {}) {
    try {
      (void)read(name, bytes, mapping);
    } catch (const DataError& error) {
      return error.what();
    }
    return "read";
  }
  TestFolder folder_;
};

FieldMapping in_unit(const std::string& unit) {
  FieldMapping mapping;
  mapping.units = unit;
  return mapping;
}

// The samples in shared/cases/exports, made by hand from public sources, with their truth.

struct Sample {
  const char* file;
  FieldMapping mapping = {};
  const char* reference = "";
  std::optional<double> time = {};
  std::map<std::string, double> scalars = {};
};

std::vector<Sample> samples() {
  FieldMapping mm = in_unit("mm"), mm_up = mm, up, down, matrix = mm;
  mm_up.is_up = up.is_up = true;
  down.is_up = matrix.is_up = false;
  matrix.grid = {0, -10, 5, 5};
  FieldMapping points = in_unit("");
  return {{"vic3d_csv/plate-0007_0.csv", mm},
          {"vic2d_csv/plate_0007.csv", mm_up},
          {"vic_mat/plate-0007_0.mat", mm},
          {"matchid_2023/B0010_0.tif.csv", mm},
          {"matchid_2024/Image_0007_0.tiff.csv", {}, "", 7, {{"ext.Force", 812.5}}},
          {"matchid_matrix/plate_0007_0.tif_U[mm].csv", matrix},
          {"gom_csv/Flaechenkomponente 1_12.500 s.csv", {}, "", 12.5},
          {"gom_points_csv/plate_T1_0026.csv", points, "gom_points_csv/plate_T1_0001.csv"},
          {"aramis_nodemap/plate_demo_dic_results_0_26.txt", {}, "", 12.5, {{"force", 812.5}}},
          {"aramis_v6_txt/displ-Stage-0-26.txt",
           mm_up,
           "aramis_v6_txt/undeformed_coords-Stage-0-0.txt",
           12.5,
           {{"AD-0", 1.625}}},
          {"davis_csv/B0010.csv"},
          {"dice_txt/DICe_solution_07.txt"},
          {"dice_txt_space/DICe_solution_07.txt"},
          {"opencorr_csv/plate_07_fftcc_icgn1_r16.csv"},
          {"pyvale_csv/dic_results_plate_0007.csv"},
          {"pyvale_dic2d/dic_results_plate_0007.dic2d"},
          {"sundic_csv/plate_pair_7.csv"},
          {"istra4d_hdf5/series_step_10.hdf5", {}, "", {}, {{"Force", 812.5}}},
          {"dic_exchange_hdf5/plate.h5", mm, "", 12.5, {{"force", 812.5}}}};
}

TEST_F(ExportedFields, EverySampleIsReadAsItsTruthSays) {
  const std::string folder = recorded_data("../cases/exports");
  if (!std::filesystem::exists(folder))
    GTEST_SKIP() << folder << " is not there: set KNOTHE_DATA to the folder of recorded data beside it";
  for (const Sample& sample : samples()) {
    SCOPED_TRACE(sample.file);
    ExportedField field = read_exported_fields(folder + sample.file, sample.mapping).back();
    std::optional<ExportedField> reference;
    if (*sample.reference != '\0')
      reference = read_exported_fields(folder + sample.reference, sample.mapping).front();
    settle_field(sample.mapping, reference ? &*reference : nullptr, field);
    expect_plate(field, two_lost);
    EXPECT_EQ(field.time, sample.time);
    for (const auto& [name, value] : sample.scalars) EXPECT_DOUBLE_EQ(field.scalars[name], value) << name;
  }
}

TEST_F(ExportedFields, StepsAtRestAndStagesWithoutDisplacementsOfTheSamples) {
  const std::string folder = recorded_data("../cases/exports");
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << folder << " is not there";
  const auto none_lost = [](const PlatePoint&) { return false; };
  for (const char* const file : {"gom_csv/Flaechenkomponente 1_0.000 s.csv",
                                 "matchid_2024/Image_0000_0.tiff.csv", "istra4d_hdf5/series_step_2.hdf5"}) {
    ExportedField field = read_exported_fields(folder + file, {}).back();
    settle_field({}, nullptr, field);
    expect_plate(field, none_lost, 0);
  }
  FieldMapping down;
  down.is_up = false;
  ExportedField davis = read_exported_fields(folder + "davis_txt/B00010.txt", down).back();
  settle_field(down, nullptr, davis);
  expect_plate(davis, none_lost);
  const ExportedField stage =
      read_exported_fields(folder + "gom_csv/Flaechenkomponente 1_13.000 s.csv", {}).back();
  EXPECT_TRUE(stage.u.empty());
  EXPECT_EQ(stage.time, 13);
}

// Siblings of them: what the same programs write with other settings and on other machines.

/// How a table is written.
struct Style {
  std::string separator = ",", end = "\n", decimal = ".", lost = "nan", after = "";
};

/// A table of the plate; `cell` says what stands in a column for a point, in numbers or, for lost points,
/// words.
std::string table(
    const std::string& head, const Style& style, const std::vector<std::string>& columns,
    const std::function<std::string(const std::string&, const PlatePoint&, std::size_t)>& cell) {
  std::string text = head;
  const auto line = [&](std::vector<std::string> cells) {
    text += fmt::format("{}{}{}", fmt::join(cells, style.separator), style.after, style.end);
  };
  line(columns);
  for (std::size_t i = 0; i < plate().size(); ++i) {
    std::vector<std::string> cells;
    for (const std::string& column : columns) {
      std::string text_of = cell(column, plate()[i], i);
      std::replace(text_of.begin(), text_of.end(), '.', style.decimal[0]);
      cells.push_back(text_of);
    }
    line(cells);
  }
  return text;
}

std::string text_of(double value) {
  return fmt::format("{:.9g}", value);
}

/// Every byte of a text of ASCII as UTF-16.
std::string utf16(const std::string& text, bool big_endian, bool mark) {
  std::string bytes = !mark ? "" : big_endian ? "\xFE\xFF" : "\xFF\xFE";
  for (const char c : text) bytes += big_endian ? std::string{'\0', c} : std::string{c, '\0'};
  return bytes;
}

TEST_F(ExportedFields, Vic3dInAnyOrderUnitAndEncoding) {
  const auto cell = [](double unit) {
    return [unit](const std::string& column, const PlatePoint& p, std::size_t) {
      if (column == "sigma") return std::string(p.lost() ? "-1" : "0.02");
      if (column == "u" || column == "q") return std::string(p.lost() ? "3.1e+22" : "1");
      if (p.lost() || column == "Z" || column == "W") return std::string("0");
      return text_of(unit * (column == "X" ? p.x : column == "Y" ? p.y : column == "U" ? p.u() : p.v()));
    };
  };
  const std::vector<std::string> shuffled{"sigma", "V", "W", "U", "q", "Z", "Y", "X"};
  for (const auto& [unit, factor] : {std::pair("mm", 1.0), {"m", 1e-3}, {"um", 1e3}, {"cm", 0.1}}) {
    const std::string text = table("", {.end = "\r\n"}, shuffled, cell(factor));
    for (const std::string& bytes : {text, "\xEF\xBB\xBF" + text, utf16(text, false, true),
                                     utf16(text, true, true), utf16(text, false, false)})
      expect_plate(read("a.csv", bytes, in_unit(unit)), two_lost);
  }
  const std::string old_mac =
      table("", {.separator = "\t", .end = "\r"}, {"X", "Y", "Z", "U", "V", "W", "sigma"}, cell(1));
  expect_plate(read("a.csv", old_mac, in_unit("mm")), two_lost);
}

TEST_F(ExportedFields, AreasOfWhichNotAllHaveNumbersOfPointsAreFoundByPlace) {
  const ExportedField field =
      read("a.csv", "X,Y,U,V,sigma,x,y\n1,2,3,4,0.1,10,20\n\nX,Y,U,V,sigma\n5,6,7,8,0.1\n9,9,9,9,-1\n",
           in_unit("mm"));
  EXPECT_EQ(field.x, (std::vector<double>{1, 5, 9}));
  EXPECT_EQ(field.lost_count(), 1u);
  EXPECT_TRUE(field.id.empty());
}

TEST_F(ExportedFields, WordsInAnyLanguageAreLostPoints) {
  const std::vector<std::string> columns{
      "Coordinates.Image X [Pixel]",         "Coordinates.Image Y [Pixel]",      "coor.X [mm]", "coor.Y [mm]",
      "disp.Horizontal Displacement U [mm]", "disp.Vertical Displacement V [mm]"};
  for (const char* const word :
       {"NaN", "nan", "", "Non un numero reale", "n. def.", "NaN (Qual)", "-nan", "inf"}) {
    const auto cell = [&](const std::string& column, const PlatePoint& p, std::size_t) {
      if (column.starts_with("Coordinates"))
        return text_of(column.find('X') != std::string::npos ? 100 + 20 * p.x : 350 - 20 * p.y);
      if (p.lost()) return std::string(word);
      return text_of(column[5] == 'X'   ? p.x + p.u()
                     : column[5] == 'Y' ? -p.y - p.v()
                     : column[5] == 'H' ? p.u()
                                        : -p.v());
    };
    SCOPED_TRACE(word);
    expect_plate(read("a.csv", table("", {}, columns, cell)), two_lost);
    // A German system: semicolons, decimal commas.
    const Style german{.separator = ";", .end = "\r\n", .decimal = ","};
    const std::string text = table("", german, columns, cell);
    expect_plate(read("b.csv", text), two_lost);
  }
}

TEST_F(ExportedFields, GomWithDecimalCommasMissingRowsAndAnotherLanguage) {
  std::string text =
      "# Units: length:m angle:rad time:ms \r\n# Stage: \xC3\xA9tape 3 \r\nstage;index;relative_time;date\r\n"
      "\"\xC3\xA9tape 3\";3;250,5;\"2026\"\r\nid;x;y;z;displacement_y;displacement_x\r\n";
  for (std::size_t i = 0; i < plate().size(); ++i) {
    const PlatePoint p = plate()[i];
    if (p.lost()) continue;
    std::string row =
        fmt::format("{};{};{};0.1;{};{}\r\n", i, text_of(1e-3 * (p.x + p.u())), text_of(1e-3 * (p.y + p.v())),
                    text_of(1e-3 * p.v()), text_of(1e-3 * p.u()));
    std::replace(row.begin(), row.end(), '.', ',');
    text += row;
  }
  const ExportedField field = read("a.csv", text);
  expect_plate(field, two_lost);
  EXPECT_DOUBLE_EQ(*field.time, 0.2505);
  EXPECT_EQ(field.found, "gom, 13 points, 0 lost, m, positions of the loaded state, y up");
}

TEST_F(ExportedFields, AColumnThatIsThereTwiceMustMeanTheSame) {
  const std::string head = "# Units: length:mm\nid,x,y,x,displacement_x,displacement_y\n";
  EXPECT_EQ(read("a.csv", head + "1,5,3,5,1,0\n").x[0], 4);
  EXPECT_EQ(complaint("a.csv", head + "1,5,3,6,1,0\n"),
            folder_.file("a.csv") +
                ":3: error: two columns are named x and differ: say which is meant in "
                "data.fields.columns, \"#2\" or \"#4\"");
  FieldMapping mapping = in_unit("mm");
  mapping.columns["x"] = "#4", mapping.is_current = mapping.is_up = true;
  EXPECT_EQ(read("a.csv", head + "1,5,3,6,1,0\n", mapping).x[0], 5);
}

TEST_F(ExportedFields, DiceTellsLostPointsByWhatColumnsThereAre) {
  const auto cell = [](const std::string& column, const PlatePoint& p, std::size_t i) {
    if (column == "SUBSET_ID") return std::to_string(i);
    if (column == "COORDINATE_X") return text_of(100 + 20 * p.x);
    if (column == "COORDINATE_Y") return text_of(350 - 20 * p.y);
    if (column == "STATUS_FLAG") return std::string(p.lost() ? "24" : "4");
    if (column == "DISPLACEMENT_X") return text_of(p.lost() ? -3.3 : 20 * p.u());
    if (column == "DISPLACEMENT_Y") return text_of(p.lost() ? 0.4 : -20 * p.v());
    return std::string(p.lost() ? "-1" : "0.003");
  };
  const std::vector<std::string> columns{"DISPLACEMENT_Y", "COORDINATE_Y", "COORDINATE_X", "DISPLACEMENT_X"};
  for (const char* const mark : {"SIGMA", "GAMMA", "BETA", "MATCH", "STATUS_FLAG"})
    for (const char* const separator : {",", " ", "\t"})
      for (const char* const head : {"", "***\n*** DICe\n***\n"}) {
        std::vector<std::string> all = columns;
        all.emplace_back(mark);
        if (*head != '\0') all.insert(all.begin(), "SUBSET_ID");
        expect_plate(read("a.txt", table(head, {.separator = separator}, all, cell)), two_lost);
      }
  EXPECT_EQ(
      complaint("a.txt", table("", {}, columns, cell)),
      folder_.file("a.txt") +
          ": without a column SIGMA it is not known which points are lost: give data.fields.lost, such as "
          "[\"sigma < 0\"], or [] if rows of lost points are missing or have no numbers");
  FieldMapping all_valid;
  all_valid.lost.emplace();
  EXPECT_EQ(read("a.txt", table("", {}, columns, cell), all_valid).lost_count(), 0u);
  EXPECT_NE(complaint("a.txt", "FRAME,COORDINATE_X,COORDINATE_Y\n0,1,2\n").find("one subset over all frames"),
            std::string::npos);
}

TEST_F(ExportedFields, OpenCorrDavisAndSunDicAsOtherVersionsWriteThem) {
  const auto pixels = [](const std::string& column, const PlatePoint& p, std::size_t) {
    if (column == "x") return text_of(100 + 20 * p.x);
    if (column == "y") return text_of(350 - 20 * p.y);
    if (column == "ZNCC") return std::string(!p.lost() ? "0.99" : p.x == 10 ? "nan" : "-3");
    return text_of(p.lost() ? 0.5 : column == "u" ? 20 * p.u() : -20 * p.v());
  };
  for (const char* const after : {"", ","})
    expect_plate(read("a.csv", table("", {.after = after}, {"x", "y", "u", "v", "ZNCC"}, pixels)), two_lost);
  const auto davis = [](const std::string& column, const PlatePoint& p, std::size_t) {
    if (p.lost()) return std::string();
    return text_of(column == "x[mm]"   ? p.x
                   : column == "y[mm]" ? p.y
                   : column == "\xB0"  ? 1
                   : column[0] == 'x'  ? p.u()
                                       : p.v());
  };
  expect_plate(
      read("a.csv", table("", {.separator = ";", .end = "\r\n"},
                          {"\xB0", "y[mm]", "x[mm]", "y-displacement[mm]", "x-displacement[mm]"}, davis)),
      two_lost);
}

TEST_F(ExportedFields, AnOlderNodemapStatesItsTimeAndForceInOtherWords) {
  std::string text =
      "####\n# Facet size: 19.0\n# Calibration object: CP 20 / MV 250x200mm\xB2 (ID: 10641)\n"
      "# Current stage date: 25.06.2019 09:25\n# Current stage relative date: 71317.25\n#\n"
      "# Kraft: 49.5 kN\n####\n#\n#ID,ID; x_undef [mm]; y_undef [mm]; z_undef [mm]; u [mm]; v [mm]; epsx "
      "[%]\n";
  for (std::size_t i = 0; i < plate().size(); ++i) {
    const PlatePoint p = plate()[i];
    text += p.lost() ? fmt::format("{}; nan; nan; nan; nan; nan; nan\n", i)
                     : fmt::format("{}; {}; {}; 0.1; {}; {}; 1\n", i, p.x, p.y, p.u(), p.v());
  }
  ExportedField field = read("AllDataPoints_1_7.txt", text);
  expect_plate(field, two_lost);
  EXPECT_EQ(field.time, 71317.25);
  EXPECT_EQ(field.scalars["Kraft"], 49500);
  EXPECT_FALSE(field.scalars.contains("Current stage date"));
}

TEST_F(ExportedFields, WhatTheUserDeclares) {
  // Another program: names of its own, v upside down, a quality from 0 to 1, positions of the loaded state.
  const auto cell = [](const std::string& column, const PlatePoint& p, std::size_t i) {
    if (column == "Nr") return std::to_string(i);
    if (column == "quality") return std::string(p.lost() ? "0.2" : "0.9");
    return text_of(column == "Px"   ? p.x + p.u()
                   : column == "Py" ? p.y + p.v()
                   : column == "Ux" ? p.u()
                                    : -p.v());
  };
  FieldMapping mapping = in_unit("mm");
  mapping.format = "table";
  mapping.columns = {{"x", "Px"}, {"y", "Py"}, {"u", "Ux"}, {"v", "-Vy"}, {"id", "Nr"}};
  mapping.lost = {lost_rule("quality < 0.5")};
  mapping.is_current = mapping.is_up = true;
  const std::string text = table("", {.separator = "\t"}, {"Nr", "Px", "Py", "Ux", "Vy", "quality"}, cell);
  const ExportedField field = read("a.txt", text, mapping);
  expect_plate(field, two_lost);
  EXPECT_EQ(field.found, "table, 15 points, 2 lost (quality < 0.5), mm, positions of the loaded state, y up");
  // Without names, by number.
  mapping.columns = {{"x", "#2"}, {"y", "#3"}, {"u", "#4"}, {"v", "-#5"}};
  mapping.lost = {lost_rule("#6 < 0.5")};
  expect_plate(read("a.txt", text.substr(text.find('\n') + 1), mapping), two_lost);
  EXPECT_EQ(complaint("a.txt", "1\t2\t3\t4\t5\t0.9\n2\t3\t4\n", mapping),
            folder_.file("a.txt") + ":2: error: 3 fields, column #4 is missing");
  mapping.columns["u"] = "Uy";
  EXPECT_EQ(complaint("a.txt", text, mapping),
            folder_.file("a.txt") + ": column Uy is missing; there are: Nr, Px, Py, Ux, Vy, quality");
  for (const char* const rule : {"", "sigma", "< 0", "sigma <", "sigma <= 0", "sigma < a"})
    EXPECT_THROW((void)lost_rule(rule), UsageError) << rule;
}

TEST_F(ExportedFields, WhatAFileCannotTellIsAskedForByItsKey) {
  const std::string vic = "\"X\",\"Y\",\"Z\",\"U\",\"V\",\"W\",\"sigma\"\n1,2,0,0.1,0.1,0,0.01\n";
  EXPECT_NE(complaint("a.csv", vic).find("data.fields.units"), std::string::npos);
  const std::string vic2d = "x,y,u,v,sigma,x_c,y_c,u_c,v_c\n1,2,0.1,0.1,0.01,1,2,0.1,0.1\n";
  EXPECT_NE(complaint("a.csv", vic2d, in_unit("mm")).find("data.fields.y"), std::string::npos);
  FieldMapping table = in_unit("mm");
  table.format = "table", table.lost.emplace();
  EXPECT_NE(complaint("a.csv", "x,y,u,v\n1,2,3,4\n", table).find("data.fields.positions"), std::string::npos);
  EXPECT_NE(complaint("a.csv", "a,b,c,d\n1,2,3,4\n").find("data.fields.columns"), std::string::npos);
  EXPECT_NE(complaint("a.csv", "# Units: length:mm\nid,x,y,z\n1,2,3,4\n").find("data.fields.reference"),
            std::string::npos);
  EXPECT_NE(complaint("a_U[mm].csv", "1;2;\n").find("data.fields.grid"), std::string::npos);
  EXPECT_NE(complaint("a.csv", vic, in_unit("kN")).find("\"kN\" is no unit of a displacement"),
            std::string::npos);
  FieldMapping gom;
  gom.format = "gom";
  EXPECT_NE(complaint("a.csv", vic, gom).find("are not those of gom"), std::string::npos);
}

TEST_F(ExportedFields, DamagedFilesAreRefusedWithTheirPlace) {
  const std::string path = folder_.file("a.csv"), head = "x,y,u,v,ZNCC\n";
  EXPECT_EQ(complaint("a.csv", head + "1,2,0.1,0.1.2,0.9\n"),
            path + ":2: error: column v: \"0.1.2\" is not a number");
  EXPECT_EQ(complaint("a.csv", head + "1,2,0.1,0.1,0.9\n1,2,0.1\n"),
            path + ":3: error: 3 fields, the head of the table has 5");
  // What has become text in the middle of a table does not hide the points behind it.
  EXPECT_EQ(
      complaint("a.csv", head + "1,2,0.1,0.1,0.9\nab,cd,e,f,g\n2,2,0.1,0.1,0.9\n"),
      path + ":3: error: neither numbers nor the columns of the table before: the file is damaged here");
  EXPECT_EQ(complaint("a.csv", head + std::string("1,2,0.1,0.1,0.9\n1,\0\0\0", 20)),
            path + ": NUL bytes (the first is byte 31): the file is damaged, or not a text");
  EXPECT_NE(complaint("a.csv", ""), "read");
  EXPECT_NE(complaint("a.dic2d", std::string(60, 'a')).find("no multiple of 61"), std::string::npos);
  EXPECT_NE(complaint("a.dic2d", std::string(61, 'a')).find("the columns are in another order"),
            std::string::npos);
  EXPECT_NE(complaint("a.txt",
                      "#DaVis 8.4.0 2D-vector 100 2 2 \"\" \"pixel\" \"\" \"pixel\" \"d\" "
                      "\"pixel\"\n1\t1\t1\t1\n2\t1\t1\t1\n")
                .find("cut off"),
            std::string::npos);
}

TEST_F(ExportedFields, DavisTextWithPointsAtRestMustBeExplained) {
  std::string text = "#DaVis 8.4.0 2D-vector 100 3 5 \"\" \"mm\" \"\" \"mm\" \"displacement\" \"mm\"\n";
  for (const PlatePoint& p : plate())
    text += p.lost() ? fmt::format("{}\t{}\t0\t0\n", p.x, p.y)
                     : fmt::format("{}\t{}\t{}\t{}\n", p.x, p.y, p.u() + 1, p.v());
  FieldMapping mapping;
  mapping.is_up = true;
  EXPECT_NE(complaint("a.txt", text, mapping).find("2 points have a displacement of exactly 0"),
            std::string::npos);
  mapping.lost = {lost_rule("u = 0")};
  EXPECT_EQ(read("a.txt", text, mapping).lost_count(), 2u);
  mapping.lost->clear();
  EXPECT_EQ(read("a.txt", text, mapping).lost_count(), 0u);
}

TEST_F(ExportedFields, MatricesInAnyLanguage) {
  FieldMapping mapping;
  mapping.is_up = false, mapping.grid = {0, -10, 5, 5};
  for (const char* const word : {"Non un numero reale", "NaN", "nicht def."})
    for (const char* const decimal : {",", "."}) {
      for (const char quantity : {'U', 'V'}) {
        std::string text;
        for (const PlatePoint& p : plate()) {
          std::string cell = p.lost() ? word : text_of(quantity == 'U' ? p.u() : -p.v());
          if (!p.lost()) std::replace(cell.begin(), cell.end(), '.', decimal[0]);
          text += cell + ";" + (p.x == 20 ? "\r\n" : "");
        }
        write_text_atomically(folder_.file(fmt::format("p_{}[mm].csv", quantity)), text);
      }
      ExportedField field = read_exported_fields(folder_.file("p_U[mm].csv"), mapping).back();
      settle_field(mapping, nullptr, field);
      expect_plate(field, two_lost);
    }
  EXPECT_TRUE(is_second_matrix("p_V[mm].csv"));
  EXPECT_FALSE(is_second_matrix("p_U[mm].csv"));
}

/// A .mat file, version 5: doubles as doubles or, as MATLAB does where they are whole, as bytes; packed or
/// not.
std::string mat_variable(const std::string& name, const std::vector<double>& values, bool packed) {
  const auto word = [](std::uint32_t value) {
    std::string bytes(4, '\0');
    std::memcpy(bytes.data(), &value, 4);
    return bytes;
  };
  const auto padded = [](std::string bytes) {
    bytes.resize((bytes.size() + 7) / 8 * 8, '\0');
    return bytes;
  };
  std::string real;
  const bool whole = std::all_of(values.begin(), values.end(),
                                 [](double v) { return v == std::floor(v) && std::abs(v) < 100; });
  for (const double value : values) {
    if (whole) {
      real += char(value);
    } else {
      std::string bytes(8, '\0');
      std::memcpy(bytes.data(), &value, 8);
      real += bytes;
    }
  }
  std::string named = name.size() <= 4
                          ? word(1 | name.size() << 16) + name + std::string(4 - name.size(), '\0')
                          : word(1) + word(name.size()) + padded(name);
  const std::string content = word(6) + word(8) + word(6) + word(0) + word(5) + word(8) + word(3) +
                              word(values.size() / 3) + named + word(whole ? 1 : 9) + word(real.size()) +
                              padded(real);
  const std::string variable = word(14) + word(content.size()) + content;
  if (!packed) return variable;
  uLongf size = compressBound(variable.size());
  std::string bytes(size, '\0');
  compress(reinterpret_cast<Bytef*>(bytes.data()), &size, reinterpret_cast<const Bytef*>(variable.data()),
           variable.size());
  bytes.resize(size);
  return word(15) + word(size) + bytes;
}

std::string vic_mat(bool packed) {
  std::string text = "MATLAB 5.0 MAT-file, made by a test";
  text.resize(124, ' ');
  text += std::string("\x00\x01IM", 4);
  const std::map<std::string, std::function<double(const PlatePoint&)>> arrays{
      {"X", [](const PlatePoint& p) { return p.lost() ? 0 : p.x; }},
      {"Y", [](const PlatePoint& p) { return p.lost() ? 0 : p.y; }},
      {"U", [](const PlatePoint& p) { return p.lost() ? 0 : p.u(); }},
      {"V", [](const PlatePoint& p) { return p.lost() ? 0 : p.v(); }},
      {"another", [](const PlatePoint& p) { return p.x; }},
      {"sigma", [](const PlatePoint& p) { return p.lost() ? -1 : 0.01; }}};
  for (const auto& [name, value] : arrays) {
    std::vector<double> values;
    for (const PlatePoint& p : plate()) values.push_back(value(p));
    text += mat_variable(name, values, packed);
  }
  return text;
}

TEST_F(ExportedFields, MatFilesPackedOrNot) {
  for (const bool packed : {false, true}) {
    const std::string bytes = vic_mat(packed);
    expect_plate(read("a.mat", bytes, in_unit("mm")), two_lost);
    // Cut off anywhere, it is refused or read without what is missing; nothing breaks.
    for (std::size_t size = 0; size < bytes.size(); size += 61)
      EXPECT_NE(complaint("a.mat", bytes.substr(0, size), in_unit("mm")), "read") << size;
  }
}

TEST_F(ExportedFields, IstraOfTwoCamerasSaysNoUnit) {
  const std::string path = folder_.file("series_step_3.hdf5");
  std::vector<double> x, y, u, v;
  std::vector<std::int64_t> mask;
  for (const PlatePoint& p : plate()) {
    x.push_back(p.lost() ? 1e74 : p.x + p.u()), y.push_back(p.lost() ? NAN : p.y + p.v());
    u.push_back(p.lost() ? -2e14 : p.u()), v.push_back(p.lost() ? INFINITY : p.v());
    mask.push_back(p.lost() ? 0 : 1);
  }
  Hdf5Writer file(path);
  const Shape shape{3, 5};
  file.write("/coordinates/coordinate_x", x, shape, {}),
      file.write("/coordinates/coordinate_y", y, shape, {});
  file.write("/coordinates/coordinate_z", x, shape, {}),
      file.write_integers("/coordinates/mask", mask, shape, {});
  file.write("/displacements/displacement_x", u, shape, {}),
      file.write("/displacements/displacement_y", v, shape, {});
  file.write_integers("/displacements/mask", mask, shape, {});
  file.close();
  ExportedField field = read_exported_fields(path, {}).back();
  EXPECT_THROW(settle_field({}, nullptr, field), DataError);
  settle_field(in_unit("mm"), nullptr, field);
  expect_plate(field, two_lost);
}

TEST_F(ExportedFields, AramisTextWithDecimalCommasAndIndicesInAnotherOrder) {
  std::string displacements = "# Export displacement of facets\n# Index_x, Index_y, Displ(x,y,z)\n#\n";
  std::string places =
      "# Export original coordinates of facets\n# Index_x, Index_y, Coordinate-undef (x,y,z)\n#\n";
  const auto row = [](std::size_t i, double a, double b) {
    std::string text = fmt::format("  {} {} {:.6f} {:.6f} 0.000000  \r\n", i % 5 + 1, i / 5 + 1, a, b);
    std::replace(text.begin(), text.end(), '.', ',');
    return text;
  };
  for (std::size_t i = plate().size(); i-- > 0;)
    if (!plate()[i].lost()) displacements += row(i, plate()[i].u(), plate()[i].v());
  for (std::size_t i = 0; i < plate().size(); ++i) places += row(i, plate()[i].x, plate()[i].y);
  FieldMapping mapping = in_unit("mm");
  mapping.is_up = true;
  write_text_atomically(folder_.file("places.txt"), places),
      write_text_atomically(folder_.file("moved.txt"), displacements);
  ExportedField field = read_exported_fields(folder_.file("moved.txt"), mapping).back();
  const ExportedField reference = read_exported_fields(folder_.file("places.txt"), mapping).back();
  settle_field(mapping, &reference, field);
  expect_plate(field, two_lost);
  EXPECT_NE(complaint("strains.txt", "# Index_x, Index_y, Strain\n1 1 2 3\n").find("neither Displ(x,y,z)"),
            std::string::npos);
}

TEST(FieldText, Utf8OfEveryEncoding) {
  EXPECT_EQ(utf8_of("a\xB0\x80", "f"), "a\u00B0\u20AC");  // windows-1252
  EXPECT_EQ(utf8_of("a\u00B0\u20AC", "f"), "a\u00B0\u20AC");
  EXPECT_EQ(utf8_of(std::string("\xFF\xFE"
                                "a\0\xB0\0\xAC\x20",
                                8),
                    "f"),
            "a\u00B0\u20AC");
  EXPECT_EQ(utf8_of("\xEF\xBB\xBF"
                    "a",
                    "f"),
            "a");
  EXPECT_EQ(utf8_of("", "f"), "");
}

}  // namespace
}  // namespace knothe::files
