#pragma once
/// @file A page that needs nothing but itself: words and tables are written here, figures are drawn by the
/// dashboard's components (dashboard/src/report), which are part of it, from the record that it holds.
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace knothe::report {

/// Whether what a page shows can be used: its words and its colour.
enum class Usability { usable, with_caveats, not_usable };
[[nodiscard]] std::string result_words(Usability usability);

struct TableRow {
  std::vector<std::string> cells;
  bool expired = false;  ///< of a time that is over: grey
};

struct Table {
  std::string caption;
  std::vector<std::string> header;
  std::vector<TableRow> rows;
  Usability worth = Usability::usable;  ///< of its numbers: grey with caveats, struck out if not usable
};

/// A place for a figure. `id` is a name that dashboard/src/report/figures.ts knows, with what it is of:
/// "marginal:0".
struct FigurePlace {
  std::string id;
  std::string title;
};

/// Builds an HTML page from top to bottom. All texts are plain text: they are escaped here.
class Page {
 public:
  Page(std::string title, std::string subtitle);

  /// The banner at the top: "Result: usable", and the sentences that say why.
  Page& result(Usability usability, const std::vector<std::string>& sentences);
  /// The same of what is no estimate: in place of "Result: usable" words of its own, in that colour.
  Page& finding(const std::string& words, Usability usability, const std::vector<std::string>& sentences);
  /// Below the banner: what to do next with the specimen, and why.
  Page& next(const std::string& action, const std::string& why);
  Page& section(const std::string& heading);
  Page& paragraph(const std::string& text);
  Page& note(const std::string& text);  ///< for what is missing, and warnings
  /// Figures side by side where the screen is wide enough, numbered through the page.
  Page& figures(const std::vector<FigurePlace>& figures, const std::string& caption = {});
  /// Tables side by side.
  Page& tables(const std::vector<Table>& tables);
  Page& table(const std::vector<std::string>& header, const std::vector<TableRow>& rows);
  /// A picture in a file beside the page.
  Page& image(const std::string& file, const std::string& words);
  /// Preformatted text behind a heading that opens it.
  Page& details(const std::string& heading, const std::string& text);

  /// The page with the record that its figures are drawn from (dashboard/src/report/record.ts).
  [[nodiscard]] std::string html(const nlohmann::ordered_json& record) const;

 private:
  struct Heading {
    std::string id, text;
  };
  std::string title_, subtitle_, banner_, body_;
  std::vector<Heading> headings_;
  int figures_ = 0;
};

}  // namespace knothe::report
