#pragma once
/// @file A mesh for correlation from a file of Gmsh or VTK.
#include <optional>
#include <string>

#include "knothe/imaging/mesh/image_mesh.hpp"
#include "knothe/imaging/mesh/registration.hpp"

namespace knothe::imaging {

/// The file's triangles and quadrilaterals. Without `frame` its x and y are pixels of the reference picture,
/// y down. With it they are metres in the model's frame; of a mesh that is not plane those elements are taken
/// that lie in the face which the camera sees. Errors: DataError for the file (files::read_surface_mesh), and
/// where none of its elements is in that face.
[[nodiscard]] ImageMesh read_image_mesh(const std::string& path, const std::optional<PictureFrame>& frame);

}  // namespace knothe::imaging
