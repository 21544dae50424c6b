#include <fmt/format.h>
#include <png.h>

#include <algorithm>
#include <cmath>
#include <cstring>

#include "knothe/base/error.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/picture_bytes.hpp"
#include "knothe/files/picture_formats.hpp"

namespace knothe::files {

namespace {

using picture_formats::fail;

/// Position in a PNG that lies in memory.
struct Source {
  const std::string* bytes;
  std::size_t at;
};

void read_bytes(png_structp png, png_bytep out, png_size_t count) {
  auto& source = *static_cast<Source*>(png_get_io_ptr(png));
  if (source.bytes->size() - source.at < count) png_error(png, "the file is truncated");
  std::memcpy(out, source.bytes->data() + source.at, count);
  source.at += count;
}
void append_bytes(png_structp png, png_bytep bytes, png_size_t count) {
  static_cast<std::string*>(png_get_io_ptr(png))->append(reinterpret_cast<const char*>(bytes), count);
}
void no_flush(png_structp) {}
/// libpng wants its errors thrown past it; it is built with unwind tables, and C++ exceptions pass through.
[[noreturn]] void throw_error(png_structp png, png_const_charp message) {
  const auto* path = static_cast<const std::string*>(png_get_error_ptr(png));
  fail(*path, fmt::format("not a readable PNG ({})", message));
}
void ignore_warning(png_structp, png_const_charp) {}

/// Frees libpng's structures of reading.
struct Reader {
  png_structp png;
  png_infop info;
  explicit Reader(const std::string& path)
      : png(png_create_read_struct(PNG_LIBPNG_VER_STRING, const_cast<std::string*>(&path), throw_error,
                                   ignore_warning)),
        info(png_create_info_struct(png)) {}
  ~Reader() { png_destroy_read_struct(&png, &info, nullptr); }
  Reader(const Reader&) = delete;
  Reader& operator=(const Reader&) = delete;
};
struct Writer {
  png_structp png;
  png_infop info;
  explicit Writer(const std::string& path)
      : png(png_create_write_struct(PNG_LIBPNG_VER_STRING, const_cast<std::string*>(&path), throw_error,
                                    ignore_warning)),
        info(png_create_info_struct(png)) {}
  ~Writer() { png_destroy_write_struct(&png, &info); }
  Writer(const Writer&) = delete;
  Writer& operator=(const Writer&) = delete;
};

}  // namespace

Picture picture_formats::read_png(const std::string& path, const std::string& bytes, Colour colour,
                                  std::int64_t max_pixels) {
  Reader reader(path);
  Source source{&bytes, 0};
  png_set_read_fn(reader.png, &source, read_bytes);
  png_read_info(reader.png, reader.info);
  const int type = png_get_color_type(reader.png, reader.info);
  const int bits = type == PNG_COLOR_TYPE_PALETTE ? 8 : png_get_bit_depth(reader.png, reader.info);
  if (type == PNG_COLOR_TYPE_PALETTE)
    png_set_palette_to_rgb(reader.png);
  else if (bits < 8)
    png_set_packing(reader.png);
  png_set_strip_alpha(reader.png);
  const int passes = png_set_interlace_handling(reader.png);
  png_read_update_info(reader.png, reader.info);
  Picture picture = sized(path, png_get_image_width(reader.png, reader.info),
                          png_get_image_height(reader.png, reader.info), bits, bytes.size(), max_pixels);
  const bool in_colour = (type & PNG_COLOR_MASK_COLOR) != 0;
  const std::size_t row_bytes = png_get_rowbytes(reader.png, reader.info);
  std::vector<unsigned char> all(row_bytes * picture.height);
  for (int pass = 0; pass < passes; ++pass)
    for (int y = 0; y < picture.height; ++y) png_read_row(reader.png, all.data() + row_bytes * y, nullptr);
  for (int y = 0; y < picture.height; ++y) {
    const unsigned char* row = all.data() + row_bytes * y;
    const auto sample = [&](int k) {
      return static_cast<float>(bits == 16 ? 256 * row[2 * k] + row[2 * k + 1] : row[k]);
    };
    for (int x = 0; x < picture.width; ++x)
      picture.at(x, y) =
          in_colour ? grey_of(path, colour, sample(3 * x), sample(3 * x + 1), sample(3 * x + 2)) : sample(x);
  }
  return picture;
}

namespace {

/// `path`: what messages call it.
std::string encoded(const std::string& path, const Picture& picture) {
  const int bits = picture.bit_depth <= 8 ? 8 : 16;
  std::string bytes;
  {
    Writer writer(path);
    png_set_write_fn(writer.png, &bytes, append_bytes, no_flush);
    png_set_IHDR(writer.png, writer.info, picture.width, picture.height, bits, PNG_COLOR_TYPE_GRAY,
                 PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
    png_write_info(writer.png, writer.info);
    std::vector<unsigned char> row(static_cast<std::size_t>(picture.width) * 2);
    const float top = (1 << bits) - 1;
    for (int y = 0; y < picture.height; ++y) {
      for (int x = 0; x < picture.width; ++x) {
        const float value = picture.at(x, y);
        if (!std::isfinite(value))
          throw UsageError(fmt::format("write picture: pixel ({}, {}) is not finite", x, y));
        const unsigned level = std::clamp(std::round(value), 0.0F, top);
        if (bits == 8) {
          row[x] = static_cast<unsigned char>(level);
        } else {
          row[2 * static_cast<std::size_t>(x)] = static_cast<unsigned char>(level / 256);
          row[2 * static_cast<std::size_t>(x) + 1] = static_cast<unsigned char>(level % 256);
        }
      }
      png_write_row(writer.png, row.data());
    }
    png_write_end(writer.png, writer.info);
  }
  return bytes;
}

}  // namespace

void write_png(const std::string& path, const Picture& picture) {
  write_text_atomically(path, encoded(path, picture));
}

std::string png_bytes(const Picture& picture) {
  return encoded("picture", picture);
}

void write_colour_png(const std::string& path, int width, int height, std::span<const std::uint8_t> pixels) {
  std::string bytes;
  {
    Writer writer(path);
    png_set_write_fn(writer.png, &bytes, append_bytes, no_flush);
    png_set_IHDR(writer.png, writer.info, width, height, 8, PNG_COLOR_TYPE_RGB, PNG_INTERLACE_NONE,
                 PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
    png_write_info(writer.png, writer.info);
    for (int y = 0; y < height; ++y) png_write_row(writer.png, pixels.data() + std::size_t{3} * y * width);
    png_write_end(writer.png, writer.info);
  }
  write_text_atomically(path, bytes);
}

}  // namespace knothe::files
