#include "knothe/files/picture.hpp"

#include <fmt/format.h>

#include <array>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <utility>

#include "knothe/base/error.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/picture_formats.hpp"

namespace knothe::files {

namespace picture_formats {

void fail(const std::string& path, const std::string& reason) {
  throw DataError(fmt::format("{}: error: {}", path, reason));
}

Picture sized(const std::string& path, std::int64_t width, std::int64_t height, int bit_depth,
              std::size_t file_bytes, std::int64_t max_pixels) {
  constexpr std::int64_t k_largest = 65535;
  constexpr std::int64_t k_always = 1 << 20, k_per_byte = 4096;  // pixels
  if (width < 1 || height < 1 || width > k_largest || height > k_largest)
    fail(path, fmt::format("a picture of {} × {} pixels; 1 × 1 to {} × {} are possible", width, height,
                           k_largest, k_largest));
  if (width * height > max_pixels)
    fail(path, fmt::format("a picture of {} × {} pixels, more than the {} that are expected", width, height,
                           max_pixels));
  if (width * height > k_always + k_per_byte * static_cast<std::int64_t>(file_bytes))
    fail(path, fmt::format("the file is truncated or damaged: it says {} × {} pixels and has {} bytes", width,
                           height, file_bytes));
  Picture picture;
  picture.width = width;
  picture.height = height;
  picture.bit_depth = bit_depth;
  picture.maximum = (1 << bit_depth) - 1;
  picture.pixels.resize(width * height);
  return picture;
}

float grey_of(const std::string& path, Colour colour, float red, float green, float blue) {
  if (red == green && green == blue) return red;
  if (colour == Colour::refuse) fail(path, k_colour);
  return 0.299F * red + 0.587F * green + 0.114F * blue;
}

}  // namespace picture_formats

namespace {

using namespace picture_formats;

/// The next number of a PGM header; comments run from '#' to the end of the line.
long header_number(const std::string& path, const std::string& bytes, std::size_t& at) {
  while (at < bytes.size()) {
    if (bytes[at] == '#')
      while (at < bytes.size() && bytes[at] != '\n') ++at;
    else if (std::isspace(static_cast<unsigned char>(bytes[at])) != 0)
      ++at;
    else
      break;
  }
  long value = 0;
  const std::size_t begin = at;
  while (at < bytes.size() && bytes[at] >= '0' && bytes[at] <= '9' && value < 1000000000)
    value = 10 * value + (bytes[at++] - '0');
  if (at == begin) fail(path, "the PGM header is damaged: a number is missing");
  return value;
}

/// PGM, and PPM with three numbers for each pixel.
Picture read_pgm(const std::string& path, const std::string& bytes, Colour colour, std::int64_t max_pixels) {
  const bool plain = bytes[1] == '2' || bytes[1] == '3';
  const std::size_t channels = bytes[1] == '3' || bytes[1] == '6' ? 3 : 1;
  std::size_t at = 2;
  const long width = header_number(path, bytes, at), height = header_number(path, bytes, at),
             maximum = header_number(path, bytes, at);
  if (maximum < 1 || maximum > 65535) fail(path, fmt::format("PGM maximum {} is not in 1 … 65535", maximum));
  int bits = 1;
  while ((1L << bits) - 1 < maximum) ++bits;
  Picture picture = sized(path, width, height, bits, bytes.size(), max_pixels);
  picture.maximum = maximum;
  const std::size_t size = maximum > 255 ? 2 : 1, needed = picture.pixels.size() * channels * size;
  if (!plain && bytes.size() < ++at + needed)  // one white space
    fail(path,
         fmt::format("the file is truncated: {} bytes of pixels are missing", at + needed - bytes.size()));
  const auto next = [&] {
    long value = 0;
    if (plain)
      value = header_number(path, bytes, at);
    else
      for (std::size_t i = 0; i < size; ++i) value = 256 * value + static_cast<unsigned char>(bytes[at++]);
    if (value > maximum) fail(path, fmt::format("a grey level of {} above the maximum {}", value, maximum));
    return static_cast<float>(value);
  };
  for (float& pixel : picture.pixels) {
    pixel = next();
    if (channels == 1) continue;
    const float green = next(), blue = next();
    pixel = grey_of(path, colour, pixel, green, blue);
  }
  return picture;
}

std::uint32_t little_endian(const std::string& bytes, std::size_t at, int count) {
  std::uint32_t value = 0;
  for (int i = count; i-- > 0;) value = 256 * value + static_cast<unsigned char>(bytes[at + i]);
  return value;
}

/// Uncompressed Windows bitmaps of 8 bits with a palette, or 24 and 32 bits.
Picture read_bmp(const std::string& path, const std::string& bytes, Colour colour, std::int64_t max_pixels) {
  if (bytes.size() < 54) fail(path, "the file is truncated: it ends within the BMP header");
  const std::size_t pixels_at = little_endian(bytes, 10, 4), header = little_endian(bytes, 14, 4);
  const std::int32_t width = little_endian(bytes, 18, 4);
  const std::int32_t stored_height = little_endian(bytes, 22, 4);
  const std::uint32_t bits = little_endian(bytes, 28, 2), compression = little_endian(bytes, 30, 4);
  if (compression != 0 && compression != 3)
    fail(path, "a compressed BMP; save it uncompressed, or as TIFF or PNG");
  if (bits != 8 && bits != 24 && bits != 32)
    fail(path, fmt::format("a BMP of {} bits a pixel; 8, 24 and 32 can be read", bits));
  Picture picture =
      sized(path, width, std::abs(static_cast<std::int64_t>(stored_height)), 8, bytes.size(), max_pixels);
  const std::size_t w = picture.width, step = bits / 8, row_bytes = (w * step + 3) / 4 * 4;
  if (bytes.size() < pixels_at + row_bytes * picture.height)
    fail(path, "the file is truncated: pixels are missing");
  std::array<float, 256> grey{};
  const auto grey_at = [&](std::size_t at) {  // blue, green, red
    const auto channel = [&](std::size_t k) {
      return static_cast<float>(static_cast<unsigned char>(bytes[at + k]));
    };
    return grey_of(path, colour, channel(2), channel(1), channel(0));
  };
  if (bits == 8) {
    std::size_t colours = little_endian(bytes, 46, 4);
    if (colours == 0 || colours > 256) colours = 256;
    if (bytes.size() < 14 + header + 4 * colours)
      fail(path, "the file is truncated: it ends within the BMP palette");
    for (std::size_t c = 0; c < colours; ++c) grey[c] = grey_at(14 + header + 4 * c);
  }
  for (int y = 0; y < picture.height; ++y) {
    const int from = stored_height > 0 ? picture.height - 1 - y : y;
    const std::size_t row = pixels_at + row_bytes * from;
    for (std::size_t x = 0; x < w; ++x)
      picture.at(x, y) =
          bits == 8 ? grey[static_cast<unsigned char>(bytes[row + x])] : grey_at(row + x * step);
  }
  return picture;
}

/// How files of a format end and begin, and who reads them (a TIFF, for its pages, from the file itself).
struct Format {
  std::string_view name;
  std::vector<std::string_view> endings, begins;
  Picture (*read)(const std::string& path, const std::string& bytes, Colour colour, std::int64_t max_pixels);
};

const std::vector<Format>& formats() {
  using namespace std::string_view_literals;
  static const std::vector<Format> k_formats{
      {"TIFF", {".tif", ".tiff"}, {"II*\0"sv, "MM\0*"sv, "II+\0"sv, "MM\0+"sv}, nullptr},
      {"PNG", {".png"}, {"\x89PNG"}, read_png},
      {"JPEG", {".jpg", ".jpeg"}, {"\xFF\xD8\xFF"}, read_jpeg},
      {"BMP", {".bmp"}, {"BM"}, read_bmp},
      {"PGM", {".pgm"}, {"P2", "P3", "P5", "P6"}, read_pgm},
  };
  return k_formats;
}

/// Null where it is none of them.
const Format* format_of(std::string_view bytes) {
  for (const Format& format : formats())
    for (const std::string_view begin : format.begins)
      if (bytes.starts_with(begin)) return &format;
  return nullptr;
}

bool is_tiff(const std::string& path) {
  std::string begin(4, '\0');
  std::ifstream(path, std::ios::binary).read(begin.data(), 4);
  return format_of(begin) == formats().data();
}

}  // namespace

Picture picture_formats::oriented(Picture picture, int orientation) {
  if (orientation < 2 || orientation > 8) return picture;
  const bool turned = orientation > 4;
  const int w = picture.width, h = picture.height;
  const bool from_right = orientation == 2 || orientation == 3 || orientation == 7 || orientation == 8;
  const bool from_below = orientation == 3 || orientation == 4 || orientation == 6 || orientation == 7;
  Picture result = picture;
  result.width = turned ? h : w, result.height = turned ? w : h;
  for (int y = 0; y < result.height; ++y) {
    for (int x = 0; x < result.width; ++x) {
      const int column = turned ? y : x, row = turned ? x : y;  // of the stored picture
      result.at(x, y) = picture.at(from_right ? w - 1 - column : column, from_below ? h - 1 - row : row);
    }
  }
  return result;
}

int picture_formats::exif_orientation(std::string_view block) {
  if (block.size() < 8) return 1;
  const bool little = block.starts_with("II");
  const auto number = [&](std::size_t at, int count) {
    unsigned value = 0;
    for (int k = 0; k < count; ++k)
      value |= unsigned{static_cast<unsigned char>(block[at + k])} << 8 * (little ? k : count - 1 - k);
    return value;
  };
  const std::size_t directory = number(4, 4);
  if (directory > block.size() || block.size() - directory < 2) return 1;
  const std::size_t count = number(directory, 2);
  for (std::size_t k = 0; k < count && directory + 14 + 12 * k <= block.size(); ++k) {
    const std::size_t entry = directory + 2 + 12 * k;
    if (number(entry, 2) == 0x0112 && number(entry + 2, 2) == 3) return number(entry + 8, 2);
  }
  return 1;
}

namespace {

/// "stack.tif#3": stack.tif, 3; 0 where it is no such name, or there is a file of it.
std::pair<std::string, std::size_t> file_and_page(const std::string& path) {
  std::error_code failure;
  const std::size_t mark = path.rfind('#');
  std::size_t page = 0;
  if (mark == std::string::npos || std::filesystem::exists(path, failure)) return {path, 0};
  const char* end = path.data() + path.size();
  const auto [rest, error] = std::from_chars(path.data() + mark + 1, end, page);
  if (error != std::errc() || rest != end || page == 0) return {path, 0};
  return {path.substr(0, mark), page};
}

}  // namespace

std::vector<std::string> pictures_in(const std::string& path) {
  const std::size_t pages = is_tiff(path) ? tiff_pages(path) : 1;
  if (pages == 1) return {path};
  std::vector<std::string> names;
  for (std::size_t page = 1; page <= pages; ++page) names.push_back(fmt::format("{}#{}", path, page));
  return names;
}

Picture read_picture(const std::string& name, Colour colour, std::int64_t max_pixels) {
  std::error_code failure;
  const auto [path, page] = file_and_page(name);
  if (!std::filesystem::exists(path, failure)) fail(path, "there is no such picture");
  if (std::filesystem::is_directory(path, failure)) fail(path, "this is a folder, not a picture");
  if (is_tiff(path)) return read_tiff(path, page, std::filesystem::file_size(path), colour, max_pixels);
  if (page > 0) fail(path, fmt::format("only a TIFF has pages: there is no page {}", page));
  std::string bytes;
  try {
    bytes = read_text(path);
  } catch (const IoError& error) {
    fail(path, error.what());
  }
  if (bytes.size() < 8)
    fail(path, bytes.empty() ? "the file is empty" : "the file is too short for a picture");
  if (const Format* format = format_of(bytes)) return format->read(path, bytes, colour, max_pixels);
  std::vector<std::string_view> names;
  for (const Format& known : formats()) names.push_back(known.name);
  fail(path, fmt::format("unsupported picture format; {} and {} can be read",
                         fmt::join(names.begin(), names.end() - 1, ", "), names.back()));
}

const std::vector<std::string>& picture_endings() {
  static const std::vector<std::string> k_endings = [] {
    std::vector<std::string> all;
    for (const Format& format : formats())
      all.insert(all.end(), format.endings.begin(), format.endings.end());
    return all;
  }();
  return k_endings;
}

}  // namespace knothe::files
