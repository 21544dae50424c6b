#include "knothe/imaging/series/pattern_report.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/base/text.hpp"
#include "knothe/base/version.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/imaging/correlation/correlation_noise.hpp"

namespace knothe::imaging {

namespace {

constexpr double k_full_range = 256;    // grey levels in which gradients and noise are told
constexpr double k_assumed_noise = 2;   // of those
constexpr int k_longest_lag = 64;       // px
constexpr double k_weak_gradient = 10;  // grey levels of 256 per px: below, the gradient's own noise counts
constexpr double k_many_saturated = 0.01;
constexpr double k_large_speckle = 10;  // px
constexpr double k_few_speckles = 3;    // in an element

struct Box {
  int x0, y0, x1, y1;  // inclusive
  [[nodiscard]] double count() const { return (x1 - x0 + 1.0) * (y1 - y0 + 1); }
};
Box box_of(const Region& region, const files::Picture& picture) {
  return {std::max<int>(0, std::ceil(region.x0)), std::max<int>(0, std::ceil(region.y0)),
          std::min<int>(picture.width - 1, region.x1), std::min<int>(picture.height - 1, region.y1)};
}

double mean_of(const files::Picture& picture, const Box& box) {
  double sum = 0;
  for (int y = box.y0; y <= box.y1; ++y)
    for (int x = box.x0; x <= box.x1; ++x) sum += picture.at(x, y);
  return sum / box.count();
}

/// Σ (f − mean)(f shifted by the lag − mean) over the pixels that both see, their mean.
double covariance(const files::Picture& picture, const Box& box, double mean, int dx, int dy) {
  double sum = 0, count = 0;
  for (int y = box.y0; y + dy <= box.y1; ++y)
    for (int x = box.x0; x + dx <= box.x1; ++x) {
      sum += (picture.at(x, y) - mean) * (picture.at(x + dx, y + dy) - mean);
      count += 1;
    }
  return count > 0 ? sum / count : 0;
}

void give_advice(PatternReport& r, double element) {
  const auto say = [&](const std::string& text) { r.advice.push_back(text); };
  if (r.rms_gradient < k_weak_gradient)
    say(fmt::format(
        "the pattern is weak ({:.1f} grey levels of 256 per px): more contrast, more light, or a sharper "
        "lens; below {:.0f} the noise of the gradient itself counts",
        r.rms_gradient, k_weak_gradient));
  if (r.saturated > k_many_saturated)
    say(fmt::format("{:.1f} % of the pixels are saturated and will be left out: less light or exposure",
                    100 * r.saturated));
  if (r.black > k_many_saturated)
    say(fmt::format("{:.1f} % of the pixels are black (0): more light or exposure", 100 * r.black));
  const double smallest = std::min(r.speckle[0], r.speckle[1]),
               largest = std::max(r.speckle[0], r.speckle[1]);
  if (smallest > 0 && smallest < k_aliased_speckle)
    say(
        fmt::format("speckles of {:.1f} px are aliased: a prefilter of 1 px (--prefilter 1), coarser "
                    "speckle, or a closer camera; 3 to 5 px are best",
                    smallest));
  if (largest > k_large_speckle)
    say(fmt::format("speckles of {:.1f} px are coarse: finer ones would measure better and finer", largest));
  if (largest > 0 && element < k_few_speckles * largest)
    say(fmt::format("elements of {:.3g} px hold fewer than {:.0f} speckles across: take at least {:.0f} px",
                    element, k_few_speckles, std::ceil(k_few_speckles * largest)));
  if (r.elements_without_texture > 0)
    say(fmt::format("{} of {} elements have no texture and cannot be measured: mask them, or paint there",
                    r.elements_without_texture, r.elements));
  if (r.noise_is_assumed)
    say("the noise is assumed: take two or more pictures of the unloaded surface and give them as "
        "references, then it is measured");
}

}  // namespace

std::array<double, 2> speckle_size(const files::Picture& picture, const Region& region) {
  const Box box = box_of(region, picture);
  const double mean = mean_of(picture, box), variance = covariance(picture, box, mean, 0, 0);
  std::array<double, 2> size{};
  for (int axis = 0; axis < 2 && variance > 0; ++axis) {
    double before = 1;
    for (int lag = 1; lag <= k_longest_lag; ++lag) {
      const double now = covariance(picture, box, mean, axis == 0 ? lag : 0, axis == 0 ? 0 : lag) / variance;
      if (now < 0.5) {
        size[axis] = 2 * (lag - 1 + (before - 0.5) / (before - now));
        break;
      }
      before = now;
    }
  }
  return size;
}

PatternReport pattern_report(const PictureSeries& series) {
  const ImageCorrelation& correlation = series.correlation();
  const files::Picture& picture = correlation.reference();
  const Region bounds = correlation.mesh().bounds();
  const Box box = box_of(bounds, picture);
  const double maximum = picture.maximum;
  PatternReport r;
  const double mean = mean_of(picture, box);
  r.mean_level = mean / maximum;
  r.contrast = std::sqrt(std::max(0.0, covariance(picture, box, mean, 0, 0))) / maximum;
  for (int y = box.y0; y <= box.y1; ++y)
    for (int x = box.x0; x <= box.x1; ++x) {
      r.saturated += picture.at(x, y) >= picture.maximum ? 1 / box.count() : 0;
      r.black += picture.at(x, y) <= 0 ? 1 / box.count() : 0;
    }
  r.elements = correlation.mesh().element_count(), r.nodes = correlation.mesh().node_count();
  double squares = 0, pixels = 0;
  for (Index e = 0; e < std::ssize(correlation.mesh().elements); ++e) {
    const double count = correlation.pixels().elements()[e].pixel_count;
    squares += 0.5 * count * std::pow(correlation.element_gradient()[e], 2), pixels += count;
    r.elements_without_texture += correlation.usable_elements()[e] == 0 ? 1 : 0;
  }
  r.rms_gradient = std::sqrt(squares / std::max(1.0, pixels)) * k_full_range / (maximum + 1);
  r.speckle = speckle_size(picture, bounds);
  r.noise_is_assumed = !(series.known_noise() > 0);
  r.noise = r.noise_is_assumed ? k_assumed_noise * (maximum + 1) / k_full_range : series.known_noise();
  r.std = displacement_std(correlation, correlation.usable_elements(), r.noise, series.reference_count());
  if (!(r.std.size() > 0 && r.std.maxCoeff() > 0))
    throw DataError(
        fmt::format("{}: there is no pattern to follow: grey levels vary by {:.2g} of {:.0f} from pixel to "
                    "pixel, no more "
                    "than by the noise of the pictures ({:.2g})",
                    series.options().references.front(), r.contrast * maximum, maximum + 1, r.noise));
  r.mean_std = mean_std(r.std);
  r.largest_std = r.std.size() > 0 ? r.std.maxCoeff() : 0;
  give_advice(r, std::sqrt(pixels / std::max(1, r.elements)));
  return r;
}

std::vector<ReportRow> reporting_table(const PictureSeries& series, const std::optional<PictureFrame>& frame,
                                       double noise, const Eigen::VectorXd& std) {
  const ImageCorrelation& correlation = series.correlation();
  const files::Picture& picture = correlation.reference();
  const Region bounds = correlation.mesh().bounds();
  const CorrelationOptions& options = correlation.options();
  double pixels = 0, squares = 0, count = 0;
  for (const auto& e : correlation.pixels().elements()) pixels += e.pixel_count;
  for (Index i = 0; i < std.size(); ++i)
    if (std[i] > 0) squares += std[i] * std[i], count += 1;
  const double element = std::sqrt(pixels / std::max(1, correlation.mesh().element_count())),
               floor = count > 0 ? std::sqrt(squares / count) : 0, scale = frame ? 1e3 * frame->scale() : 0;
  const bool quadrilateral =
      !correlation.mesh().elements.empty() && ImageMesh::nodes_of(correlation.mesh().elements.front()) == 4;
  std::vector<ReportRow> rows;
  const auto row = [&](const char* name, std::string value, const char* unit = "") {
    rows.push_back({name, std::move(value), unit});
  };
  row("Software", k_created_by);
  row("Technique", "two-dimensional global finite-element digital image correlation");
  row("Picture size", fmt::format("{} × {}", picture.width, picture.height), "px");
  row("Grey levels", fmt::format("{:.0f}", picture.maximum + 1.0));
  row("Reference pictures, averaged", fmt::format("{}", series.options().references.size()));
  row("Deformed pictures", fmt::format("{}", series.options().pictures.size()));
  if (frame) {
    row("Scale", fmt::format("{:.6g} ± {:.2g}", scale, scale * frame->relative_scale_std), "mm/px");
    row("Field of view", fmt::format("{:.4g} × {:.4g}", scale * picture.width, scale * picture.height), "mm");
  }
  row("Region of interest",
      fmt::format("{:.0f} … {:.0f} × {:.0f} … {:.0f}", bounds.x0, bounds.x1, bounds.y0, bounds.y1), "px");
  row("Noise of a picture", fmt::format("{:.3g}", noise), "grey levels");
  row("Prefilter",
      options.prefilter_sigma > 0
          ? fmt::format("Gaussian, standard deviation {:.3g}", options.prefilter_sigma)
          : "none",
      options.prefilter_sigma > 0 ? "px" : "");
  row("Elements", fmt::format("{} {}, {} nodes", correlation.mesh().element_count(),
                              quadrilateral ? "bilinear quadrilaterals" : "linear triangles",
                              correlation.mesh().node_count()));
  row("Element size", fmt::format("{:.4g}", element), "px");
  if (frame) row("Element size", fmt::format("{:.4g}", scale * element), "mm");
  row("Interpolant", "quintic B-spline");
  row("Criterion", options.brightness == Brightness::none ? "sum of squared differences"
                   : options.brightness == Brightness::global
                       ? "sum of squared differences, gain and offset fitted"
                       : "sum of squared differences, gain and offset per element");
  row("Regularisation",
      options.regularisation > 0
          ? fmt::format("{}, cut-off wavelength {:.4g}",
                        options.regularisation_kind == DisplacementRegularisation::tikhonov
                            ? "Tikhonov"
                            : "mechanical (equilibrium gap)",
                        options.regularisation)
          : "none",
      options.regularisation > 0 ? "px" : "");
  row("Convergence", fmt::format("{:.2g}", options.tolerance), "px");
  row("Displacement noise floor (rms over nodes)", fmt::format("{:.4f}", floor), "px");
  if (frame)
    row("Displacement noise floor (rms over nodes)", fmt::format("{:.3g}", 1e3 * scale * floor), "µm");
  row("Strain noise floor (about)", fmt::format("{:.2g}", element > 0 ? 1e6 * floor / element : 0), "µm/m");
  row("Strain", "mean of the gradients of the elements around a node, no smoothing");
  return rows;
}

void require_table_name(const std::string& path) {
  if (!path.ends_with(".txt") && !path.ends_with(".json") && !path.ends_with(".html"))
    throw UsageError(fmt::format("table of settings {}: its name must end in .txt, .json or .html", path));
}

void write_reporting_table(const std::string& path, const std::vector<ReportRow>& rows) {
  require_table_name(path);
  std::string text;
  if (path.ends_with(".txt")) {
    for (const auto& r : rows)
      text += fmt::format("{:<44}{}{}{}\n", r.name, r.value, r.unit.empty() ? "" : " ", r.unit);
  } else if (path.ends_with(".json")) {
    auto list = nlohmann::ordered_json::array();
    for (const auto& r : rows) list.push_back({{"name", r.name}, {"value", r.value}, {"unit", r.unit}});
    text = list.dump(2) + "\n";
  } else {
    text =
        "<!doctype html>\n<meta charset=\"utf-8\">\n<title>Digital image correlation: "
        "settings</title>\n<table>\n";
    for (const auto& r : rows)
      text += fmt::format("<tr><th scope=\"row\" style=\"text-align:left\">{}</th><td>{} {}</td></tr>\n",
                          escape_xml(r.name), escape_xml(r.value), r.unit);
    text += "</table>\n";
  }
  files::write_text_atomically(path, text);
}

}  // namespace knothe::imaging
