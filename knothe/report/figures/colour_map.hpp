#pragma once
/// @file Colours: a perceptually even map for numbers (viridis) and eight that the colour-blind can tell
/// apart.
#include <string>

namespace knothe::report {

/// "#rrggbb" of the viridis map at `fraction`, clamped to [0, 1].
[[nodiscard]] std::string viridis(double fraction);

/// "#rrggbb" of a blue–white–red map at `fraction`; 0.5 is neutral. For fields with a sign.
[[nodiscard]] std::string blue_white_red(double fraction);

/// What an element is painted with. A paint has a CSS class, so that the page can give it another colour on
/// dark paper, and a plain colour for pictures that stand alone.
class Paint {
 public:
  /// One of eight colours for data series (Okabe and Ito's order: blue, vermilion, green, …).
  static Paint series(int index);
  /// Colour for a time, `fraction` in [0, 1]: viridis in 32 levels, the late ones with the most contrast to
  /// the paper.
  static Paint time(double fraction);
  static Paint ink();    ///< the colour of text and axes
  static Paint faint();  ///< secondary lines: priors, grids
  static Paint truth();  ///< the value to be found

  [[nodiscard]] const std::string& css_class() const { return css_class_; }
  [[nodiscard]] const std::string& colour() const { return colour_; }

 private:
  Paint(std::string css_class, std::string colour)
      : css_class_(std::move(css_class)), colour_(std::move(colour)) {}
  std::string css_class_;
  std::string colour_;
};

/// CSS that gives every paint its colour: on light paper, and, inside a media query, on dark.
[[nodiscard]] std::string paint_css();

}  // namespace knothe::report
