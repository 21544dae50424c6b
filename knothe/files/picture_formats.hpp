#pragma once
/// @file Picture formats that need a library. Private to the room.
#include <string>
#include <string_view>

#include "knothe/files/picture.hpp"

namespace knothe::files::picture_formats {

inline constexpr const char* k_colour =
    "a picture in colour; image correlation needs grey levels: convert it (for a raw Bayer picture use one "
    "channel), or have its luminance taken (dic.colour = \"grey\", --grey)";

/// Throws DataError "path: error: reason".
[[noreturn]] void fail(const std::string& path, const std::string& reason);
/// An empty picture of that size; fails on sizes that make no sense, also for a file of `file_bytes`: no
/// compression of a grey picture saves so much, and memory is not taken on the word of a damaged header. And
/// on one of more than `max_pixels`.
[[nodiscard]] Picture sized(const std::string& path, std::int64_t width, std::int64_t height, int bit_depth,
                            std::size_t file_bytes, std::int64_t max_pixels);

/// The grey level of a pixel in colour. Fails where its channels differ and colour is refused.
[[nodiscard]] float grey_of(const std::string& path, Colour colour, float red, float green, float blue);

/// The picture as viewers show it: `orientation` as in TIFF and Exif, 1 (as stored) to 8; another number
/// counts as 1.
[[nodiscard]] Picture oriented(Picture picture, int orientation);
/// The orientation that a block of Exif data (TIFF's layout) tells; 1 where it tells none.
[[nodiscard]] int exif_orientation(std::string_view block);

/// `page`: from 1; 0: the only one.
[[nodiscard]] Picture read_tiff(const std::string& path, std::size_t page, std::size_t file_bytes,
                                Colour colour, std::int64_t max_pixels);
/// Pages that are no smaller copies of others.
[[nodiscard]] std::size_t tiff_pages(const std::string& path);
[[nodiscard]] Picture read_png(const std::string& path, const std::string& bytes, Colour colour,
                               std::int64_t max_pixels);
[[nodiscard]] Picture read_jpeg(const std::string& path, const std::string& bytes, Colour colour,
                                std::int64_t max_pixels);

}  // namespace knothe::files::picture_formats
