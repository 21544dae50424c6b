// How a Plot becomes SVG elements: limits, layout, axes, then the series.
#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "knothe/base/text.hpp"
#include "knothe/record/number_text.hpp"
#include "knothe/report/figures/svg_figure.hpp"

namespace knothe::report {
namespace {

constexpr const char* k_text = R"(class="txt" fill="#1c2530")";
constexpr const char* k_subdued = R"(class="sub" fill="#5d6873")";

/// Number of characters, not bytes.
std::size_t characters(const std::string& text) {
  return std::count_if(text.begin(), text.end(),
                       [](char c) { return (static_cast<unsigned char>(c) & 0xC0) != 0x80; });
}

/// Estimated width in px of a text of 12 px.
double text_width(const std::string& text) {
  return 6.6 * characters(text);
}

std::string text_at(double x, double y, const std::string& text, const char* anchor, const char* look,
                    const char* more = "") {
  return fmt::format(R"(<text x="{}" y="{}" text-anchor="{}" {} {}>{}</text>)", record::coordinate(x),
                     record::coordinate(y), anchor, look, more, escape_xml(text));
}

std::string line_at(double x1, double y1, double x2, double y2, const char* look) {
  return fmt::format(R"(<line x1="{}" y1="{}" x2="{}" y2="{}" {}/>)", record::coordinate(x1),
                     record::coordinate(y1), record::coordinate(x2), record::coordinate(y2), look);
}

std::string painted(const Paint& paint) {
  return fmt::format(R"(class="{}" color="{}")", paint.css_class(), paint.colour());
}

std::string bar_colour(ColourBar::Map map, double fraction) {
  return map == ColourBar::Map::blue_white_red ? blue_white_red(fraction) : viridis(fraction);
}

/// Maps numbers to pixels along one axis.
struct Scale {
  double low = 0.0, high = 1.0, from = 0.0, to = 1.0;
  bool logarithmic = false;

  [[nodiscard]] double fraction(double value) const {
    if (logarithmic) {
      const double floor = std::log(low);
      return (std::log(std::max(value, 1e-300)) - floor) / (std::log(high) - floor);
    }
    return (value - low) / (high - low);
  }
  /// Kept within a sane distance, so that a number far outside the axis stays a short, valid coordinate.
  [[nodiscard]] double operator()(double value) const {
    return from + std::clamp(fraction(value), -20.0, 21.0) * (to - from);
  }
  [[nodiscard]] record::Ticks ticks(int wanted) const {
    return logarithmic ? record::decade_ticks(low, high, wanted) : record::nice_ticks(low, high, wanted);
  }
};

}  // namespace

class PlotRenderer {
 public:
  PlotRenderer(const Plot& plot, double left, double top, double width, double height)
      : plot_(plot), left_(left), top_(top), width_(width), height_(height) {
    set_limits();
    set_layout();
  }

  [[nodiscard]] std::string render() const {
    std::string svg = "<g>";
    if (!plot_.title_.empty())
      svg += text_at(left_, top_ + 13, plot_.title_, "start", k_text, R"(font-size="13" font-weight="600")");
    svg += legend();
    if (!plot_.map_) svg += axes();
    // A nested viewport clips what lies outside the axes.
    svg +=
        fmt::format(R"(<svg x="{0}" y="{1}" width="{2}" height="{3}" viewBox="{0} {1} {2} {3}">)",
                    record::coordinate(box_left_), record::coordinate(box_top_),
                    record::coordinate(box_right_ - box_left_), record::coordinate(box_bottom_ - box_top_));
    svg += cells();
    for (const auto& series : plot_.series_) svg += draw(series);
    svg += "</svg>";
    if (plot_.bar_) svg += colour_bar();
    return svg + "</g>";
  }

 private:
  using Kind = Plot::Kind;
  using Series = Plot::Series;

  struct Range {
    double low = std::numeric_limits<double>::infinity();
    double high = -std::numeric_limits<double>::infinity();
    void include(double value) { low = std::min(low, value), high = std::max(high, value); }
  };

  static Scale scale_of(const PlotAxis& axis, Range range, bool from_zero) {
    if (from_zero) range.include(0.0);
    if (!(range.low <= range.high)) range = {0.0, 1.0};
    Scale scale;
    scale.logarithmic = axis.logarithmic && range.low > 0.0;
    if (scale.logarithmic) {
      const double air = std::max(std::pow(range.high / range.low, 0.05), 1.05);
      scale.low = axis.low.value_or(range.low / air);
      scale.high = axis.high.value_or(range.high * air);
      if (!(scale.low > 0.0 && scale.high > scale.low))
        scale.low = range.low / 2, scale.high = range.high * 2;
      return scale;
    }
    double span = range.high - range.low;
    if (!(span > 0.0)) span = range.low != 0.0 ? 0.2 * std::abs(range.low) : 1.0;
    const bool flat = range.high == range.low;
    scale.low = axis.low.value_or(
        from_zero && range.low == 0.0 && !flat ? 0.0 : range.low - (flat ? 0.5 : 0.04) * span);
    scale.high = axis.high.value_or(range.high + (flat ? 0.5 : 0.06) * span);
    if (!(scale.high > scale.low)) scale.high = scale.low + span;
    return scale;
  }

  void set_limits() {
    Range x, y, right;
    bool bars_left = false, bars_right = false;
    for (const auto& s : plot_.series_) {
      Range& vertical = s.side == Side::right ? right : y;
      for (std::size_t i = 0; i < s.x.size(); ++i) {
        const double half = s.kind == Kind::bars ? 0.5 * s.size : 0.0;
        if (s.kind != Kind::horizontal) x.include(s.x[i] - half), x.include(s.x[i] + half);
        if (s.kind != Kind::vertical) vertical.include(s.y[i]);
        if (s.kind == Kind::band) vertical.include(s.lower[i]);
      }
      if (s.kind == Kind::bars) (s.side == Side::right ? bars_right : bars_left) = true;
    }
    for (const auto& cell : plot_.cells_)
      for (const auto& corner : cell.corners) x.include(corner[0]), y.include(corner[1]);
    x_ = scale_of(plot_.x_, x, false);
    if (!plot_.x_.logarithmic && x.low < x.high && !plot_.equal_scales_) {  // no air beside the data along x
      x_.low = plot_.x_.low.value_or(x.low);
      x_.high = plot_.x_.high.value_or(x.high);
      if (!(x_.high > x_.low)) x_.high = x_.low + 1.0;
    }
    y_ = scale_of(plot_.y_, y, bars_left);
    if (plot_.right_) right_ = scale_of(*plot_.right_, right, bars_right);
  }

  void set_layout() {
    double header = plot_.title_.empty() ? 0.0 : 22.0;
    legend_top_ = top_ + header;
    place_legend();
    header += 18.0 * legend_rows_;
    const bool captioned = !plot_.map_ && (!plot_.y_.label.empty() || plot_.right_ || plot_.bar_);
    if (captioned || plot_.bar_) header += 20.0;
    box_top_ = top_ + header + 6.0;
    box_bottom_ = top_ + height_ - (plot_.map_ ? 4.0 : plot_.x_.label.empty() ? 24.0 : 42.0);
    double left = 0.0, right = 14.0;  // half of the last label along x
    if (!plot_.map_) left = room_for_y_ticks();
    if (plot_.right_) {
      right_ticks_ = right_.ticks(vertical_ticks());
      right = 0.0;
      for (const auto& label : right_ticks_.labels) right = std::max(right, text_width(label));
      right += 12.0;
    }
    if (plot_.bar_) {
      double labels = 0.0;
      for (const auto& label : record::nice_ticks(plot_.bar_->low, plot_.bar_->high, 5).labels)
        labels = std::max(labels, text_width(label));
      right += labels + 26.0;
    }
    box_left_ = left_ + left;
    box_right_ = left_ + width_ - right;
    if (plot_.equal_scales_) keep_aspect();
    if (plot_.equal_scales_ && !plot_.map_) box_left_ = left_ + room_for_y_ticks(), keep_aspect();
    x_.from = box_left_, x_.to = box_right_;
    y_.from = box_bottom_, y_.to = box_top_;
    right_.from = box_bottom_, right_.to = box_top_;
  }

  [[nodiscard]] int vertical_ticks() const { return std::clamp<int>((box_bottom_ - box_top_) / 42.0, 3, 7); }

  void keep_aspect() {
    const double per_x = (x_.high - x_.low) / (box_right_ - box_left_);
    const double per_y = (y_.high - y_.low) / (box_bottom_ - box_top_);
    const double per = std::max(per_x, per_y);
    const double x_middle = 0.5 * (x_.low + x_.high), y_middle = 0.5 * (y_.low + y_.high);
    const double half_x = 0.5 * per * (box_right_ - box_left_), half_y = 0.5 * per * (box_bottom_ - box_top_);
    x_.low = x_middle - half_x, x_.high = x_middle + half_x;
    y_.low = y_middle - half_y, y_.high = y_middle + half_y;
  }

  /// Chooses the ticks; the width of their labels.
  [[nodiscard]] double room_for_y_ticks() {
    y_ticks_ = y_.ticks(vertical_ticks());
    double width = 0.0;
    for (const auto& label : y_ticks_.labels) width = std::max(width, text_width(label));
    return width + 10.0;
  }

  struct LegendEntry {
    const Series* series;
    double x;
    int row;
  };

  void place_legend() {
    double x = left_;
    int row = 0;
    std::map<std::string, bool> seen;
    for (const auto& s : plot_.series_) {
      if (s.label.empty() || seen[s.label]) continue;
      seen[s.label] = true;
      const double needed = 26.0 + text_width(s.label) + 14.0;
      if (x > left_ && x + needed > left_ + width_ + 14.0) x = left_, ++row;
      entries_.push_back({&s, x, row});
      x += needed;
    }
    legend_rows_ = entries_.empty() ? 0 : row + 1;
  }

  [[nodiscard]] std::string legend() const {
    std::string svg;
    for (const auto& entry : entries_) {
      const Series& s = *entry.series;
      const double y = legend_top_ + 18.0 * entry.row + 9.0;
      if (s.kind == Kind::band || s.kind == Kind::bars) {
        svg += fmt::format(
            R"(<rect {} x="{}" y="{}" width="20" height="10" fill="currentColor" fill-opacity="{}"/>)",
            painted(s.paint), record::coordinate(entry.x), record::coordinate(y - 5),
            record::coordinate(s.stroke.opacity));
      } else if (s.kind == Kind::scatter) {
        svg += fmt::format(R"(<circle {} cx="{}" cy="{}" r="{}" fill="currentColor"/>)", painted(s.paint),
                           record::coordinate(entry.x + 10), record::coordinate(y),
                           record::coordinate(std::min(s.size, 5.0)));
      } else {
        svg +=
            fmt::format(R"(<path {} d="M{} {}h20" fill="none" stroke="currentColor" {}/>)", painted(s.paint),
                        record::coordinate(entry.x), record::coordinate(y), stroke_of(s.stroke));
      }
      svg += text_at(entry.x + 26, y + 4, s.label, "start", k_text);
    }
    return svg;
  }

  [[nodiscard]] std::string axes() const {
    constexpr const char* grid = R"(class="grid" stroke="#dfe3e7" stroke-width="1")";
    constexpr const char* axis = R"(class="axis" stroke="#5d6873" stroke-width="1")";
    std::string svg;
    for (std::size_t i = 0; i < y_ticks_.values.size(); ++i) {
      const double y = y_(y_ticks_.values[i]);
      svg += line_at(box_left_, y, box_right_, y, grid);
      svg += text_at(box_left_ - 6, y + 4, y_ticks_.labels[i], "end", k_subdued);
    }
    const record::Ticks x_ticks = x_.ticks(std::clamp<int>((box_right_ - box_left_) / 70.0, 3, 9));
    for (std::size_t i = 0; i < x_ticks.values.size(); ++i) {
      const double x = x_(x_ticks.values[i]);
      svg += line_at(x, box_bottom_, x, box_bottom_ + 4, axis);
      svg += text_at(x, box_bottom_ + 17, x_ticks.labels[i], "middle", k_subdued);
    }
    svg += line_at(box_left_, box_bottom_, box_right_, box_bottom_, axis);
    svg += text_at(left_, box_top_ - 10, plot_.y_.label, "start", k_subdued);
    if (!plot_.x_.label.empty())
      svg += text_at(0.5 * (box_left_ + box_right_), box_bottom_ + 36, plot_.x_.label, "middle", k_subdued);
    if (plot_.right_) {
      for (std::size_t i = 0; i < right_ticks_.values.size(); ++i)
        svg += text_at(box_right_ + 6, right_(right_ticks_.values[i]) + 4, right_ticks_.labels[i], "start",
                       k_subdued);
      svg += text_at(left_ + width_, box_top_ - 10, plot_.right_->label, "end", k_subdued);
    }
    return svg;
  }

  [[nodiscard]] std::string colour_bar() const {
    const ColourBar& bar = *plot_.bar_;
    constexpr int levels = 32;
    const double x = box_right_ + 10.0 + (plot_.right_ ? 24.0 : 0.0);
    const double height = box_bottom_ - box_top_, cell = height / levels;
    std::string svg;
    for (int i = 0; i < levels; ++i) {
      const double fraction = i / (levels - 1.0);
      const double y = box_bottom_ - (i + 1) * cell;
      const std::string place = fmt::format(R"(x="{}" y="{}" width="10" height="{}")", record::coordinate(x),
                                            record::coordinate(y), record::coordinate(cell + 0.3));
      svg += bar.map == ColourBar::Map::time
                 ? fmt::format(R"(<rect {} {} fill="currentColor"/>)", painted(Paint::time(fraction)), place)
                 : fmt::format(R"(<rect {} fill="{}"/>)", place, bar_colour(bar.map, fraction));
    }
    const record::Ticks ticks = record::nice_ticks(bar.low, bar.high, 5);
    for (std::size_t i = 0; i < ticks.values.size(); ++i) {
      const double fraction = bar.high > bar.low ? (ticks.values[i] - bar.low) / (bar.high - bar.low) : 0.5;
      svg += text_at(x + 14, box_bottom_ - fraction * height + 4, ticks.labels[i], "start", k_subdued);
    }
    return svg + text_at(left_ + width_, box_top_ - 10, bar.label, "end", k_subdued);
  }

  /// Cells of one colour become one path: a tenth of the size.
  [[nodiscard]] std::string cells() const {
    std::map<std::string, std::string> paths;
    for (const auto& cell : plot_.cells_) {
      std::string& path = paths[cell.colour];
      for (std::size_t i = 0; i < cell.corners.size(); ++i)
        path += fmt::format("{}{} {}", i == 0 ? "M" : "L", record::coordinate(x_(cell.corners[i][0])),
                            record::coordinate(y_(cell.corners[i][1])));
      path += "z";
    }
    std::string svg;
    for (const auto& [colour, path] : paths)
      svg += fmt::format(R"(<path d="{}" fill="{}" stroke="{}" stroke-width="0.35"/>)", path, colour, colour);
    return svg;
  }

  static std::string stroke_of(const Stroke& stroke) {
    std::string out =
        fmt::format(R"(stroke-width="{}" stroke-linejoin="round")", record::coordinate(stroke.width));
    if (!stroke.dash.empty()) out += fmt::format(R"( stroke-dasharray="{}")", escape_xml(stroke.dash));
    if (stroke.opacity < 1.0)
      out += fmt::format(R"( stroke-opacity="{}")", record::coordinate(stroke.opacity));
    return out;
  }

  [[nodiscard]] std::string path_through(const std::vector<double>& x, const std::vector<double>& y,
                                         const Scale& scale, bool backwards, bool begin) const {
    std::string path;
    for (std::size_t n = 0; n < x.size(); ++n) {
      const std::size_t i = backwards ? x.size() - 1 - n : n;
      path += fmt::format("{}{} {}", begin && n == 0 ? "M" : "L", record::coordinate(x_(x[i])),
                          record::coordinate(scale(y[i])));
    }
    return path;
  }

  [[nodiscard]] std::string draw(const Series& s) const {
    const Scale& scale = s.side == Side::right ? right_ : y_;
    std::string svg;
    switch (s.kind) {
      case Kind::line:
        if (s.x.empty()) return svg;
        return fmt::format(R"(<path {} d="{}" fill="none" stroke="currentColor" {}/>)", painted(s.paint),
                           path_through(s.x, s.y, scale, false, true), stroke_of(s.stroke));
      case Kind::band:
        if (s.x.empty()) return svg;
        return fmt::format(R"(<path {} d="{}{}z" fill="currentColor" fill-opacity="{}"/>)", painted(s.paint),
                           path_through(s.x, s.y, scale, false, true),
                           path_through(s.x, s.lower, scale, true, false),
                           record::coordinate(s.stroke.opacity));
      case Kind::bars:
        for (std::size_t i = 0; i < s.x.size(); ++i) {
          const double a = x_(s.x[i] - 0.5 * s.size), b = x_(s.x[i] + 0.5 * s.size);
          const double y0 = scale(std::max(0.0, scale.low)), y1 = scale(s.y[i]);
          svg += fmt::format(
              R"(<rect {} x="{}" y="{}" width="{}" height="{}" fill="currentColor" fill-opacity="{}"/>)",
              painted(s.paint), record::coordinate(a), record::coordinate(std::min(y0, y1)),
              record::coordinate(b - a), record::coordinate(std::abs(y1 - y0)),
              record::coordinate(s.stroke.opacity));
        }
        return svg;
      case Kind::scatter:
        for (std::size_t i = 0; i < s.x.size(); ++i)
          svg += fmt::format(R"(<circle {} cx="{}" cy="{}" r="{}" fill="currentColor"/>)", painted(s.paint),
                             record::coordinate(x_(s.x[i])), record::coordinate(scale(s.y[i])),
                             record::coordinate(s.size));
        return svg;
      case Kind::vertical:
        return fmt::format(R"(<path {} d="M{} {}V{}" fill="none" stroke="currentColor" {}/>)",
                           painted(s.paint), record::coordinate(x_(s.x[0])), record::coordinate(box_bottom_),
                           record::coordinate(box_top_), stroke_of(s.stroke));
      case Kind::horizontal:
        return fmt::format(R"(<path {} d="M{} {}H{}" fill="none" stroke="currentColor" {}/>)",
                           painted(s.paint), record::coordinate(box_left_), record::coordinate(scale(s.y[0])),
                           record::coordinate(box_right_), stroke_of(s.stroke));
    }
    return svg;
  }

  const Plot& plot_;
  double left_, top_, width_, height_;
  double legend_top_ = 0.0;
  int legend_rows_ = 0;
  std::vector<LegendEntry> entries_;
  double box_left_ = 0.0, box_right_ = 1.0, box_top_ = 0.0, box_bottom_ = 1.0;
  Scale x_, y_, right_;
  record::Ticks y_ticks_, right_ticks_;
};

std::string Plot::render(double left, double top, double width, double height) const {
  return PlotRenderer(*this, left, top, width, height).render();
}

}  // namespace knothe::report
