#include "knothe/library/correlation.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "knothe/files/picture.hpp"
#include "knothe/imaging/correlation/correlation_noise.hpp"
#include "knothe/imaging/correlation/image_correlation.hpp"
#include "knothe/imaging/mesh/mesh_file.hpp"
#include "knothe/library/plain.hpp"

namespace knothe {

namespace {

files::Picture picture_of(const GreyPicture& picture) {
  if (picture.width < 1 || picture.height < 1 ||
      picture.pixels.size() !=
          static_cast<std::size_t>(picture.width) * static_cast<std::size_t>(picture.height))
    throw UsageError("picture of " + std::to_string(picture.width) + " x " + std::to_string(picture.height) +
                     " pixels with " + std::to_string(picture.pixels.size()) + " grey levels");
  files::Picture result;
  result.width = picture.width;
  result.height = picture.height;
  result.maximum = picture.maximum;
  result.pixels = picture.pixels;
  return result;
}

imaging::ImageMesh mesh_of(const PictureMesh& given) {
  const std::size_t nodes = given.x.size();
  if (given.y.size() != nodes)
    throw UsageError("mesh: " + std::to_string(nodes) + " x and " + std::to_string(given.y.size()) +
                     " y of its nodes");
  std::vector<char> used(nodes, 0);
  for (const auto& element : given.elements)
    for (int a = 0; a < imaging::ImageMesh::nodes_of(element); ++a) {
      const int node = element[a];
      if (node < 0 || static_cast<std::size_t>(node) >= nodes)
        throw UsageError("mesh: element " + std::to_string(&element - given.elements.data()) +
                         " has the node " + std::to_string(node) + "; there are " + std::to_string(nodes) +
                         " nodes, counted from 0");
      used[node] = 1;
    }
  if (const auto lone = std::find(used.begin(), used.end(), 0); lone != used.end())
    throw UsageError("mesh: node " + std::to_string(lone - used.begin()) +
                     " belongs to no element; leave it out");
  return {given.x, given.y, given.elements};
}

imaging::ImageMesh mesh_of(const GreyPicture& reference, const CorrelationSettings& settings) {
  if (!settings.mesh.elements.empty()) return mesh_of(settings.mesh);
  const auto& r = settings.region;
  imaging::Region region{r[0], r[1], r[2], r[3]};
  if (region.width() == 0 && region.height() == 0) {
    const double margin = 0.5 * settings.element_size;
    region = {margin, margin, reference.width - 1 - margin, reference.height - 1 - margin};
  }
  return imaging::structured_mesh(region, settings.element_size);
}

imaging::CorrelationOptions options_of(const CorrelationSettings& settings) {
  imaging::CorrelationOptions options;
  options.prefilter_sigma = settings.prefilter_sigma;
  options.max_iterations = settings.max_iterations;
  options.tolerance = settings.tolerance;
  options.threads = settings.threads;
  options.interruptible = true;
  return options;
}

Noise::Precision rows_of(const Eigen::SparseMatrix<double>& matrix) {  // symmetric: its columns are its rows
  Noise::Precision rows;
  for (Eigen::Index k = 0; k < matrix.outerSize(); ++k) {
    rows.row_begin.push_back(std::ssize(rows.values));
    for (Eigen::SparseMatrix<double>::InnerIterator it(matrix, k); it; ++it) {
      rows.values.push_back(it.value());
      rows.columns.push_back(it.index());
    }
  }
  rows.row_begin.push_back(std::ssize(rows.values));
  return rows;
}

}  // namespace

GreyPicture read_grey_picture(const std::string& path) {
  files::Picture picture = files::read_picture(path);
  return {picture.width, picture.height, std::move(picture.pixels), picture.maximum};
}

PictureMesh read_picture_mesh(const std::string& path) {
  imaging::ImageMesh mesh = imaging::read_image_mesh(path, std::nullopt);
  return {std::move(mesh.x), std::move(mesh.y), std::move(mesh.elements)};
}

struct Correlation::Implementation {
  imaging::ImageCorrelation correlation;
  imaging::CorrelationResult last = {};
};

Correlation::Correlation(const GreyPicture& reference, const CorrelationSettings& settings)
    : implementation_(std::make_unique<Implementation>(Implementation{imaging::ImageCorrelation(
          picture_of(reference), mesh_of(reference, settings), options_of(settings))})) {}
Correlation::~Correlation() = default;
Correlation::Correlation(Correlation&&) noexcept = default;
Correlation& Correlation::operator=(Correlation&&) noexcept = default;

std::vector<double> Correlation::node_x() const {
  return implementation_->correlation.mesh().x;
}
std::vector<double> Correlation::node_y() const {
  return implementation_->correlation.mesh().y;
}

std::vector<std::array<int, 4>> Correlation::elements() const {
  return implementation_->correlation.mesh().elements;
}

Displacements Correlation::correlate(const GreyPicture& deformed) {
  auto& [correlation, last] = *implementation_;
  last = correlation.correlate(picture_of(deformed), last.displacement, last.element_valid);
  Displacements result;
  result.converged = last.converged;
  result.iterations = last.iterations;
  result.elements_rejected = last.elements_rejected;
  result.residual_rms = last.residual_rms;
  result.message = last.message;
  result.picture_noise = imaging::noise_from_residual(correlation, last);
  // A picture that has nothing in common with the reference may leave no noise to speak of.
  const bool has_noise = result.picture_noise > 0 && std::isfinite(result.picture_noise);
  imaging::DisplacementPrecision precision;
  if (has_noise) {
    precision =
        imaging::displacement_precision(correlation, last.element_valid, result.picture_noise, 1, last.gain);
    result.precision = rows_of(precision.matrix);
  }
  const std::vector<char> measured = imaging::measured_nodes(correlation.mesh(), last.element_valid);
  for (std::size_t a = 0; a < measured.size(); ++a) {
    const Eigen::Index dof = 2 * a;
    const double nothing = std::numeric_limits<double>::quiet_NaN();
    result.u.push_back(measured[a] ? last.displacement[dof] : nothing);
    result.v.push_back(measured[a] ? last.displacement[dof + 1] : nothing);
    result.std_u.push_back(has_noise ? precision.std[dof] : nothing);
    result.std_v.push_back(has_noise ? precision.std[dof + 1] : nothing);
  }
  return result;
}

std::vector<double> Correlation::at(std::span<const double> points) const {
  const auto& [correlation, last] = *implementation_;
  if (last.displacement.size() == 0) throw UsageError("displacements at points: correlate a picture first");
  std::vector<char> inside;
  return library::plain(imaging::interpolate(correlation.mesh(), last.displacement,
                                             library::rows_of(points, 2, "points of a picture"), inside,
                                             last.element_valid));
}

}  // namespace knothe
