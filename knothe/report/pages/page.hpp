#pragma once
/// @file A page that needs nothing but itself: no network, light and dark, small screens, paper.
#include <string>
#include <vector>

#include "knothe/report/figures/svg_figure.hpp"

namespace knothe::report {

/// A short statement of a result: "Y0", "1.04 ± 0.041", "true value 1".
struct Card {
  std::string name;
  std::string value;
  std::string remark;
  bool warning = false, caution = false;
};

struct TableRow {
  std::vector<std::string> cells;
};

/// Builds an HTML page from top to bottom. All texts are plain text: they are escaped here.
class Page {
 public:
  Page(std::string title, std::string subtitle);

  Page& section(const std::string& heading);
  Page& paragraph(const std::string& text);
  Page& note(const std::string& text);  ///< for what is missing, and warnings
  Page& cards(const std::vector<Card>& cards);
  Page& figure(const Figure& figure, const std::string& caption);
  /// Figures side by side where the screen is wide enough.
  Page& figures(const std::vector<Figure>& figures, const std::string& caption);
  Page& table(const std::vector<std::string>& header, const std::vector<TableRow>& rows);
  /// Preformatted text behind a heading that opens it.
  Page& details(const std::string& heading, const std::string& text);

  [[nodiscard]] std::string html() const;

 private:
  struct Heading {
    std::string id, text;
  };
  std::string title_, subtitle_, body_;
  std::vector<Heading> headings_;
};

}  // namespace knothe::report
