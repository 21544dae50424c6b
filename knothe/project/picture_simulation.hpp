#pragma once
/// @file `knothe simulate --images`: pictures of a test, as a camera would have taken them.
#include <optional>
#include <string>
#include <vector>

#include "knothe/model/compress/snapshots.hpp"
#include "knothe/project/project_file.hpp"
#include "knothe/project/simulation.hpp"

namespace knothe::project {

/// Draws the face that [dic] sees ([dic] scale, origin, view) with a speckle pattern, under the displacements
/// of the model at every `[simulate.camera] every`-th time: exact, since a pixel is the pattern at the
/// material point that it shows. Writes into `folder` reference_1.tif …, picture_0001.tif …, and pictures.csv
/// (time,file); and machine.csv with the outputs that [simulate.noise] names, at every time. Of [dic]
/// cameras, whose frame is then the model's, into camera_0, camera_1 … in `folder`. Errors: ProjectError for
/// what the project lacks, IoError; Interrupted, with what is drawn kept.
void simulate_pictures(const Project& project, const model::Mesh& mesh, const SimulatedField& simulated,
                       std::optional<std::uint64_t> seed, const std::string& folder);

}  // namespace knothe::project
