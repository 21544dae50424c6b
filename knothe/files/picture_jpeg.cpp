#include <fmt/format.h>

#include <cstdio>
// After <cstdio>: the header of libjpeg does not include what it needs.
#include <jpeglib.h>

#include "knothe/files/picture_formats.hpp"

namespace knothe::files {
namespace {

using picture_formats::fail;

/// libjpeg's state and its error handler, which throws past it: it is built with unwind tables.
struct Decoder {
  jpeg_decompress_struct jpeg{};
  jpeg_error_mgr errors{};
  explicit Decoder(const std::string& path) {
    jpeg.err = jpeg_std_error(&errors);
    errors.error_exit = [](j_common_ptr common) {
      char text[JMSG_LENGTH_MAX];
      common->err->format_message(common, text);
      fail(*static_cast<const std::string*>(common->client_data),
           fmt::format("not a readable JPEG ({})", text));
    };
    errors.output_message = [](j_common_ptr) {};
    jpeg_create_decompress(&jpeg);
    jpeg.client_data = const_cast<std::string*>(&path);
  }
  ~Decoder() { jpeg_destroy_decompress(&jpeg); }
  Decoder(const Decoder&) = delete;
  Decoder& operator=(const Decoder&) = delete;
};

}  // namespace

Picture picture_formats::read_jpeg(const std::string& path, const std::string& bytes, Colour colour,
                                   std::int64_t max_pixels) {
  Decoder decoder(path);
  jpeg_decompress_struct& jpeg = decoder.jpeg;
  jpeg_mem_src(&jpeg, reinterpret_cast<const unsigned char*>(bytes.data()), bytes.size());
  jpeg_save_markers(&jpeg, JPEG_APP0 + 1, 0xFFFF);
  jpeg_read_header(&jpeg, TRUE);
  int orientation = 1;
  for (const jpeg_marker_struct* marker = jpeg.marker_list; marker != nullptr; marker = marker->next) {
    const std::string_view block(reinterpret_cast<const char*>(marker->data), marker->data_length);
    if (block.starts_with(std::string_view("Exif\0\0", 6))) orientation = exif_orientation(block.substr(6));
  }
  const bool grey = jpeg.num_components == 1;
  if (jpeg.num_components == 4) fail(path, "a JPEG of four inks (CMYK): save it in grey levels");
  if (!grey && jpeg.num_components != 3) fail(path, k_colour);
  jpeg.out_color_space = grey ? JCS_GRAYSCALE : JCS_RGB;
  Picture picture = sized(path, jpeg.image_width, jpeg.image_height, 8, bytes.size(), max_pixels);
  picture.remark = fmt::format(
      "{}: a JPEG: compression has altered the grey levels that the correlation uses, so the stated noise is "
      "unreliable; save TIFF or PNG if the camera can",
      path);
  jpeg_start_decompress(&jpeg);
  std::vector<unsigned char> row(static_cast<std::size_t>(picture.width) * (grey ? 1 : 3));
  for (int y = 0; y < picture.height; ++y) {
    JSAMPROW out = row.data();
    jpeg_read_scanlines(&jpeg, &out, 1);
    for (int x = 0; x < picture.width; ++x) {
      const auto sample = [&](int k) -> float { return row[k]; };
      picture.at(x, y) =
          grey ? sample(x) : grey_of(path, colour, sample(3 * x), sample(3 * x + 1), sample(3 * x + 2));
    }
  }
  if (decoder.errors.num_warnings > 0) fail(path, "the JPEG is truncated or damaged");
  jpeg_finish_decompress(&jpeg);
  return oriented(std::move(picture), orientation);
}

}  // namespace knothe::files
