// Reads back what `write_displacements` wrote, so that an interrupted series can go on.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/files/hdf5.hpp"
#include "knothe/imaging/series/displacement_files.hpp"

namespace knothe::imaging {

namespace {

[[noreturn]] void refuse(const std::string& path, const std::string& what) {
  throw DataError(fmt::format(
      "{}: error: it holds the {} of another series; give another file, or omit --resume", path, what));
}

void read_crack(const files::Hdf5Reader& file, std::size_t t, PictureResult& r) {
  CrackMeasurement c;
  const auto at = [&](const char* name, std::size_t i) { return file.read(name, true)[i]; };
  c.found = file.read_integers("/crack/found")[t] != 0;
  c.log_evidence = at("/crack/log_evidence", t);
  if (std::isnan(c.log_evidence)) return;  // the picture was missing
  c.message = c.found ? "" : "as of the run before";
  if (c.found) {
    c.tip_in_view = file.read_integers("/crack/tip_in_view")[t] != 0;
    c.length = at("/crack/length", t), c.length_std = at("/crack/length_std", t);
    c.interval = {at("/crack/length_interval", 2 * t), at("/crack/length_interval", 2 * t + 1)};
    c.tip = {at("/crack/tip", 2 * t), at("/crack/tip", 2 * t + 1)};
    const auto path = file.read(fmt::format("/crack/paths/{}", t), true);
    for (std::size_t i = 0; i + 6 < path.size(); i += 7) {
      const bool measured = !std::isnan(path[i + 4]);
      c.path.push_back({path[i], path[i + 1], path[i + 2], path[i + 3], measured ? path[i + 4] : 0,
                        measured ? path[i + 5] : 0, measured ? path[i + 6] : 0, measured});
    }
  }
  r.crack = std::move(c);
}

}  // namespace

std::vector<PictureResult> read_results(const std::string& path, const PictureSeries& series,
                                        const std::string& group) {
  const files::Hdf5Reader file(path);
  if (!file.has(group + "/picture_frame/displacement") || !file.has(group + "/elements/valid"))
    throw DataError(fmt::format("{}: error: not a file of `knothe dic`: it cannot be resumed", path));
  const ImageMesh& mesh = series.correlation().mesh();
  const FileCells file_has = file_cells(mesh);
  const std::size_t nodes = mesh.x.size(), cells = file_has.element.size();
  const auto names = file.texts_attribute(group + "/pictures", "names"),
             messages = file.texts_attribute(group + "/pictures", "messages");
  const std::size_t n_t = names.size();
  if (file.texts_attribute(group.empty() ? "/" : group, "references") != series.options().references)
    refuse(path, "reference");
  const auto& pictures = series.options().pictures;
  if (n_t > pictures.size() || !std::equal(names.begin(), names.end(), pictures.begin()))
    refuse(path, "pictures");
  const auto places = file.read(group + "/picture_frame/nodes");
  bool same = places.size() == 2 * nodes && file.shape(group + "/elements/valid")[1] == cells;
  for (std::size_t a = 0; same && a < nodes; ++a)
    same = std::abs(places[2 * a] - mesh.x[a]) < 1e-6 && std::abs(places[2 * a + 1] - mesh.y[a]) < 1e-6;
  if (!same) refuse(path, "mesh");
  const auto displacement =
      file.read(group + "/picture_frame/displacement", files::Shape{n_t, nodes, 2}, true);
  const bool regularised = file.has(group + "/picture_frame/unregularised");
  const auto free = regularised
                        ? file.read(group + "/picture_frame/unregularised", files::Shape{n_t, nodes, 2}, true)
                        : std::vector<double>();
  const auto residual = file.read(group + "/elements/residual", files::Shape{n_t, cells});
  const auto valid = file.read_integers(group + "/elements/valid");
  const auto number = [&](const char* name) {
    return file.read(group + "/pictures/" + name, files::Shape{n_t});
  };
  const auto converged = number("converged"), iterations = number("iterations"), rms = number("residual_rms"),
             noise = number("noise"), gain = number("gain"), offset = number("offset"),
             rejected = number("elements_rejected");
  std::vector<PictureResult> results;
  for (std::size_t t = 0; t < n_t; ++t) {
    PictureResult r;
    r.index = t, r.picture = names[t], r.message = messages[t], r.missing = !messages[t].empty();
    r.noise = noise[t];
    CorrelationResult& c = r.correlation;
    c.displacement.setZero(2 * nodes);
    for (std::size_t i = 0; i < 2 * nodes; ++i)
      if (const double u = displacement[2 * nodes * t + i]; !std::isnan(u)) c.displacement[i] = u;
    if (regularised) c.unregularised = c.displacement;
    for (std::size_t i = 0; regularised && i < 2 * nodes; ++i)
      if (const double u = free[2 * nodes * t + i]; !std::isnan(u)) c.unregularised[i] = u;
    c.converged = converged[t] != 0, c.iterations = iterations[t], c.residual_rms = rms[t];
    c.gain = gain[t], c.offset = offset[t], c.elements_rejected = rejected[t];
    c.element_valid.resize(mesh.elements.size()), c.element_residual.resize(mesh.elements.size());
    for (std::size_t k = 0; k < cells; ++k) {
      c.element_valid[file_has.element[k]] = valid[cells * t + k];
      c.element_residual[file_has.element[k]] = residual[cells * t + k];
    }
    if (file.has("/crack/found")) read_crack(file, t, r);
    results.push_back(std::move(r));
  }
  return results;
}

}  // namespace knothe::imaging
