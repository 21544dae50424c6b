#include "knothe/project/picture_simulation.hpp"

#include <fmt/format.h>

#include <array>
#include <filesystem>

#include "knothe/base/cancellation.hpp"
#include "knothe/base/progress.hpp"
#include "knothe/base/threads.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/csv.hpp"
#include "knothe/files/numbers.hpp"
#include "knothe/files/picture.hpp"
#include "knothe/imaging/mesh/mesh_field.hpp"
#include "knothe/imaging/series/speckle.hpp"
#include "knothe/model/observe/observation_operator.hpp"
#include "knothe/project/picture_measurements.hpp"

namespace knothe::project {
namespace {

/// Displacements of the nodes of the face, px, from the model's dofs.
class FaceDisplacement {
 public:
  FaceDisplacement(const imaging::ImageMesh& face, const imaging::PictureFrame& frame,
                   const model::Dofs& dofs, const model::Mesh& mesh)
      : frame_(frame) {
    model::Dofs places;
    for (std::size_t a = 0; a < face.x.size(); ++a) {
      const auto point = frame.model_point(face.x[a], face.y[a]);
      for (const int component : frame.components()) places.add(point, component);
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
    // T is its own inverse but for the scale.
    const Eigen::Matrix2d to_pixels = frame_.displacement_matrix() / (frame_.scale() * frame_.scale());
    for (Eigen::Index a = 0; a < u.size(); a += 2) u.segment<2>(a) = (to_pixels * u.segment<2>(a)).eval();
    return u;
  }

 private:
  imaging::PictureFrame frame_;
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

}  // namespace

void simulate_pictures(const Project& project, const model::Mesh& mesh, const SimulatedField& simulated,
                       std::optional<std::uint64_t> seed, const std::string& folder) {
  project.require(project.simulate && project.simulate->camera, "a table [simulate.camera]");
  const CameraSimulation& camera = *project.simulate->camera;
  const std::uint64_t used_seed = seed.value_or(project.simulate->seed);
  const imaging::PictureFrame frame = picture_frame_of(project, mesh);
  imaging::MeshField surface(surface_mesh(mesh, frame, project));
  const FaceDisplacement displacement(surface.mesh(), frame, simulated.dofs, mesh);
  const imaging::SpecklePattern pattern(
      {.width = camera.width, .height = camera.height, .dot_radius = camera.dot_radius, .seed = used_seed});
  const int threads = default_threads();
  const auto body = [&](double x, double y) { return surface.body(x, y); };
  const auto motion = [&](double x, double y) { return surface.at(x, y); };
  const auto draw = [&](const std::string& name, std::size_t number, bool moved) {
    // Each picture has noise of its own: seeds far apart, since a picture uses one number a pixel.
    const imaging::SpeckleCamera options{.bit_depth = camera.bit_depth,
                                         .noise = camera.noise,
                                         .gain = moved ? camera.gain : 1,
                                         .supersampling = camera.supersampling,
                                         .seed = used_seed * 1000003 + number};
    files::write_tiff(
        (std::filesystem::path(folder) / name).string(),
        pattern.render(moved ? imaging::DisplacementField(motion) : imaging::DisplacementField(), options,
                       threads, body));
  };
  files::require_writable_folder(folder);
  write_machine(simulated_series(project, simulated, used_seed), simulated.time, folder);
  std::size_t number = 0;
  for (int k = 1; k <= camera.references; ++k) draw(fmt::format("reference_{}.tif", k), number++, false);
  const std::vector<std::string> header{"time", "file"};
  files::CsvWriter table(header);
  const std::vector<double>& time = simulated.time;
  Progress progress("pictures", time.size());
  for (std::size_t step = 0; step < time.size(); ++step) {
    if ((step + 1) % camera.every != 0) continue;
    surface.set(displacement.at(step, simulated.field));
    const std::string name = fmt::format("picture_{:04}.tif", step + 1);
    draw(name, number++, true);
    table.add_texts(std::array<std::string, 2>{files::format_number(time[step]), name});
    table.write((std::filesystem::path(folder) / "pictures.csv").string());
    progress.advance_to(step + 1);
    check_cancellation(fmt::format("{} pictures are kept in {}", number, folder));
  }
}

}  // namespace knothe::project
