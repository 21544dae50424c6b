/// @file Pictures: TIFF, PNG, BMP, PGM, told apart by their content.
#include "fuzz/support.hpp"
#include "knothe/files/picture.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string& path = knothe::fuzz::write_scratch(data, size);
  knothe::fuzz::refuse_or_accept([&] {
    const auto picture = knothe::files::read_picture(path);
    for (const float grey : picture.pixels)
      if (!(grey >= 0 && grey <= picture.maximum)) std::abort();
  });
  return 0;
}
