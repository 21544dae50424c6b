/// @file Surface meshes of Gmsh and VTK: the first letter tells which.
#include "fuzz/support.hpp"
#include "knothe/files/surface_mesh.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string text = knothe::fuzz::text_of(data, size);
  knothe::fuzz::refuse_or_accept([&] {
    const auto mesh = text.starts_with("$") ? knothe::files::parse_gmsh(text, "a.msh")
                                            : knothe::files::parse_vtu(text, "a.vtu");
    const auto points = static_cast<std::int64_t>(mesh.points.size() / 3);
    for (const auto& cell : mesh.cells)
      for (const std::int64_t node : cell)
        if (node < -1 || node >= points) std::abort();
  });
  return 0;
}
