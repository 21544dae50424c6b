#pragma once
/// @file Figures as SVG: one or several plots with axes, ticks, legends and colour bars.
#include <array>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "knothe/report/figures/colour_map.hpp"

namespace knothe::report {

/// An axis; its limits are those of the data (with a little air) unless given.
struct PlotAxis {
  std::string label;  ///< with the unit: "Force (kN)"
  std::optional<double> low = {};
  std::optional<double> high = {};
  bool logarithmic = false;
};

struct Stroke {
  double width = 1.8;     ///< px
  std::string dash = {};  ///< SVG dash array, e.g. "5 4"; empty: solid
  double opacity = 1.0;
};

enum class Side { left, right };  ///< which vertical axis a series belongs to

/// Vertical bar beside a plot that says which colour is which number.
struct ColourBar {
  enum class Map { time, viridis, blue_white_red };
  std::string label;
  double low = 0.0;
  double high = 1.0;
  Map map = Map::viridis;
};

/// Polygon in data coordinates with a colour of its own ("#rrggbb"): an element of a mesh.
struct Cell {
  std::vector<std::array<double, 2>> corners;
  std::string colour;
};

/// One pair of axes and what is drawn in them, in the order in which it was added. Series of one plot with
/// the same non-empty label share one entry of the legend. All numbers must be finite: adding others throws
/// NumericalError.
class Plot {
 public:
  Plot(std::string title, PlotAxis x, PlotAxis y)
      : title_(std::move(title)), x_(std::move(x)), y_(std::move(y)) {}

  Plot& line(std::span<const double> x, std::span<const double> y, Paint paint, std::string label = {},
             Stroke stroke = {}, Side side = Side::left);
  /// Piecewise constant: y[i] holds from x[i] to x[i + 1].
  Plot& steps(std::span<const double> x, std::span<const double> y, Paint paint, std::string label = {},
              Stroke stroke = {}, Side side = Side::left);
  /// Filled between two curves.
  Plot& band(std::span<const double> x, std::span<const double> low, std::span<const double> high,
             Paint paint, std::string label = {}, double opacity = 0.22);
  /// Bars from zero, `width` wide in data units.
  Plot& bars(std::span<const double> x, std::span<const double> height, double width, Paint paint,
             std::string label = {}, Side side = Side::left, double opacity = 0.55);
  Plot& scatter(std::span<const double> x, std::span<const double> y, Paint paint, std::string label = {},
                double radius = 3.0, Side side = Side::left);
  Plot& vertical(double x, Paint paint, std::string label = {}, Stroke stroke = {1.6, "6 4", 1.0});
  Plot& horizontal(double y, Paint paint, std::string label = {}, Stroke stroke = {1.6, "6 4", 1.0},
                   Side side = Side::left);
  Plot& cells(std::vector<Cell> cells);

  Plot& right_axis(PlotAxis axis) { return right_ = std::move(axis), *this; }
  Plot& colour_bar(ColourBar bar) { return bar_ = std::move(bar), *this; }
  /// Same scale in both directions.
  Plot& equal_scales() { return equal_scales_ = true, *this; }
  /// The same without axes: for meshes.
  Plot& as_map() { return equal_scales_ = map_ = true, *this; }

  /// SVG elements for a plot whose upper left corner is (left, top), of the given size in px.
  [[nodiscard]] std::string render(double left, double top, double width, double height) const;

 private:
  friend class PlotRenderer;
  enum class Kind { line, band, bars, scatter, vertical, horizontal };
  struct Series {
    Kind kind;
    std::vector<double> x, y, lower;
    Paint paint;
    std::string label;
    Stroke stroke;
    Side side = Side::left;
    double size = 0.0;  ///< width of bars in data units, radius of points in px
  };
  Plot& add(Series series);

  std::string title_;
  PlotAxis x_, y_;
  std::optional<PlotAxis> right_;
  std::optional<ColourBar> bar_;
  bool equal_scales_ = false, map_ = false;
  std::vector<Series> series_;
  std::vector<Cell> cells_;
};

/// Plots in rows of `columns`, each `plot_width` × `plot_height` px.
struct Figure {
  std::string title;  ///< for readers who cannot see it
  std::vector<Plot> plots;
  int columns = 1;
  double plot_width = 460.0;
  double plot_height = 320.0;
};

/// One plot as a figure.
[[nodiscard]] Figure figure_of(Plot plot, const std::string& title, double height = 300.0);
/// The figure for a page that has `figure_css()` in its style: colours follow light and dark.
[[nodiscard]] std::string inline_svg(const Figure& figure);
/// The figure as a file of its own: white paper, all colours fixed.
[[nodiscard]] std::string standalone_svg(const Figure& figure);
/// Style that inline figures rely on.
[[nodiscard]] std::string figure_css();

}  // namespace knothe::report
