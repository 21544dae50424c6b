#include "knothe/files/picture.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <png.h>
#include <tiffio.h>

#include <array>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <functional>
#include <limits>
#include <string_view>

#include <jpeglib.h>  // after <cstdio>

#include "knothe/base/error.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/picture_formats.hpp"
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

using Rgb = std::vector<std::array<std::uint8_t, 3>>;
const Rgb k_greys = {{0, 0, 0}, {255, 255, 255}, {100, 100, 100}, {7, 7, 7}};
const Rgb k_colours = {{200, 100, 50}, {255, 255, 255}, {0, 0, 255}, {7, 7, 7}};
/// 0.299 R + 0.587 G + 0.114 B by hand.
const std::vector<float> k_luminances = {124.2F, 255, 29.07F, 7};

/// Two by two pixels by a palette of four.
void write_palette_png(const std::string& path, const Rgb& palette) {
  png_image image{};
  image.version = PNG_IMAGE_VERSION, image.width = 2, image.height = 2;
  image.format = PNG_FORMAT_RGB_COLORMAP, image.colormap_entries = 4;
  const std::uint8_t pixels[] = {0, 1, 2, 3};
  ASSERT_NE(png_image_write_to_file(&image, path.c_str(), 0, pixels, 2, palette.data()), 0);
}

void write_palette_tiff(const std::string& path, const Rgb& palette) {
  TIFF* tiff = TIFFOpen(path.c_str(), "w");
  TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, 2), TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, 2);
  TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, 8), TIFFSetField(tiff, TIFFTAG_SAMPLESPERPIXEL, 1);
  TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_PALETTE);
  std::array<std::vector<std::uint16_t>, 3> map;
  for (std::size_t k = 0; k < 3; ++k) {
    map[k].resize(256);
    for (std::size_t c = 0; c < 4; ++c) map[k][c] = static_cast<std::uint16_t>(257 * palette[c][k]);
  }
  TIFFSetField(tiff, TIFFTAG_COLORMAP, map[0].data(), map[1].data(), map[2].data());
  for (std::uint8_t y = 0; y < 2; ++y) {
    std::uint8_t row[] = {static_cast<std::uint8_t>(2 * y), static_cast<std::uint8_t>(2 * y + 1)};
    TIFFWriteScanline(tiff, row, y);
  }
  TIFFClose(tiff);
}

void write_rgb_tiff(const std::string& path, const Rgb& colours) {
  TIFF* tiff = TIFFOpen(path.c_str(), "w");
  TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, 2), TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, 2);
  TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, 8), TIFFSetField(tiff, TIFFTAG_SAMPLESPERPIXEL, 3);
  TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_RGB);
  TIFFSetField(tiff, TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG);
  for (std::uint32_t y = 0; y < 2; ++y) {
    Rgb row(colours.begin() + 2 * y, colours.begin() + 2 * y + 2);
    TIFFWriteScanline(tiff, row.data(), y);
  }
  TIFFClose(tiff);
}

void write_rgb_png(const std::string& path, const Rgb& colours) {
  write_colour_png(path, 2, 2, {colours[0].data(), 12});
}

void write_ppm(const std::string& path, const Rgb& colours) {
  write_text_atomically(path,
                        "P6 2 2 255 " + std::string(reinterpret_cast<const char*>(colours[0].data()), 12));
}

TEST(Picture, InColourIsReadWhereItIsGreyOrItsLuminanceIsAskedFor) {
  const TestFolder folder;
  const std::string path = folder.file("picture");
  for (const auto& write :
       {write_palette_png, write_palette_tiff, write_rgb_tiff, write_rgb_png, write_ppm}) {
    write(path, k_greys);
    const Picture grey = read_picture(path);
    EXPECT_EQ(grey.pixels, (std::vector<float>{0, 255, 100, 7}));
    EXPECT_EQ(grey.bit_depth, 8);
    EXPECT_EQ(grey.maximum, 255);
    EXPECT_EQ(grey.remark, "");
    write(path, k_colours);
    EXPECT_THAT(reason(path), HasSubstr("or have its luminance taken (dic.colour = \"grey\", --grey)"));
    const Picture luminance = read_picture(path, Colour::grey);
    for (std::size_t k = 0; k < 4; ++k) EXPECT_NEAR(luminance.pixels[k], k_luminances[k], 1e-4) << k;
  }
}

/// A ramp of 16 × 16 pixels at quality 100, of one component or three, the second less by `less_green`.
void write_jpeg(const std::string& path, int components, int less_green = 0) {
  jpeg_compress_struct jpeg{};
  jpeg_error_mgr errors{};
  jpeg.err = jpeg_std_error(&errors);
  jpeg_create_compress(&jpeg);
  std::FILE* file = std::fopen(path.c_str(), "wb");
  ASSERT_NE(file, nullptr);
  jpeg_stdio_dest(&jpeg, file);
  jpeg.image_width = jpeg.image_height = 16;
  jpeg.input_components = components, jpeg.in_color_space = components == 1 ? JCS_GRAYSCALE : JCS_RGB;
  jpeg_set_defaults(&jpeg);
  jpeg_set_quality(&jpeg, 100, TRUE);
  jpeg_start_compress(&jpeg, TRUE);
  for (int y = 0; y < 16; ++y) {
    std::vector<std::uint8_t> row;
    for (int x = 0; x < 16; ++x)
      for (int k = 0; k < components; ++k)
        row.push_back(static_cast<std::uint8_t>(100 + 4 * x + 3 * y - (k == 1 ? less_green : 0)));
    JSAMPROW out = row.data();
    jpeg_write_scanlines(&jpeg, &out, 1);
  }
  jpeg_finish_compress(&jpeg);
  jpeg_destroy_compress(&jpeg);
  std::fclose(file);
}

struct TiffTags {
  int samples = 1, bits = 8, format = SAMPLEFORMAT_UINT, photometric = PHOTOMETRIC_MINISBLACK,
      planes = PLANARCONFIG_CONTIG, orientation = 1;
};

TIFF* open_tiff(const std::string& path, int width, int height, const TiffTags& tags,
                const char* mode = "w") {
  TIFF* tiff = TIFFOpen(path.c_str(), mode);
  TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, width);
  TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, height);
  TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, tags.bits);
  TIFFSetField(tiff, TIFFTAG_SAMPLESPERPIXEL, tags.samples);
  TIFFSetField(tiff, TIFFTAG_SAMPLEFORMAT, tags.format);
  TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, tags.photometric);
  TIFFSetField(tiff, TIFFTAG_PLANARCONFIG, tags.planes);
  TIFFSetField(tiff, TIFFTAG_ORIENTATION, tags.orientation);
  return tiff;
}

/// `planes`: the bytes of each row, of each plane where they are apart.
void write_tags(const std::string& path, int width, int height, const TiffTags& tags,
                const std::function<std::vector<std::uint8_t>(int plane, int y)>& row) {
  TIFF* tiff = open_tiff(path, width, height, tags);
  TIFFSetField(tiff, TIFFTAG_ROWSPERSTRIP, 1);
  for (int plane = 0; plane < (tags.planes == PLANARCONFIG_SEPARATE ? tags.samples : 1); ++plane)
    for (int y = 0; y < height; ++y) TIFFWriteScanline(tiff, row(plane, y).data(), y, plane);
  TIFFClose(tiff);
}

/// A 3 × 2 picture 0 1 2 / 3 4 5, stored in each of the eight ways that the standard has, is the same one.
TEST(Picture, TheOrientationOfATiffIsThatOfViewers) {
  const TestFolder folder;
  const std::array<std::vector<std::vector<std::uint8_t>>, 8> stored = {{{{0, 1, 2}, {3, 4, 5}},
                                                                         {{2, 1, 0}, {5, 4, 3}},
                                                                         {{5, 4, 3}, {2, 1, 0}},
                                                                         {{3, 4, 5}, {0, 1, 2}},
                                                                         {{0, 3}, {1, 4}, {2, 5}},
                                                                         {{2, 5}, {1, 4}, {0, 3}},
                                                                         {{5, 2}, {4, 1}, {3, 0}},
                                                                         {{3, 0}, {4, 1}, {5, 2}}}};
  for (int orientation = 1; orientation <= 8; ++orientation) {
    const auto& rows = stored[orientation - 1];
    const std::string path = folder.file("oriented.tif");
    write_tags(path, static_cast<int>(rows[0].size()), static_cast<int>(rows.size()),
               {.orientation = orientation}, [&](int, int y) { return rows[y]; });
    const Picture picture = read_picture(path);
    ASSERT_EQ(picture.width, 3) << orientation;
    EXPECT_THAT(picture.pixels, ::testing::ElementsAre(0, 1, 2, 3, 4, 5)) << orientation;
  }
}

TEST(Picture, TiffsWithAlphaOrPlanesApartOrASignAreRead) {
  const TestFolder folder;
  const std::string path = folder.file("picture.tif");
  write_tags(path, 2, 1, {.samples = 2}, [](int, int) { return std::vector<std::uint8_t>{7, 255, 9, 0}; });
  EXPECT_THAT(read_picture(path).pixels, ::testing::ElementsAre(7, 9));
  write_tags(path, 2, 1, {.samples = 3, .photometric = PHOTOMETRIC_RGB, .planes = PLANARCONFIG_SEPARATE},
             [](int, int) {
               return std::vector<std::uint8_t>{50, 60};
             });
  EXPECT_THAT(read_picture(path).pixels, ::testing::ElementsAre(50, 60));
  write_tags(path, 2, 1, {.samples = 3, .photometric = PHOTOMETRIC_RGB, .planes = PLANARCONFIG_SEPARATE},
             [](int plane, int) {
               return std::vector<std::uint8_t>{std::uint8_t(100 * plane), 60};
             });
  EXPECT_THAT(reason(path), HasSubstr("in colour"));
  EXPECT_NEAR(read_picture(path, Colour::grey).pixels[0], 0.587 * 100 + 0.114 * 200, 0.01);
  write_tags(path, 2, 1, {.bits = 16, .format = SAMPLEFORMAT_INT}, [](int, int) {
    return std::vector<std::uint8_t>{0x39, 0x30, 0xFF, 0x7F};
  });
  EXPECT_THAT(read_picture(path).pixels, ::testing::ElementsAre(12345, 32767));
  EXPECT_EQ(read_picture(path).maximum, 32767);
  write_tags(path, 2, 1, {.bits = 16, .format = SAMPLEFORMAT_INT}, [](int, int) {
    return std::vector<std::uint8_t>{0, 0, 0xFF, 0xFF};
  });
  EXPECT_THAT(reason(path), HasSubstr("signed integers, and pixel (1, 0) is negative"));
  write_tags(path, 1, 1, {.samples = 4, .photometric = PHOTOMETRIC_SEPARATED}, [](int, int) {
    return std::vector<std::uint8_t>{1, 2, 3, 4};
  });
  EXPECT_THAT(reason(path), HasSubstr("a TIFF of inks (CMYK): save it in grey levels"));
}

/// The same rows in strips and in tiles, which the picture does not fill.
TEST(Picture, TiledTiffsAreTheSamePicturesAsThoseInStrips) {
  const TestFolder folder;
  const int width = 37, height = 21, tile = 16;
  for (const TiffTags& tags : {TiffTags{.bits = 8}, TiffTags{.bits = 16}, TiffTags{.bits = 4},
                               TiffTags{.samples = 3, .photometric = PHOTOMETRIC_RGB},
                               TiffTags{.samples = 2, .planes = PLANARCONFIG_SEPARATE}}) {
    const bool apart = tags.planes == PLANARCONFIG_SEPARATE;
    const auto bytes = [&](int pixels) { return (pixels * tags.bits * (apart ? 1 : tags.samples) + 7) / 8; };
    const auto row = [&](int plane, int y) {
      std::vector<std::uint8_t> values;
      for (int k = 0; k < bytes(width); ++k)  // grey: three samples a pixel are equal
        values.push_back(17 * y + 31 * (tags.samples == 3 ? k / 3 : k) + 101 * plane);
      return values;
    };
    write_tags(folder.file("strips.tif"), width, height, tags, row);
    TIFF* tiff = open_tiff(folder.file("tiles.tif"), width, height, tags);
    TIFFSetField(tiff, TIFFTAG_TILEWIDTH, tile), TIFFSetField(tiff, TIFFTAG_TILELENGTH, tile);
    for (int plane = 0; plane < (apart ? tags.samples : 1); ++plane)
      for (int y0 = 0; y0 < height; y0 += tile)
        for (int x0 = 0; x0 < width; x0 += tile) {
          std::vector<std::uint8_t> values(tile * bytes(tile), 0xAB);
          for (int y = y0; y < std::min(height, y0 + tile); ++y)
            for (int k = 0; k < std::min(bytes(tile), bytes(width) - bytes(x0)); ++k)
              values[(y - y0) * bytes(tile) + k] = row(plane, y)[bytes(x0) + k];
          TIFFWriteTile(tiff, values.data(), x0, y0, 0, plane);
        }
    TIFFClose(tiff);
    EXPECT_EQ(read_picture(folder.file("tiles.tif")).pixels, read_picture(folder.file("strips.tif")).pixels)
        << tags.bits << " bits, " << tags.samples << " samples";
  }
  const std::string path = folder.file("vast.tif");
  TIFF* tiff = open_tiff(path, 16, 16, {});
  TIFFSetField(tiff, TIFFTAG_TILEWIDTH, tile), TIFFSetField(tiff, TIFFTAG_TILELENGTH, tile);
  std::vector<std::uint8_t> black(tile * tile);
  TIFFWriteTile(tiff, black.data(), 0, 0, 0, 0);
  TIFFClose(tiff);
  std::string bytes = read_text(path);
  for (const char tag : {'\x42', '\x43'})  // TileWidth, TileLength: 322, 323
    bytes.replace(bytes.rfind(std::string{tag, '\x01'}) + 8, 2, "\xF0\xFF");
  write_text_atomically(path, bytes);
  EXPECT_THAT(reason(path),
              HasSubstr("the file is damaged: tiles of 65520 × 65520 pixels in a picture of 16 × 16"));
}

template <class Real>
std::vector<std::uint8_t> bytes_of(const std::vector<Real>& values) {
  const auto* bytes = reinterpret_cast<const std::uint8_t*>(values.data());
  return {bytes, bytes + values.size() * sizeof(Real)};
}

TEST(Picture, FloatingPointIsReadAsItIsAndNeverSaturated) {
  const TestFolder folder;
  const std::string path = folder.file("float.tif");
  write_tags(path, 3, 1, {.bits = 32, .format = SAMPLEFORMAT_IEEEFP}, [](int, int) {
    return bytes_of<float>({0.25F, 0, 0.75F});
  });
  EXPECT_THAT(read_picture(path).pixels, ::testing::ElementsAre(0.25F, 0, 0.75F));
  EXPECT_GT(read_picture(path).maximum, 0.75F);
  EXPECT_LT(read_picture(path).maximum, 0.7501F);
  write_tags(path, 2, 1, {.bits = 64, .format = SAMPLEFORMAT_IEEEFP}, [](int, int) {
    return bytes_of<double>({1000.5, 2});
  });
  EXPECT_THAT(read_picture(path).pixels, ::testing::ElementsAre(1000.5F, 2));
  for (const float bad : {std::numeric_limits<float>::quiet_NaN(), -1.0F}) {
    write_tags(path, 2, 1, {.bits = 32, .format = SAMPLEFORMAT_IEEEFP}, [&](int, int) {
      return bytes_of<float>({3, bad});
    });
    EXPECT_THAT(reason(path), HasSubstr(fmt::format("floating point, and pixel (1, 0) is {}: grey levels are "
                                                    "numbers from 0 on",
                                                    bad)));
  }
}

TEST(Picture, PagesAreNamedAndThoseThatAreTheSamePictureInSmallAreNone) {
  const TestFolder folder;
  const std::string path = folder.file("pages.tif");
  for (const std::uint32_t kind : {FILETYPE_REDUCEDIMAGE, 0}) {
    const auto row = [](int, int y) { return std::vector<std::uint8_t>{std::uint8_t(y), 9}; };
    write_tags(path, 2, 3, {}, row);
    TIFF* tiff = open_tiff(path, 2, 1, {}, "a");
    TIFFSetField(tiff, TIFFTAG_SUBFILETYPE, kind);
    TIFFWriteScanline(tiff, row(0, 7).data(), 0);
    TIFFClose(tiff);
    if (kind == FILETYPE_REDUCEDIMAGE) {
      EXPECT_THAT(read_picture(path).pixels, ::testing::ElementsAre(0, 9, 1, 9, 2, 9));
      EXPECT_THAT(pictures_in(path), ::testing::ElementsAre(path));
    }
  }
  EXPECT_THAT(reason(path), HasSubstr("a TIFF of 2 pages: \"pages.tif#1\" to \"pages.tif#2\" are its "
                                      "pictures, and `pictures = \"pages.tif\"` takes all"));
  EXPECT_THAT(pictures_in(path), ::testing::ElementsAre(path + "#1", path + "#2"));
  EXPECT_THAT(read_picture(path + "#1").pixels, ::testing::ElementsAre(0, 9, 1, 9, 2, 9));
  EXPECT_THAT(read_picture(path + "#2").pixels, ::testing::ElementsAre(7, 9));
  EXPECT_THAT(reason(path + "#3"), HasSubstr("there is no page 3 of 2"));
  EXPECT_THAT(reason(path + "#x"), HasSubstr("there is no such picture"));
  write_png(folder.file("one.png"), ramp(4, 4, 8));
  EXPECT_THAT(reason(folder.file("one.png") + "#2"), HasSubstr("only a TIFF has pages: there is no page 2"));
}

TEST(Picture, ExifTellsTheOrientation) {
  using namespace std::string_literals;
  const std::string little = "II*\0\x08\0\0\0\x02\0"s + "\x0F\x01\x03\0\x01\0\0\0\x09\0\0\0"s +
                             "\x12\x01\x03\0\x01\0\0\0\x06\0\0\0"s;
  const std::string big = "MM\0*\0\0\0\x08\0\x01"s + "\x01\x12\0\x03\0\0\0\x01\0\x03\0\0"s;
  EXPECT_EQ(picture_formats::exif_orientation(little), 6);
  EXPECT_EQ(picture_formats::exif_orientation(big), 3);
  for (std::size_t length = 0; length < little.size(); ++length)  // torn anywhere
    EXPECT_EQ(picture_formats::exif_orientation(little.substr(0, length)), 1);
  EXPECT_EQ(picture_formats::exif_orientation("II*\0\xFF\xFF\xFF\xFF"s), 1);
}

TEST(Picture, JpegIsReadWithARemark) {
  const TestFolder folder;
  const std::string path = folder.file("a.jpg");
  for (const int components : {1, 3}) {
    write_jpeg(path, components);
    const Picture p = read_picture(path);
    ASSERT_EQ(p.pixels.size(), 256U);
    for (int y = 0; y < 16; ++y)
      for (int x = 0; x < 16; ++x) EXPECT_NEAR(p.at(x, y), 100 + 4 * x + 3 * y, 2) << components;
    EXPECT_THAT(p.remark, HasSubstr("a.jpg: a JPEG: compression has altered the grey levels"));
  }
  write_jpeg(path, 3, 60);
  EXPECT_THAT(reason(path), HasSubstr("a picture in colour"));
  EXPECT_NEAR(read_picture(path, Colour::grey).at(8, 8), 156 - 0.587 * 60, 3);
  const std::string whole = read_text(path);
  for (const double share : {0.05, 0.3, 0.9}) {
    write_text_atomically(
        path, whole.substr(0, static_cast<std::size_t>(share * static_cast<double>(whole.size()))));
    EXPECT_THAT(reason(path), HasSubstr("a.jpg: error: ")) << share;
  }
}

/// By the header: whatever the format, nothing of the size it claims is allocated.
TEST(Picture, OneThatIsLargerThanExpectedIsNotDecoded) {
  const TestFolder folder;
  write_tiff(folder.file("a.tif"), ramp(20, 10, 8));
  write_png(folder.file("a.png"), ramp(20, 10, 16));
  write_text_atomically(folder.file("a.pgm"), "P5 20 10 255\n" + std::string(200, 'x'));
  for (const char* name : {"a.tif", "a.png", "a.pgm"}) {
    const std::string path = folder.file(name);
    EXPECT_EQ(read_picture(path, Colour::refuse, 200).width, 20) << name;
    try {
      (void)read_picture(path, Colour::refuse, 199);
      ADD_FAILURE() << name;
    } catch (const DataError& error) {
      EXPECT_THAT(error.what(), EndsWith("a picture of 20 × 10 pixels, more than the 199 that are expected"));
    }
  }
  write_text_atomically(folder.file("huge.pgm"), "P5 20000 20000 255\n");  // without its pixels
  EXPECT_THROW((void)read_picture(folder.file("huge.pgm"), Colour::refuse, 200), DataError);
}

TEST(Picture, SaysWhyAFileCannotBeRead) {
  const TestFolder folder;
  EXPECT_THAT(reason(folder.file("none.tif")), EndsWith("none.tif: error: there is no such picture"));
  write_text_atomically(folder.file("empty.tif"), "");
  EXPECT_THAT(reason(folder.file("empty.tif")), EndsWith("the file is empty"));
  write_text_atomically(folder.file("text.tif"), "this is not a picture at all");
  EXPECT_THAT(reason(folder.file("text.tif")),
              EndsWith("unsupported picture format; TIFF, PNG, JPEG, BMP and PGM can be read"));
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
