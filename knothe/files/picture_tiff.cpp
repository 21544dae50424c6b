#include <fmt/format.h>
#include <tiffio.h>

#include <algorithm>
#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <filesystem>
#include <limits>
#include <memory>

#include "knothe/base/error.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/picture_formats.hpp"

namespace knothe::files {

namespace {

using picture_formats::fail;

struct CloseTiff {
  void operator()(TIFF* tiff) const { TIFFClose(tiff); }
};
using Tiff = std::unique_ptr<TIFF, CloseTiff>;

/// libtiff's last words on this thread; it has no other way to tell them.
thread_local std::string last_error, last_warning;

std::string text_of(const char* format, va_list arguments) {
  char text[512];
  std::vsnprintf(text, sizeof text, format, arguments);
  return text;
}
void remember_error(const char*, const char* format, va_list arguments) {
  last_error = text_of(format, arguments);
}
void remember_warning(const char*, const char* format, va_list arguments) {
  last_warning = text_of(format, arguments);
}

/// Why libtiff failed. Its fax decoders only warn, and zlib may leave the end of "ZLib error: " empty.
std::string reason() {
  const std::string& words = last_error.empty() ? last_warning : last_error;
  const auto end = words.find_last_not_of(": ");
  return end == std::string::npos ? "libtiff gives no reason" : words.substr(0, end + 1);
}

/// Sample `x` of a row whose samples are packed, most significant bit first, in `bits` bits each.
unsigned packed_sample(const unsigned char* row, std::size_t x, unsigned bits) {
  unsigned value = 0;
  for (std::size_t b = x * bits; b < (x + 1) * bits; ++b)
    value = 2 * value + ((row[b / 8] >> (7 - b % 8)) & 1U);
  return value;
}

/// Grey levels of 8 bits of a palette of 2^bits colours. Some programs write its entries in 8 bits, not 16.
std::vector<float> palette_levels(TIFF* tiff, const std::string& path, unsigned bits, Colour colour) {
  std::uint16_t *red = nullptr, *green = nullptr, *blue = nullptr;
  if (TIFFGetField(tiff, TIFFTAG_COLORMAP, &red, &green, &blue) != 1)
    fail(path, "a TIFF of a palette, without the palette");
  const std::size_t count = std::size_t{1} << bits;
  std::uint16_t largest = 0;
  for (const std::uint16_t* channel : {red, green, blue})
    largest = std::max(largest, *std::max_element(channel, channel + count));
  const float unit = largest > 255 ? 257.0F : 1.0F;
  std::vector<float> levels;
  for (std::size_t c = 0; c < count; ++c)
    levels.push_back(picture_formats::grey_of(path, colour, red[c] / unit, green[c] / unit, blue[c] / unit));
  return levels;
}

/// Rows of samples as a TIFF stores them, of strips or of tiles, from the first to the last.
class Rows {
 public:
  Rows(TIFF* tiff, const std::string& path, const Picture& picture)
      : tiff_(tiff), path_(path), bytes_(TIFFScanlineSize64(tiff)) {
    if (TIFFIsTiled(tiff) == 0) return;
    TIFFGetField(tiff, TIFFTAG_TILEWIDTH, &tile_width_);
    TIFFGetField(tiff, TIFFTAG_TILELENGTH, &tile_height_);
    constexpr std::size_t k_always = 1 << 22;  // pixels
    if (tile_width_ == 0 || tile_height_ == 0 ||
        std::size_t{tile_width_} * tile_height_ > std::max(k_always, picture.pixels.size()))
      fail(path, fmt::format("the file is damaged: tiles of {} × {} pixels in a picture of {} × {}",
                             tile_width_, tile_height_, picture.width, picture.height));
    tile_.resize(TIFFTileSize64(tiff));
    across_ = (picture.width + tile_width_ - 1) / tile_width_;
    bytes_ = across_ * TIFFTileRowSize64(tiff);
  }

  [[nodiscard]] std::size_t bytes() const { return bytes_; }  ///< of a row of one plane

  void read(std::uint32_t y, std::uint16_t plane, unsigned char* out) {
    if (tile_.empty()) {
      if (TIFFReadScanline(tiff_, out, y, plane) != 1) fail_at(y);
      return;
    }
    if (bands_.size() <= plane) bands_.resize(plane + 1);
    std::vector<unsigned char>& band = bands_[plane];  // a row of tiles, row by row
    if (y % tile_height_ == 0) {
      band.resize(bytes_ * tile_height_);
      const std::size_t part = bytes_ / across_;
      for (std::uint32_t t = 0; t < across_; ++t) {
        if (TIFFReadTile(tiff_, tile_.data(), t * tile_width_, y, 0, plane) < 0) fail_at(y);
        for (std::uint32_t k = 0; k < tile_height_; ++k)
          std::copy_n(tile_.data() + k * part, part, band.data() + k * bytes_ + t * part);
      }
    }
    std::copy_n(band.data() + y % tile_height_ * bytes_, bytes_, out);
  }

 private:
  [[noreturn]] void fail_at(std::uint32_t y) const {
    fail(path_, fmt::format("row {} cannot be read: the file is truncated or damaged ({})", y, reason()));
  }

  TIFF* tiff_;
  const std::string& path_;
  std::size_t bytes_;
  std::uint32_t tile_width_ = 0, tile_height_ = 0, across_ = 0;
  std::vector<unsigned char> tile_;
  std::vector<std::vector<unsigned char>> bands_;  ///< by plane
};

/// Grey levels of floating point have no largest one: none of the picture's is saturated.
void set_maximum_above(Picture& picture, const std::string& path) {
  for (std::size_t i = 0; i < picture.pixels.size(); ++i)
    if (const float level = picture.pixels[i]; !std::isfinite(level) || level < 0)
      fail(path, fmt::format("floating point, and pixel ({}, {}) is {}: grey levels are numbers from 0 on",
                             i % picture.width, i / picture.width, level));
  const float largest = *std::max_element(picture.pixels.begin(), picture.pixels.end());
  picture.maximum = std::nextafter(largest, std::numeric_limits<float>::infinity());
}

/// The pages that are no smaller copies of others.
std::vector<tdir_t> pages_of(TIFF* tiff) {
  std::vector<tdir_t> pages;
  do {
    std::uint32_t kind = 0;
    if (TIFFGetField(tiff, TIFFTAG_SUBFILETYPE, &kind) != 1 || (kind & FILETYPE_REDUCEDIMAGE) == 0)
      pages.push_back(TIFFCurrentDirectory(tiff));
  } while (TIFFReadDirectory(tiff) == 1);
  if (pages.empty()) pages.push_back(0);
  return pages;
}

Tiff open_tiff(const std::string& path) {
  TIFFSetErrorHandler(remember_error);
  TIFFSetWarningHandler(remember_warning);
  last_error.clear(), last_warning.clear();
  Tiff tiff(TIFFOpen(path.c_str(), "r"));
  if (!tiff) fail(path, fmt::format("not a readable TIFF ({})", reason()));
  return tiff;
}

/// Values rounded and clipped to what `bits` hold.
template <class Integer>
void round_row(const Picture& picture, int y, Integer* out) {
  const float top = (1 << (8 * sizeof(Integer))) - 1;
  for (int x = 0; x < picture.width; ++x) {
    const float value = picture.at(x, y);
    if (!std::isfinite(value))
      throw UsageError(fmt::format("write picture: pixel ({}, {}) is not finite", x, y));
    out[x] = static_cast<Integer>(std::clamp(std::round(value), 0.0F, top));
  }
}

}  // namespace

std::size_t picture_formats::tiff_pages(const std::string& path) {
  return pages_of(open_tiff(path).get()).size();
}

Picture picture_formats::read_tiff(const std::string& path, std::size_t page, std::size_t file_bytes,
                                   Colour colour, std::int64_t max_pixels) {
  const Tiff tiff = open_tiff(path);
  const std::vector<tdir_t> pages = pages_of(tiff.get());
  if (page == 0 && pages.size() > 1)
    fail(path, fmt::format("a TIFF of {0} pages: \"{1}#1\" to \"{1}#{0}\" are its pictures, and `pictures = "
                           "\"{1}\"` takes all",
                           pages.size(), std::filesystem::path(path).filename().string()));
  if (page > pages.size()) fail(path, fmt::format("there is no page {} of {}", page, pages.size()));
  if (TIFFSetDirectory(tiff.get(), pages[page == 0 ? 0 : page - 1]) != 1)
    fail(path, fmt::format("not a readable TIFF ({})", reason()));
  std::uint32_t width = 0, height = 0;
  std::uint16_t samples = 1, bits = 1, format = SAMPLEFORMAT_UINT, photometric = PHOTOMETRIC_MINISBLACK;
  TIFFGetField(tiff.get(), TIFFTAG_IMAGEWIDTH, &width);
  TIFFGetField(tiff.get(), TIFFTAG_IMAGELENGTH, &height);
  TIFFGetFieldDefaulted(tiff.get(), TIFFTAG_SAMPLESPERPIXEL, &samples);
  TIFFGetFieldDefaulted(tiff.get(), TIFFTAG_BITSPERSAMPLE, &bits);
  TIFFGetFieldDefaulted(tiff.get(), TIFFTAG_SAMPLEFORMAT, &format);
  TIFFGetField(tiff.get(), TIFFTAG_PHOTOMETRIC, &photometric);
  std::uint16_t planes = PLANARCONFIG_CONTIG;
  TIFFGetFieldDefaulted(tiff.get(), TIFFTAG_PLANARCONFIG, &planes);
  const bool whole_bytes = bits == 8 || bits == 16;
  if (samples > 8) fail(path, fmt::format("a TIFF of {} samples a pixel; save it in grey levels", samples));
  const bool rgb = photometric == PHOTOMETRIC_RGB && samples >= 3 && whole_bytes;
  const bool palette = photometric == PHOTOMETRIC_PALETTE && samples == 1 && bits <= 8;
  // Further samples are an alpha channel, say.
  const bool grey = (samples == 1 || whole_bytes) &&
                    (photometric == PHOTOMETRIC_MINISBLACK || photometric == PHOTOMETRIC_MINISWHITE);
  if (photometric == PHOTOMETRIC_SEPARATED) fail(path, "a TIFF of inks (CMYK): save it in grey levels");
  if (!grey && !rgb && !palette) fail(path, k_colour);
  const bool has_sign = format == SAMPLEFORMAT_INT && whole_bytes;
  const bool is_float = format == SAMPLEFORMAT_IEEEFP && samples == 1 && (bits == 32 || bits == 64) &&
                        photometric == PHOTOMETRIC_MINISBLACK;
  if (!is_float && ((format != SAMPLEFORMAT_UINT && !has_sign) || bits > 16))
    fail(path, fmt::format("a TIFF of {} bits a pixel{}; unsigned integers of up to 16 bits can be read, "
                           "signed ones that are not negative, and grey levels of floating point",
                           bits,
                           format == SAMPLEFORMAT_IEEEFP ? ", floating point"
                           : format == SAMPLEFORMAT_INT  ? ", signed integers"
                                                         : ""));
  Picture picture = sized(path, width, height, is_float ? 16 : palette ? 8 : bits, file_bytes, max_pixels);
  if (has_sign) picture.maximum = bits == 8 ? 127 : 32767;
  const std::vector<float> levels =
      palette ? palette_levels(tiff.get(), path, bits, colour) : std::vector<float>();
  const bool apart = samples > 1 && planes == PLANARCONFIG_SEPARATE;  // a row of each sample after the other
  Rows rows(tiff.get(), path, picture);
  const std::size_t row_bytes = rows.bytes();
  std::vector<unsigned char> row((apart ? samples : 1) * row_bytes + 2);
  for (std::uint32_t y = 0; y < height; ++y) {
    for (std::uint16_t plane = 0; plane < (apart ? samples : 1); ++plane)
      rows.read(y, plane, row.data() + plane * row_bytes);
    float* out = picture.pixels.data() + picture.index(0, y);
    const auto sample = [&](std::size_t x, std::size_t s) {
      const std::size_t k = apart ? x : samples * x + s;
      const unsigned char* of_plane = row.data() + (apart ? s * row_bytes : 0);
      const unsigned value = bits == 8 ? of_plane[k] : reinterpret_cast<const std::uint16_t*>(of_plane)[k];
      if (has_sign && value >> (bits - 1) != 0)
        fail(path,
             fmt::format("signed integers, and pixel ({}, {}) is negative: grey levels begin at 0", x, y));
      return static_cast<float>(value);
    };
    if (is_float)
      for (std::size_t x = 0; x < width; ++x)
        out[x] = bits == 32 ? reinterpret_cast<const float*>(row.data())[x]
                            : float(reinterpret_cast<const double*>(row.data())[x]);
    else if (rgb)
      for (std::size_t x = 0; x < width; ++x)
        out[x] = grey_of(path, colour, sample(x, 0), sample(x, 1), sample(x, 2));
    else if (samples > 1 || has_sign)
      for (std::size_t x = 0; x < width; ++x) out[x] = sample(x, 0);
    else if (palette)
      for (std::size_t x = 0; x < width; ++x) out[x] = levels[packed_sample(row.data(), x, bits)];
    else if (bits == 8)
      std::copy_n(row.data(), width, out);
    else if (bits == 16)
      std::copy_n(reinterpret_cast<const std::uint16_t*>(row.data()), width, out);
    else
      for (std::size_t x = 0; x < width; ++x) out[x] = packed_sample(row.data(), x, bits);
    if (photometric == PHOTOMETRIC_MINISWHITE)
      for (std::uint32_t x = 0; x < width; ++x) out[x] = picture.maximum - out[x];
  }
  if (is_float) set_maximum_above(picture, path);
  std::uint16_t orientation = 1;
  TIFFGetFieldDefaulted(tiff.get(), TIFFTAG_ORIENTATION, &orientation);
  return oriented(std::move(picture), orientation);
}

void write_tiff(const std::string& path, const Picture& picture) {
  const int bits = picture.bit_depth <= 8 ? 8 : 16;
  write_atomically(path, [&](const std::string& temporary) {
    TIFFSetErrorHandler(remember_error);
    const Tiff tiff(TIFFOpen(temporary.c_str(), "w"));
    if (!tiff) throw system_error("could not write the picture", path);
    TIFFSetField(tiff.get(), TIFFTAG_IMAGEWIDTH, static_cast<std::uint32_t>(picture.width));
    TIFFSetField(tiff.get(), TIFFTAG_IMAGELENGTH, static_cast<std::uint32_t>(picture.height));
    TIFFSetField(tiff.get(), TIFFTAG_BITSPERSAMPLE, bits);
    TIFFSetField(tiff.get(), TIFFTAG_SAMPLESPERPIXEL, 1);
    TIFFSetField(tiff.get(), TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_MINISBLACK);
    TIFFSetField(tiff.get(), TIFFTAG_COMPRESSION, COMPRESSION_NONE);
    TIFFSetField(tiff.get(), TIFFTAG_ROWSPERSTRIP, 64);
    std::vector<std::uint16_t> row(picture.width);
    for (int y = 0; y < picture.height; ++y) {
      if (bits == 8)
        round_row(picture, y, reinterpret_cast<std::uint8_t*>(row.data()));
      else
        round_row(picture, y, row.data());
      if (TIFFWriteScanline(tiff.get(), row.data(), y) != 1)
        throw system_error("could not write the picture", path);
    }
    if (TIFFFlush(tiff.get()) != 1) throw system_error("could not write the picture", path);
  });
}

}  // namespace knothe::files
