#include "knothe/files/calculix.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "knothe/base/error.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/testing/test_folder.hpp"

namespace knothe::files {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

/// As ccx 2.20 writes it for a unit cube of one element that is pressed together: lines left out, numbers
/// that touch each other kept.
const std::string k_frd = R"(    1C
    1UPGM               CalculiX
    2C                             8                                     1
 -1         1 0.00000E+00 0.00000E+00 0.00000E+00
 -1         2 1.00000E+00 0.00000E+00 0.00000E+00
 -1         3 1.00000E+00 1.00000E+00 0.00000E+00
 -1         4 0.00000E+00 1.00000E+00 0.00000E+00
 -1        15 0.00000E+00 0.00000E+00 1.00000E+00
 -1        16 1.00000E+00 0.00000E+00 1.00000E+00
 -1        17 1.00000E+00 1.00000E+00 1.00000E+00
 -1        18 0.00000E+00 1.00000E+00 1.00000E+00
 -3
    3C                             1                                     1
 -1         1    1    0    1
 -2         1         2         3         4        15        16        17        18
 -3
    1PSTEP                         1           1           1
  100CL  101 5.00000E-01           8                     0    1           1
 -4  DISP        4    1
 -5  D1          1    2    1    0
 -5  D2          1    2    2    0
 -5  D3          1    2    3    0
 -5  ALL         1    2    0    0    1ALL
 -1        15 7.85534E-19 8.13152E-19-4.00000E-03
 -1        16-8.76629E-19-5.69206E-19-4.00000E-03
 -3
  100CL  102 1.000000000           8                     0    1           1
 -4  STRESS      6    1
 -5  SXX         1    4    1    1
 -5  SYY         1    4    2    2
 -5  SZZ         1    4    3    3
 -5  SXY         1    4    1    2
 -5  SYZ         1    4    2    3
 -5  SZX         1    4    3    1
 -1         1-2.81662E-21-1.26474E-20-3.99984E+01 1.26130E-20 4.10425E-15 3.99884E-15
 -3
 9999
)";

TEST(Frd, NodesCellsAndFieldsAreRead) {
  const TestFolder folder;
  write_text_atomically(folder.file("a.frd"), k_frd);
  const FrdContents contents = read_frd(folder.file("a.frd"));
  EXPECT_THAT(contents.ids, ElementsAre(1, 2, 3, 4, 15, 16, 17, 18));
  EXPECT_EQ(contents.points.size(), 24u);
  ASSERT_EQ(contents.cells.size(), 1u);
  EXPECT_EQ(contents.cells[0].type, 1);
  EXPECT_THAT(contents.cells[0].nodes, ElementsAre(0, 1, 2, 3, 4, 5, 6, 7));
  ASSERT_EQ(contents.fields.size(), 2u);
  EXPECT_EQ(contents.fields[0].name, "DISP");
  EXPECT_EQ(contents.fields[0].time, 0.5);
  EXPECT_THAT(contents.fields[0].components, ElementsAre("D1", "D2", "D3"));
  EXPECT_EQ(contents.fields[0].values[3 * 4 + 2], -4e-3);
  EXPECT_EQ(contents.fields[0].values[3 * 5], -8.76629e-19);
  EXPECT_EQ(contents.fields[0].values[3 * 6], 0);
  EXPECT_EQ(contents.fields[1].time, 1.0);
  EXPECT_EQ(contents.fields[1].values[2], -39.9984);
}

TEST(Frd, MistakesAreNamedWithTheirLine) {
  const TestFolder folder;
  const auto complaint = [&](const std::string& old, const std::string& now) {
    std::string text = k_frd;
    text.replace(text.find(old), old.size(), now);
    write_text_atomically(folder.file("a.frd"), text);
    return message_of<DataError>([&] { (void)read_frd(folder.file("a.frd")); });
  };
  EXPECT_THAT(complaint("-4.00000E-03", "         NaN"), HasSubstr("a.frd:24: error: \"NaN\""));
  EXPECT_THAT(complaint(" -1        16-8", " -1        19-8"),
              HasSubstr("a.frd:25: error: a value of a node that there is not"));
  EXPECT_THAT(complaint("        16        17", "        16        77"),
              HasSubstr("an element with a node that there is not"));
  EXPECT_THAT(complaint("2C                             8                                     1",
                        "2C                             8                                     2"),
              HasSubstr("binary data"));
  EXPECT_THAT(complaint(k_frd, "hello\n"), HasSubstr("no .frd file of CalculiX"));
  EXPECT_THAT(message_of<DataError>([&] { (void)read_frd(folder.file("none.frd")); }), HasSubstr("none.frd"));
}

const std::string k_dat = R"(
 displacements (vx,vy,vz) for set TOP and time  0.5000000E+00

         7  1.284605E-18  4.078138E-19 -2.000000E-03
         8  1.316489E-18  1.250119E-18 -2.000000E-03

 total force (fx,fy,fz) for set BOTTOM and time  0.5000000E+00

       -3.804411E-15 -1.936891E-15  2.000000E+01

 stresses (elem, integ.pnt.,sxx,syy,szz,sxy,sxz,syz) for set EALL and time  0.5000000E+00

         1   1  1.375869E-16  6.562045E-16 -2.000000E+01  1.421928E-16  3.879855E-15  3.594001E-15

 displacements (vx,vy,vz) for set TOP and time  0.1000000E+01

         7  1.284605E-18  4.078138E-19 -4.000000E-03
         8  1.316489E-18  1.250119E-18 -4.100000E-03

 total force (fx,fy,fz) for set BOTTOM and time  0.1000000E+01

       -3.804411E-15 -1.936891E-15  4.000000E+01

 stresses (elem, integ.pnt.,sxx,syy,szz,sxy,sxz,syz) for set EALL and time  0.1000000E+01

         1   1  1.375869E-16  6.562045E-16 -4.000000E+01  1.421928E-16  3.879855E-15  3.594001E-15
)";

TEST(Dat, TablesBecomeNamedSeries) {
  const TestFolder folder;
  write_text_atomically(folder.file("a.dat"), k_dat);
  const DatContents contents = read_dat(folder.file("a.dat"));
  EXPECT_THAT(contents.time, ElementsAre(0.5, 1.0));
  const auto series = [&](const std::string& name) {
    for (const DatSeries& one : contents.series)
      if (one.name == name) return one.values;
    return std::vector<double>();
  };
  EXPECT_EQ(contents.series.size(), 6u + 3u + 6u);
  EXPECT_THAT(series("TOP.8.vz"), ElementsAre(-2e-3, -4.1e-3));
  EXPECT_THAT(series("BOTTOM.fz"), ElementsAre(20, 40));
  EXPECT_THAT(series("EALL.1.1.szz"), ElementsAre(-20, -40));
}

TEST(Dat, WhatIsNotPrintedAtAllTimesIsNamed) {
  const TestFolder folder;
  std::string text = k_dat;
  text.erase(text.rfind("         8 "), 52);
  write_text_atomically(folder.file("a.dat"), text);
  EXPECT_THAT(message_of<DataError>([&] { (void)read_dat(folder.file("a.dat")); }),
              HasSubstr("TOP.8.vx is printed 1 times, others 2"));
  write_text_atomically(folder.file("a.dat"), "nothing\n");
  EXPECT_THAT(message_of<DataError>([&] { (void)read_dat(folder.file("a.dat")); }), HasSubstr("no table"));
}

}  // namespace
}  // namespace knothe::files
