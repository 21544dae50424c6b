#pragma once
/// @file Where the pictures of a project are in the model, fitted to the outline of the body where the
/// project asks for that.
#include <optional>
#include <string>

#include "knothe/imaging/mesh/outline_registration.hpp"
#include "knothe/imaging/stereo/stereo_series.hpp"
#include "knothe/project/project_file.hpp"

namespace knothe::project {

/// Whether the model's mesh is needed for it: the outline is the model's own.
[[nodiscard]] bool needs_model_outline(const Project& project);

/// [dic] registration = "outline": fits the project's frame to the outline seen in the first reference (or
/// the picture named for it) and puts it in the project. Nothing where the frame is given. `live`: the
/// references are in the folder that the service watches. Errors: ProjectError where there is no outline,
/// DataError as of fit_outline and for the picture.
std::optional<imaging::OutlineFit> register_pictures(Project& project, const std::optional<model::Mesh>& mesh,
                                                     bool live = false);

/// The frame of the cameras of the project ([dic] cameras) becomes the model's, by its pixels and points
/// where they are given, and the mesh the model's surface where that is asked for. Returns a line for people,
/// empty where nothing was fitted. Errors: ProjectError, those of fit_stereo_pose and StereoSeries.
std::string register_cameras(const Project& project, const std::optional<model::Mesh>& mesh,
                             imaging::StereoOptions& cameras);

/// One line for people: scale, turn, and how well the edges lie on the outline.
[[nodiscard]] std::string registration_text(const imaging::OutlineFit& fit);

}  // namespace knothe::project
