#include "knothe/report/figures/svg_figure.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/base/text.hpp"
#include "knothe/record/number_text.hpp"

namespace knothe::report {
namespace {

std::vector<double> copy(std::span<const double> values) {
  return {values.begin(), values.end()};
}

void require_finite(const std::vector<double>& values, const std::string& label, const char* direction) {
  for (std::size_t i = 0; i < values.size(); ++i)
    if (!std::isfinite(values[i]))
      throw NumericalError(fmt::format("figure: series '{}': {}[{}] is not finite", label, direction, i));
}

constexpr const char* k_font = "system-ui,-apple-system,'Segoe UI',Roboto,'Helvetica Neue',Arial,sans-serif";

std::string document(const Figure& figure, bool standalone) {
  const int count = figure.plots.size();
  const int columns = std::clamp(figure.columns, 1, std::max(count, 1));
  const int rows = (count + columns - 1) / columns;
  constexpr double gap = 22.0;
  const double margin = standalone ? 12.0 : 2.0;
  const double width = columns * figure.plot_width + (columns - 1) * gap + 2 * margin;
  const double height = rows * figure.plot_height + std::max(rows - 1, 0) * gap + 2 * margin;
  std::string svg = fmt::format(
      R"(<svg xmlns="http://www.w3.org/2000/svg" class="figure" role="img" viewBox="0 0 {0} {1}" width="{0}" height="{1}" style="max-width:{4}px" font-family="{2}" font-size="12" aria-label="{3}">)",
      record::coordinate(width), record::coordinate(height), k_font, escape_xml(figure.title),
      record::coordinate(1.2 * width));
  svg += "<title>" + escape_xml(figure.title) + "</title>";
  if (standalone) svg += R"(<rect width="100%" height="100%" fill="#ffffff"/>)";
  for (int i = 0; i < count; ++i)
    svg += figure.plots[i].render(margin + (i % columns) * (figure.plot_width + gap),
                                  margin + (i / columns) * (figure.plot_height + gap), figure.plot_width,
                                  figure.plot_height);
  return svg + "</svg>\n";
}

}  // namespace

Plot& Plot::add(Series series) {
  if (series.x.size() != series.y.size() || (!series.lower.empty() && series.lower.size() != series.y.size()))
    throw NumericalError(fmt::format("figure: series '{}': {} abscissas, {} ordinates", series.label,
                                     series.x.size(), series.y.size()));
  require_finite(series.x, series.label, "x");
  require_finite(series.y, series.label, "y");
  require_finite(series.lower, series.label, "lower");
  series_.push_back(std::move(series));
  return *this;
}

Plot& Plot::line(std::span<const double> x, std::span<const double> y, Paint paint, std::string label,
                 Stroke stroke, Side side) {
  return add({Kind::line, copy(x), copy(y), {}, std::move(paint), std::move(label), std::move(stroke), side});
}

Plot& Plot::steps(std::span<const double> x, std::span<const double> y, Paint paint, std::string label,
                  Stroke stroke, Side side) {
  if (x.size() != y.size()) throw NumericalError("figure: series '" + label + "': as many x as y are needed");
  std::vector<double> corner_x, corner_y;
  for (std::size_t i = 0; i < x.size(); ++i) {
    corner_x.push_back(x[i]);
    corner_y.push_back(y[i]);
    if (i + 1 < x.size()) {
      corner_x.push_back(x[i + 1]);
      corner_y.push_back(y[i]);
    }
  }
  return line(corner_x, corner_y, std::move(paint), std::move(label), std::move(stroke), side);
}

Plot& Plot::band(std::span<const double> x, std::span<const double> low, std::span<const double> high,
                 Paint paint, std::string label, double opacity) {
  return add(
      {Kind::band, copy(x), copy(high), copy(low), std::move(paint), std::move(label), {0.0, {}, opacity}});
}

Plot& Plot::bars(std::span<const double> x, std::span<const double> height, double width, Paint paint,
                 std::string label, Side side, double opacity) {
  return add({Kind::bars,
              copy(x),
              copy(height),
              {},
              std::move(paint),
              std::move(label),
              {0.0, {}, opacity},
              side,
              width});
}

Plot& Plot::scatter(std::span<const double> x, std::span<const double> y, Paint paint, std::string label,
                    double radius, Side side) {
  return add({Kind::scatter, copy(x), copy(y), {}, std::move(paint), std::move(label), {}, side, radius});
}

Plot& Plot::vertical(double x, Paint paint, std::string label, Stroke stroke) {
  return add({Kind::vertical, {x}, {0.0}, {}, std::move(paint), std::move(label), std::move(stroke)});
}

Plot& Plot::horizontal(double y, Paint paint, std::string label, Stroke stroke, Side side) {
  return add({Kind::horizontal, {0.0}, {y}, {}, std::move(paint), std::move(label), std::move(stroke), side});
}

Plot& Plot::cells(std::vector<Cell> cells) {
  for (const auto& cell : cells)
    for (const auto& corner : cell.corners)
      if (!std::isfinite(corner[0]) || !std::isfinite(corner[1]))
        throw NumericalError("figure: a corner of a cell is not finite");
  cells_.insert(cells_.end(), std::make_move_iterator(cells.begin()), std::make_move_iterator(cells.end()));
  return *this;
}

Figure figure_of(Plot plot, const std::string& title, double height) {
  Figure figure{title, {std::move(plot)}};
  figure.plot_height = height;
  return figure;
}

std::string inline_svg(const Figure& figure) {
  return document(figure, false);
}

std::string standalone_svg(const Figure& figure) {
  return "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n" + document(figure, true);
}

std::string figure_css() {
  return "svg.figure{display:block;width:100%;height:auto}svg.figure .txt{fill:var(--ink)}svg.figure "
         ".sub{fill:var(--muted)}svg.figure .grid{stroke:var(--grid)}svg.figure .axis{stroke:var(--muted)}" +
         paint_css();
}

}  // namespace knothe::report
