#pragma once
/// @file Grey pictures at full depth: TIFF, PNG, BMP, PGM; and JPEG, with a remark.
#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "knothe/base/enum_names.hpp"

namespace knothe::files {

/// Grey levels, row by row from the top; pixel centres are at integer coordinates, x to the right, y down.
struct Picture {
  int width = 0, height = 0;
  int bit_depth = 8;          ///< of the file: 8, 12 or 16 (1 to 16)
  float maximum = 255;        ///< the grey level of a saturated pixel; of floating point, one above all
  std::vector<float> pixels;  ///< width × height, as stored (0 … maximum), black is 0

  std::string remark;  ///< what is doubtful about measuring in it; mostly empty

  [[nodiscard]] float& at(int x, int y) { return pixels[index(x, y)]; }
  [[nodiscard]] float at(int x, int y) const { return pixels[index(x, y)]; }
  [[nodiscard]] const float* row(int y) const { return pixels.data() + index(0, y); }
  [[nodiscard]] std::size_t index(int x, int y) const { return static_cast<std::size_t>(y) * width + x; }
};

/// What is done with a picture in colour.
enum class Colour {
  refuse,
  grey  ///< its luminance is taken, 0.299 R + 0.587 G + 0.114 B (ITU-R BT.601)
};

constexpr auto names_of(Colour /*colour*/) {
  return std::to_array<Named<Colour>>({{Colour::refuse, "refuse"}, {Colour::grey, "grey"}});
}

/// Reads a picture; the format is told from the content, not from the name. One that is stored in colour, or
/// by a palette, but holds grey levels only is grey. Errors: DataError naming the file and the reason:
/// missing, unreadable, truncated, in colour, more than 16 bits, no page named, more than `max_pixels` by its
/// header (then nothing is decoded).
/// "stack.tif#3" is the third page of stack.tif.
[[nodiscard]] Picture read_picture(const std::string& path, Colour colour = Colour::refuse,
                                   std::int64_t max_pixels = std::int64_t{1} << 32);

/// What names of pictures end in: ".tif", ".tiff" and so on.
[[nodiscard]] const std::vector<std::string>& picture_endings();

/// Writes a grey TIFF of 8 or 16 bits (`bit_depth` ≤ 8: 8), rounding and clipping; atomic. Errors: IoError,
/// UsageError for a value that is not finite.
void write_tiff(const std::string& path, const Picture& picture);

/// The pictures of a file, for `read_picture`: the pages of a TIFF that has several, else the file itself.
[[nodiscard]] std::vector<std::string> pictures_in(const std::string& path);
/// The same as PNG.
void write_png(const std::string& path, const Picture& picture);
/// A picture in colour as PNG: `pixels` are red, green, blue, row by row. Errors: IoError.
void write_colour_png(const std::string& path, int width, int height, std::span<const std::uint8_t> pixels);

}  // namespace knothe::files
