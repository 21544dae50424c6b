#include "knothe/files/picture.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tiffio.h>

#include <filesystem>
#include <fstream>
#include <limits>

#include "knothe/base/error.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/testing/test_folder.hpp"

namespace knothe::files {
namespace {

using ::testing::EndsWith;
using ::testing::HasSubstr;

Picture ramp(int width, int height, int bits) {
  Picture p;
  p.width = width, p.height = height, p.bit_depth = bits, p.maximum = static_cast<float>((1 << bits) - 1);
  for (int i = 0; i < width * height; ++i)
    p.pixels.push_back(static_cast<float>((i * 2654435761LL) % (1 << bits)));
  return p;
}

std::string reason(const std::string& path) {
  try {
    (void)read_picture(path);
  } catch (const DataError& error) {
    return error.what();
  }
  return "no DataError";
}

TEST(Picture, TiffAndPngKeepEveryGreyLevel) {
  const TestFolder folder;
  for (const int bits : {8, 16}) {
    const Picture p = ramp(37, 23, bits);
    for (const std::string& name : {std::string("a.tif"), std::string("a.png")}) {
      const std::string path = folder.file(name);
      name == "a.tif" ? write_tiff(path, p) : write_png(path, p);
      const Picture back = read_picture(path);
      EXPECT_EQ(back.pixels, p.pixels) << name << bits;
      EXPECT_EQ(back.bit_depth, bits);
      EXPECT_EQ(back.maximum, p.maximum);
    }
  }
}

TEST(Picture, ReadsPgmOfAnyDepth) {
  const TestFolder folder;
  std::string bytes = "P5\n# a comment\n3 2\n4095\n";
  for (const int v : {0, 1, 256, 4095, 300, 2})
    bytes += static_cast<char>(v / 256), bytes += static_cast<char>(v % 256);
  write_text_atomically(folder.file("a.pgm"), bytes);
  const Picture p = read_picture(folder.file("a.pgm"));
  EXPECT_EQ(p.pixels, (std::vector<float>{0, 1, 256, 4095, 300, 2}));
  EXPECT_EQ(p.bit_depth, 12);
  EXPECT_EQ(p.maximum, 4095);
  write_text_atomically(folder.file("b.pgm"), "P2 2 1 255 7 255");
  EXPECT_EQ(read_picture(folder.file("b.pgm")).pixels, (std::vector<float>{7, 255}));
}

TEST(Picture, ReadsPackedTwelveBitTiff) {
  const TestFolder folder;
  const std::string path = folder.file("packed.tif");
  TIFF* tiff = TIFFOpen(path.c_str(), "w");
  TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, 2), TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, 1),
      TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, 12);
  TIFFSetField(tiff, TIFFTAG_SAMPLESPERPIXEL, 1),
      TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_MINISBLACK);
  unsigned char row[3] = {0xABU, 0xC1U, 0x23U};
  TIFFWriteScanline(tiff, row, 0);
  TIFFClose(tiff);
  EXPECT_EQ(read_picture(path).pixels, (std::vector<float>{0xABC, 0x123}));
}

TEST(Picture, ReadsBmpTopDownAndBottomUp) {
  const TestFolder folder;
  for (const int height : {2, -2}) {
    std::string b(54 + 1024 + 8, '\0');
    const auto put = [&](std::size_t at, std::int32_t v) {
      for (std::size_t i = 0; i < 4; ++i)
        b[at + i] = static_cast<char>(static_cast<std::uint32_t>(v) >> (8 * i));
    };
    b[0] = 'B', b[1] = 'M';
    put(10, 54 + 1024), put(14, 40), put(18, 3), put(22, height), put(26, 1 + (8 << 16)), put(46, 256);
    for (std::size_t c = 0; c < 256; ++c)
      for (std::size_t k = 0; k < 3; ++k) b[54 + 4 * c + k] = static_cast<char>(c);
    for (std::size_t i = 0; i < 3; ++i)
      b[54 + 1024 + i] = static_cast<char>(10 + i), b[54 + 1024 + 4 + i] = static_cast<char>(200 + i);
    write_text_atomically(folder.file("a.bmp"), b);
    const Picture p = read_picture(folder.file("a.bmp"));
    EXPECT_EQ(p.at(0, 0), height > 0 ? 200 : 10);
    EXPECT_EQ(p.at(2, 1), height > 0 ? 12 : 202);
  }
}

TEST(Picture, SaysWhyAFileCannotBeRead) {
  const TestFolder folder;
  EXPECT_THAT(reason(folder.file("none.tif")), EndsWith("none.tif: error: there is no such picture"));
  write_text_atomically(folder.file("empty.tif"), "");
  EXPECT_THAT(reason(folder.file("empty.tif")), EndsWith("the file is empty"));
  write_text_atomically(folder.file("text.tif"), "this is not a picture at all");
  EXPECT_THAT(reason(folder.file("text.tif")),
              EndsWith("not a picture that can be read: TIFF, PNG, BMP and PGM are"));
  write_text_atomically(folder.file("colour.pgm"), "P6\n1 1\n255\nabc");
  EXPECT_THAT(reason(folder.file("colour.pgm")),
              HasSubstr("a picture in colour; image correlation needs grey levels"));
  for (const std::string& name : {std::string("cut.tif"), std::string("cut.png")}) {
    const Picture p = ramp(64, 64, 16);
    name == "cut.tif" ? write_tiff(folder.file(name), p) : write_png(folder.file(name), p);
    const std::string whole = read_text(folder.file(name));
    for (const double share : {0.3, 0.7, 0.95}) {
      write_text_atomically(
          folder.file(name),
          whole.substr(0, static_cast<std::size_t>(share * static_cast<double>(whole.size()))));
      EXPECT_THAT(reason(folder.file(name)), HasSubstr(name + ": error: ")) << share;
    }
  }
  write_text_atomically(folder.file("cut.pgm"), "P5 4 4 255 abc");
  EXPECT_THAT(reason(folder.file("cut.pgm")),
              HasSubstr("the file is truncated: 13 bytes of pixels are missing"));
  write_text_atomically(folder.file("huge.pgm"), "P5 60000 60000 255 abc");
  EXPECT_THAT(reason(folder.file("huge.pgm")), HasSubstr("it says 60000 × 60000 pixels and has 22 bytes"));
  write_text_atomically(folder.file("above.pgm"), "P5 2 2 100 abe\x7f");
  EXPECT_THAT(reason(folder.file("above.pgm")), HasSubstr("a grey level of 101 above the maximum 100"));
  Picture bad = ramp(4, 4, 8);
  bad.at(2, 1) = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THROW(write_tiff(folder.file("nan.tif"), bad), UsageError);
  EXPECT_THROW(write_png(folder.file("nan.png"), bad), UsageError);
  EXPECT_FALSE(std::filesystem::exists(folder.file("nan.tif")));
}

}  // namespace
}  // namespace knothe::files
