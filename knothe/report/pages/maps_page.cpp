#include "knothe/report/pages/maps_page.hpp"

#include <fmt/format.h>

#include <filesystem>

#include "knothe/base/text.hpp"
#include "knothe/files/atomic_file.hpp"

namespace knothe::report {
namespace {

constexpr const char* k_head = R"(<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>Displacements from pictures</title>
<style>
body { font: 15px/1.45 system-ui, sans-serif; margin: 2rem auto; max-width: 1240px; padding: 0 1rem; color: #1a1a1a; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { text-align: right; padding: .2rem .7rem; border-bottom: 1px solid #ddd; }
th { position: sticky; top: 0; background: #fff; } td:first-child, th:first-child, td.words { text-align: left; }
.bad td { color: #a01818; } img { max-width: 100%; } figure { margin: 2.5rem 0; } .list { max-height: 26rem; overflow: auto; }
</style></head><body><h1>Displacements from pictures</h1>
)";

std::string crack_cell(const imaging::PictureResult& r, double unit) {
  if (!r.crack || !r.crack->found) return r.crack ? "none found" : "";
  if (!r.crack->tip_in_view) return fmt::format("right through, ≥ {:.4g}", unit * r.crack->length);
  return fmt::format("{:.4g} ± {:.2g}", unit * r.crack->length, unit * r.crack->length_std);
}

}  // namespace

void write_maps_page(const std::string& folder, const imaging::PictureSeries& series,
                     const std::vector<MappedPicture>& pictures,
                     const std::optional<imaging::PictureFrame>& frame, const std::string& registration) {
  const double unit = frame ? 1e3 * frame->scale() : 1;
  const char* length = frame ? "mm" : "px";
  std::string page = k_head;
  page += fmt::format(
      "<p>{}; reference: {}; {} elements, {} nodes. {}</p>\n<div class=\"list\"><table><tr><th>picture",
      counted(series.options().pictures.size(), "picture"), escape_xml(series.options().references.front()),
      series.correlation().mesh().element_count(), series.correlation().mesh().node_count(),
      escape_xml(registration));
  page += fmt::format(
      "</th><th>iterations</th><th>residual, grey levels</th><th>noise of a displacement, "
      "px</th><th>gain</th><th>elements out</th>{}<th>remark</th></tr>\n",
      series.options().crack ? fmt::format("<th>crack, {}</th>", length) : "");
  for (const auto& p : pictures) {
    const imaging::PictureResult& r = *p.result;
    const std::string name = escape_xml(std::filesystem::path(r.picture).filename().string());
    const auto& c = r.correlation;
    const std::string link = p.stem.empty() ? name : fmt::format("<a href=\"#p{}\">{}</a>", r.index, name);
    const std::string crack =
        series.options().crack ? fmt::format("<td>{}</td>", r.missing ? "" : crack_cell(r, unit)) : "";
    if (r.missing) {
      page += fmt::format(
          "<tr class=\"bad\"><td>{}</td><td colspan=\"5\">not measured</td>{}<td "
          "class=\"words\">{}</td></tr>\n",
          link, crack, escape_xml(r.message));
      continue;
    }
    page += fmt::format(
        "<tr><td>{}</td><td>{}</td><td>{:.3g}</td><td>{:.4f}</td><td>{:.3f}</td><td>{}</td>{}<td "
        "class=\"words\">{}</td></tr>\n",
        link, c.iterations, c.residual_rms, p.noise_std, c.gain, c.elements_rejected, crack,
        r.reference.empty() ? "" : "reference: " + escape_xml(r.reference));
  }
  page += "</table></div>\n";
  if (!registration.empty())
    page += "<figure><img src=\"registration.png\" alt=\"outline on the picture\"></figure>\n";
  for (const auto& p : pictures)
    if (!p.stem.empty())
      page += fmt::format(
          "<figure id=\"p{}\"><img loading=\"lazy\" src=\"{}.png\" alt=\"maps of {}\"></figure>\n",
          p.result->index, escape_xml(p.stem), escape_xml(p.result->picture));
  page += "</body></html>\n";
  files::write_text_atomically((std::filesystem::path(folder) / "index.html").string(), page);
}

}  // namespace knothe::report
