#include "knothe/report/pages/maps_page.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "knothe/base/index.hpp"
#include "knothe/base/text.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/imaging/series/displacement_files.hpp"
#include "knothe/record/number_text.hpp"
#include "knothe/report/data/report_record.hpp"
#include "knothe/report/pages/page.hpp"

namespace knothe::report {
namespace {

using Json = nlohmann::ordered_json;

constexpr Index k_max_numbers = 2'000'000;  ///< of all pictures that the page can move through

std::string crack_cell(const imaging::PictureResult& r, double unit) {
  if (!r.crack || !r.crack->found) return r.crack ? "none found" : "";
  if (!r.crack->tip_in_view) return fmt::format("right through, ≥ {:.4g}", unit * r.crack->length);
  return fmt::format("{:.4g} ± {:.2g}", unit * r.crack->length, unit * r.crack->length_std);
}

std::string name_of(const imaging::PictureResult& r) {
  return std::filesystem::path(r.picture).filename().string();
}

TableRow row_of(const MappedPicture& p, bool has_crack, bool has_remark, double unit) {
  const imaging::PictureResult& r = *p.result;
  const auto& c = r.correlation;
  TableRow row{{name_of(r)}, r.missing};
  if (r.missing) {
    row.cells.insert(row.cells.end(), {"not measured", "", "", "", ""});
  } else {
    row.cells.insert(row.cells.end(), {std::to_string(c.iterations), fmt::format("{:.3g}", c.residual_rms),
                                       fmt::format("{:.4f}", p.noise_std), fmt::format("{:.3f}", c.gain),
                                       std::to_string(c.elements_rejected)});
  }
  if (has_crack) row.cells.push_back(r.missing ? "" : crack_cell(r, unit));
  if (has_remark)
    row.cells.push_back(r.missing ? r.message : r.reference.empty() ? "" : "reference: " + r.reference);
  return row;
}

/// u and v of the nodes, in m with a frame, else px; empty where nothing was measured.
Json picture_record(const imaging::PictureSeries& series, const MappedPicture& p,
                    const std::optional<imaging::PictureFrame>& frame) {
  const imaging::PictureResult& r = *p.result;
  Json u = Json::array(), v = Json::array(), out = Json::array();
  for (Index e = 0; e < std::ssize(r.correlation.element_valid); ++e)
    if (r.correlation.element_valid[e] == 0) out.push_back(e);
  const Eigen::VectorXd& pixels = r.correlation.displacement;
  // A node without a valid element has no meaning, and is not drawn.
  const auto number = [](double value) { return std::isfinite(value) ? value : 0.0; };
  if (!r.missing && pixels.size() > 0) {
    const Eigen::VectorXd values = frame ? frame->to_model(series.correlation().mesh(), pixels) : pixels;
    for (Eigen::Index i = 0; i + 1 < values.size(); i += 2) {
      u.push_back(number(values[i]));
      v.push_back(number(values[i + 1]));
    }
  }
  return {{"name", name_of(r)},    {"time", imaging::time_of(series, r.index)},
          {"u", std::move(u)},     {"v", std::move(v)},
          {"out", std::move(out)}, {"noise", number(p.noise_std * (frame ? frame->scale() : 1))}};
}

/// What the figures are drawn from; of a long series some pictures, the last one among them.
Json record_of(const imaging::PictureSeries& series, const std::vector<MappedPicture>& pictures,
               const std::optional<imaging::PictureFrame>& frame) {
  const imaging::ImageMesh& mesh = series.correlation().mesh();
  Json points = Json::array(), cells = Json::array(), shown = Json::array();
  std::vector<std::string> labels = {"u, to the right", "v, down"};
  if (frame)
    for (std::size_t k = 0; k < 2; ++k) labels[k] = fmt::format("u_{}", "xyz"[frame->components()[k]]);
  for (int i = 0; i < mesh.node_count(); ++i) {
    if (frame) {
      const auto place = frame->model_point(mesh.x[i], mesh.y[i]);
      points.push_back({place[frame->components()[0]], place[frame->components()[1]]});
    } else {
      points.push_back({mesh.x[i], -mesh.y[i]});
    }
  }
  for (const auto& element : mesh.elements) {
    Json cell = Json::array();
    for (int k = 0; k < imaging::ImageMesh::nodes_of(element); ++k) cell.push_back(element[k]);
    cells.push_back(std::move(cell));
  }
  const Index all = std::ssize(pictures) * 2 * mesh.node_count(), stride = 1 + (all - 1) / k_max_numbers;
  for (Index i = 0; i < std::ssize(pictures); ++i)
    if ((std::ssize(pictures) - 1 - i) % stride == 0)
      shown.push_back(picture_record(series, pictures[i], frame));
  Json record = {{"kind", "maps"},
                 {"unit", frame ? "m" : "px"},
                 {"labels", labels},
                 {"up", frame ? 1 : -1},
                 {"points", std::move(points)},
                 {"cells", std::move(cells)},
                 {"pictures", std::move(shown)}};
  shorten_numbers(record, 6);
  return record;
}

/// Whether every picture was measured, and how well.
void add_result(Page& page, const std::vector<MappedPicture>& pictures, Index elements) {
  constexpr double k_many_out = 0.1;  // of the elements
  Index measured = 0;
  int most_out = 0;
  double noise = 0;
  std::vector<std::string> doubts;
  for (const MappedPicture& p : pictures) {
    const auto& c = p.result->correlation;
    if (p.result->missing) {
      doubts.push_back(fmt::format("{} was not measured: {}.", name_of(*p.result), p.result->message));
      continue;
    }
    ++measured;
    most_out = std::max<int>(most_out, c.elements_rejected);
    if (std::isfinite(p.noise_std)) noise = std::max(noise, p.noise_std);
    if (!c.converged)
      doubts.push_back(fmt::format("{}: the displacements had not converged after {} iterations.",
                                   name_of(*p.result), c.iterations));
  }
  const double share = elements > 0 ? most_out / (1.0 * elements) : 0;
  if (share > k_many_out)
    doubts.push_back(fmt::format(
        "Up to {:.0f} % of the elements have no measurement: look at the maps where.", 100 * share));
  const Usability worth = measured == 0    ? Usability::not_usable
                          : doubts.empty() ? Usability::usable
                                           : Usability::with_caveats;
  doubts.push_back(fmt::format(
      "{} of {} measured; noise of a displacement at most {} px; {}.", measured,
      counted(pictures.size(), "picture"), record::readable(noise, 2),
      most_out == 0 ? fmt::format("all {} elements measured", elements)
                    : fmt::format("at most {} of {} elements without a measurement", most_out, elements)));
  page.result(worth, doubts);
}

}  // namespace

void write_maps_page(const std::string& folder, const imaging::PictureSeries& series,
                     const std::vector<MappedPicture>& pictures,
                     const std::optional<imaging::PictureFrame>& frame, const std::string& registration) {
  const bool has_crack = series.options().crack.has_value();
  const double unit = frame ? 1e3 * frame->scale() : 1;
  Page page("Displacements from pictures",
            fmt::format("{}; reference: {}; {} elements, {} nodes. {}",
                        counted(series.options().pictures.size(), "picture"),
                        series.options().references.front(), series.correlation().mesh().element_count(),
                        series.correlation().mesh().node_count(), registration));
  if (!pictures.empty()) {
    add_result(page, pictures, series.correlation().mesh().element_count());
    page.figures({{"map:u", frame ? "Displacement along the first axis" : "Displacement to the right"},
                  {"map:v", frame ? "Displacement along the second axis" : "Displacement down"},
                  {"slice", "Displacements along the line"},
                  {"extensometer", "The line as an extensometer, over the pictures"}},
                 "The cursor gives values; drag on a map to draw the line. Bars in the colour scale: twice "
                 "the noise of a displacement. Elements without a measurement are left out.");
  }
  std::vector<std::string> header = {
      "picture", "iterations",  "residual, grey levels", "noise of a displacement, px",
      "gain",    "elements out"};
  if (has_crack) header.push_back(frame ? "crack, mm" : "crack, px");
  const bool has_remark = std::ranges::any_of(
      pictures, [](const MappedPicture& p) { return p.result->missing || !p.result->reference.empty(); });
  if (has_remark) header.push_back("remark");
  std::vector<TableRow> rows;
  for (const MappedPicture& p : pictures) rows.push_back(row_of(p, has_crack, has_remark, unit));
  page.table(header, rows);
  if (!registration.empty()) page.image("registration.png", "outline on the picture");
  for (const MappedPicture& p : pictures)
    if (!p.stem.empty()) page.image(p.stem + ".png", "maps of " + p.result->picture);
  files::write_text_atomically((std::filesystem::path(folder) / "index.html").string(),
                               page.html(record_of(series, pictures, frame)));
}

}  // namespace knothe::report
