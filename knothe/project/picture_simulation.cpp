#include "knothe/project/picture_simulation.hpp"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <span>

#include "knothe/base/cancellation.hpp"
#include "knothe/base/index.hpp"
#include "knothe/base/progress.hpp"
#include "knothe/base/threads.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/csv.hpp"
#include "knothe/files/numbers.hpp"
#include "knothe/files/picture.hpp"
#include "knothe/imaging/mesh/mesh_field.hpp"
#include "knothe/imaging/series/speckle.hpp"
#include "knothe/imaging/stereo/drawn_view.hpp"
#include "knothe/imaging/stereo/stereo_series.hpp"
#include "knothe/model/observe/observation_operator.hpp"
#include "knothe/project/picture_measurements.hpp"

namespace knothe::project {
namespace {

/// Displacements of the nodes of the face, m, from the model's dofs.
class FaceDisplacement {
 public:
  FaceDisplacement(const imaging::ImageMesh& face, const imaging::PictureFrame& frame,
                   std::span<const int> components, const model::Dofs& dofs, const model::Mesh& mesh) {
    model::Dofs places;
    for (std::size_t a = 0; a < face.x.size(); ++a) {
      const auto point = frame.model_point(face.x[a], face.y[a]);
      for (const int component : components) places.add(point, component);
    }
    const model::ObservationOperator observed(dofs, mesh, "the model", places);
    for (std::size_t i = 0; i < places.components.size(); ++i)
      for (const auto& entry : observed.row(i)) {
        rows_.push_back({i, entry.weight}), dofs_.push_back(entry.dof);
      }
    count_ = places.components.size();
  }

  [[nodiscard]] Eigen::VectorXd at(std::size_t step, const DisplacementField& field) const {
    const std::vector<double> values = field(step, dofs_);
    Eigen::VectorXd u = Eigen::VectorXd::Zero(count_);
    for (std::size_t k = 0; k < rows_.size(); ++k) u[rows_[k].first] += rows_[k].second * values[k];
    return u;
  }

 private:
  std::vector<std::pair<std::size_t, double>> rows_;
  std::vector<std::size_t> dofs_;
  std::size_t count_ = 0;
};

/// What a testing machine records beside the pictures.
void write_machine(const std::map<std::string, likelihood::MeasuredSeries>& series,
                   const std::vector<double>& time, const std::string& folder) {
  if (series.empty()) return;
  std::vector<std::string> header{"time"};
  for (const auto& [name, one] : series)
    header.push_back(one.units.empty() ? name : fmt::format("{} [{}]", name, one.units));
  files::CsvWriter table(header);
  for (std::size_t t = 0; t < time.size(); ++t) {
    std::vector<double> row{time[t]};
    for (const auto& [name, one] : series) row.push_back(one.values[t]);
    table.add_row(row);
  }
  table.write((std::filesystem::path(folder) / "machine.csv").string());
}

using Taken = imaging::SpeckleCamera;

/// With a lens that distorts, where `frame` says; at any distance, since it looks straight at the face.
imaging::Camera behind_lens(const imaging::PictureFrame& frame) {
  imaging::Camera camera = *frame.lens;
  const auto column = [&](const std::array<double, 3>& point) {
    return Eigen::Vector3d(point[0], point[1], point[2]);
  };
  // Model places of the pixels of the straightened picture, which are one px apart.
  imaging::PictureFrame straight = frame;
  straight.lens.reset();
  const Eigen::Vector3d middle = column(straight.model_point(camera.cx, camera.cy)),
                        right = column(straight.model_point(camera.cx + 1, camera.cy)) - middle,
                        down = column(straight.model_point(camera.cx, camera.cy + 1)) - middle;
  const double scale = frame.scale();
  camera.rotation.row(0) = right.transpose() / scale;
  camera.rotation.row(1) = down.transpose() / scale;
  camera.rotation.row(2) = right.cross(down).transpose() / (scale * scale);
  camera.translation = Eigen::Vector3d(0, 0, scale * camera.fx) - camera.rotation * middle;
  return camera;
}

std::vector<imaging::Camera> cameras_of(const Project& project, const model::Mesh& mesh) {
  const PictureOptions& p = project.pictures;
  if (!p.lens.empty()) return {behind_lens(picture_frame_of(project, mesh))};
  if (p.cameras.empty()) return {};
  if (!p.pixels.empty())
    throw project.error_at("dic.pixels",
                           "\"dic.pixels\" are found in pictures: to draw those, give a calibration in the "
                           "model's frame");
  return imaging::cameras_in_metres(p.cameras, p.camera_unit, "").cameras;
}

/// A camera that looks straight at the face, with the resolution of `camera`; the face begins at pixel (0,
/// 0).
imaging::PictureFrame straight_frame(const Project& project, const model::Mesh& mesh,
                                     const imaging::Camera& camera) {
  const imaging::PictureFrame face = model_face(project, mesh);
  const imaging::Region bounds = surface_mesh(mesh, face, project).bounds();  // m, y down
  const auto middle = face.model_point(0.5 * (bounds.x0 + bounds.x1), 0.5 * (bounds.y0 + bounds.y1));
  const double scale = std::sqrt(2.0) / camera.project({middle[0], middle[1], middle[2]}).jacobian.norm();
  imaging::PictureFrame frame = imaging::picture_frame(scale, {-bounds.x0 / scale, -bounds.y0 / scale});
  frame.view = face.view, frame.plane = face.plane;
  return frame;
}

/// The face of the model, at rest and displaced, as pictures show it: of one camera that looks straight at
/// it, through a lens or without, or of those of a calibration whose frame is the model's.
class DrawnFace {
 public:
  DrawnFace(const Project& project, const model::Mesh& mesh, const model::Dofs& dofs, std::uint64_t seed)
      : taken_(*project.simulate->camera),
        cameras_(cameras_of(project, mesh)),
        frame_(cameras_.empty() ? picture_frame_of(project, mesh)
                                : straight_frame(project, mesh, cameras_.front())),
        surface_(surface_mesh(mesh, frame_, project)),
        across_(surface_.mesh()),
        axes_{frame_.components()[0], frame_.components()[1], 3 - frame_.components()[1]},
        displacement_(surface_.mesh(), frame_, std::span(axes_).first(cameras_.size() < 2 ? 2 : 3), dofs,
                      mesh),
        pattern_({.width = cameras_.empty() ? taken_.width : extent(surface_.mesh().bounds().x1),
                  .height = cameras_.empty() ? taken_.height : extent(surface_.mesh().bounds().y1),
                  .dot_radius = taken_.dot_radius,
                  .seed = seed}) {}

  [[nodiscard]] Index cameras() const { return std::max<Index>(1, std::ssize(cameras_)); }
  void displace(std::size_t step, const DisplacementField& field) {
    const Eigen::VectorXd u = displacement_.at(step, field);
    if (cameras_.empty()) return surface_.set(frame_.to_picture(surface_.mesh(), u));
    if (cameras_.size() == 1) return surface_.set(u);
    const Eigen::Map<const Eigen::Matrix3Xd> of_nodes(u.data(), 3, u.size() / 3);
    Eigen::Matrix2Xd across = Eigen::Matrix2Xd::Zero(2, of_nodes.cols());
    across.row(0) = of_nodes.row(2);
    surface_.set(of_nodes.topRows<2>().reshaped()), across_.set(across.reshaped());
  }
  [[nodiscard]] files::Picture draw(Index camera, bool moved, const Taken& taken) const {
    const auto motion = [&](double x, double y) { return surface_.at(x, y); };
    const auto body = [&](double x, double y) { return surface_.body(x, y); };
    if (cameras_.empty())
      return pattern_.render(moved ? imaging::DisplacementField(motion) : imaging::DisplacementField(), taken,
                             default_threads(), body);
    const auto place = [&](double s, double t) {
      const auto at = frame_.model_point(s, t);
      Eigen::Vector3d x(at[0], at[1], at[2]);
      if (!moved) return x;
      const imaging::Displacement u = surface_.at(s, t);
      x[axes_[0]] += u.u, x[axes_[1]] += u.v;
      if (cameras_.size() > 1) x[axes_[2]] += across_.at(s, t).u;
      return x;
    };
    return imaging::drawn_view(cameras_[camera], taken_.width, taken_.height, pattern_, place, taken,
                               default_threads(), body);
  }

 private:
  static int extent(double length) { return std::max<int>(4, std::ceil(length)); }

  const CameraSimulation& taken_;
  std::vector<imaging::Camera> cameras_;  ///< empty: one that looks straight at the face
  imaging::PictureFrame frame_;           ///< in which the pattern is drawn
  imaging::MeshField surface_, across_;   ///< px; with cameras m, of axes 0 and 1, and of axis 2
  std::array<int, 3> axes_;               ///< of the model: along the face, and across it
  FaceDisplacement displacement_;
  imaging::SpecklePattern pattern_;
};

}  // namespace

void simulate_pictures(const Project& project, const model::Mesh& mesh, const SimulatedField& simulated,
                       std::optional<std::uint64_t> seed, const std::string& folder) {
  project.require(project.simulate && project.simulate->camera, "a table [simulate.camera]");
  const CameraSimulation& camera = *project.simulate->camera;
  const std::uint64_t used_seed = seed.value_or(project.simulate->seed);
  DrawnFace face(project, mesh, simulated.dofs, used_seed);
  std::vector<std::string> folders;
  for (Index c = 0; c < face.cameras(); ++c)
    folders.push_back(face.cameras() == 1 ? folder : fmt::format("{}/camera_{}", folder, c));
  std::size_t number = 0;  // of pictures drawn
  const auto draw = [&](const std::string& name, bool moved) {
    for (Index c = 0; c < std::ssize(folders); ++c) {
      // Each picture has noise of its own: seeds far apart, since a picture uses one number a pixel.
      const Taken taken{.bit_depth = camera.bit_depth,
                        .noise = camera.noise,
                        .gain = moved ? camera.gain : 1,
                        .supersampling = camera.supersampling,
                        .seed = used_seed * 1000003 + number++};
      files::write_tiff((std::filesystem::path(folders[c]) / name).string(), face.draw(c, moved, taken));
    }
  };
  for (const std::string& one : folders) files::require_writable_folder(one);
  write_machine(simulated_series(project, simulated, used_seed), simulated.time, folder);
  for (int k = 1; k <= camera.references; ++k) draw(fmt::format("reference_{}.tif", k), false);
  const std::vector<std::string> header{"time", "file"};
  files::CsvWriter table(header);
  const std::vector<double>& time = simulated.time;
  Progress progress("pictures", time.size());
  for (std::size_t step = 0; step < time.size(); ++step) {
    if ((step + 1) % camera.every != 0) continue;
    face.displace(step, simulated.field);
    const std::string name = fmt::format("picture_{:04}.tif", step + 1);
    draw(name, true);
    table.add_texts(std::array<std::string, 2>{files::format_number(time[step]), name});
    table.write((std::filesystem::path(folders.front()) / "pictures.csv").string());
    progress.advance_to(step + 1);
    check_cancellation(fmt::format("{} pictures are kept in {}", number, folder));
  }
}

}  // namespace knothe::project
