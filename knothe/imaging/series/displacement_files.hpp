#pragma once
/// @file What `knothe dic` leaves: displacements of a series as HDF5, as CSV at chosen points, and as
/// VTU/PVD.
#include <optional>
#include <string>
#include <vector>

#include "knothe/files/hdf5.hpp"
#include "knothe/imaging/mesh/registration.hpp"
#include "knothe/imaging/series/picture_series.hpp"

namespace knothe::imaging {

/// γ of the whole series: the one that is known, or the median of its pictures', referred to a gain of 1;
/// 0 if no picture was measured.
[[nodiscard]] double series_noise(const PictureSeries& series, const std::vector<PictureResult>& results);

/// Where each dof of the mesh is, m (px without a frame), and its component.
void observation_places(const ImageMesh& mesh, const std::optional<PictureFrame>& frame,
                        std::vector<double>& points, std::vector<std::int64_t>& component);
/// Values of one picture, m or px; NaN where nothing was measured.
[[nodiscard]] Eigen::VectorXd observed_values(const ImageMesh& mesh, const PictureResult& result,
                                              const std::optional<PictureFrame>& frame);

/// Model time of a picture; where the series has no times, its index.
[[nodiscard]] double time_of(const PictureSeries& series, std::size_t picture);

/// HDF5 in the form of measurements (docs/reference/formats.md), with the mesh and a record of each picture
/// beside them. `project` is the project file's text. Errors: IoError.
void write_displacements(const std::string& path, const PictureSeries& series,
                         const std::vector<PictureResult>& results, const std::optional<PictureFrame>& frame,
                         const std::string& project);

/// Of the pictures of one camera, under `group` ("" for the file's own): what they showed in px, so that
/// their series can go on.
void write_pictures(files::Hdf5Writer& file, const std::string& group, const PictureSeries& series,
                    const std::vector<PictureResult>& results);

/// A symmetric matrix, both triangles stored, as `name`/data, /indices and /indptr; zeros are left out.
void write_symmetric(files::Hdf5Writer& file, const std::string& name,
                     const Eigen::SparseMatrix<double>& matrix, const std::string& units);

/// The cells of such a file: with four nodes where all elements are quadrilaterals, otherwise triangles
/// (quadrilaterals cut in two).
struct FileCells {
  std::vector<std::int64_t> nodes;
  std::vector<std::size_t> element;  ///< of each cell
  std::size_t nodes_per_cell = 4;
};
[[nodiscard]] FileCells file_cells(const ImageMesh& mesh);

/// The results in such a file under `group`, of the first pictures of this series, so that it can go on
/// (PictureSeries::resume). Errors: DataError for a file of other references, pictures or mesh.
[[nodiscard]] std::vector<PictureResult> read_results(const std::string& path, const PictureSeries& series,
                                                      const std::string& group = "");

/// Standard deviations of u and v at points of the reference picture (n × 2, px), with the covariance of an
/// element's nodes; NaN where write_at_points has `inside` 0.
[[nodiscard]] Eigen::MatrixXd point_std(const PictureSeries& series, const PictureResult& result,
                                        const Eigen::MatrixXd& points);

/// CSV x,y,u,v,inside at points of the reference picture (n × 2, px); u, v are nan where inside is 0: outside
/// the mesh, or in an element that was taken out. `std` (may be empty): in columns u_std,v_std behind them.
/// Errors: IoError.
void write_at_points(const std::string& path, const ImageMesh& mesh, const PictureResult& result,
                     const Eigen::MatrixXd& points, const Eigen::MatrixXd& std = {});

/// Displacement, its standard deviation (`std`, px), strains, residual and validity of one picture for
/// ParaView; y points up, in px or, with a frame, in m. Units are in VTK's key UNITS_LABEL. Errors: IoError.
void write_displacement_vtu(const std::string& path, const PictureSeries& series, const PictureResult& result,
                            const Eigen::VectorXd& std, const std::optional<PictureFrame>& frame);

}  // namespace knothe::imaging
