#include "knothe/report/pages/page.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <string_view>

#include "knothe/base/text.hpp"
#include "knothe/files/json_line.hpp"

namespace knothe::report {

/// dashboard/dist/report.html, embedded (cmake/embed_page.cmake).
std::string_view report_template();

namespace {

const char* css_class(Usability usability) {
  return usability == Usability::usable ? "ok" : usability == Usability::with_caveats ? "caution" : "reject";
}

/// `part` for the comment `mark` of the template.
void put(std::string& page, std::string_view mark, const std::string& part) {
  if (const auto at = page.find(mark); at != std::string::npos) page.replace(at, mark.size(), part);
}

/// More columns than that do not fit a phone: there each row becomes a list, with the header's words in it.
constexpr std::size_t k_columns_of_phone = 3;

std::string html_of(const Table& table) {
  const bool is_wide = table.header.size() > k_columns_of_phone;
  std::string out = fmt::format("<div class=\"scroll{}\"><table{}>",
                                table.worth == Usability::usable         ? ""
                                : table.worth == Usability::with_caveats ? " demoted"
                                                                         : " demoted rejected",
                                is_wide ? " class=\"wide\"" : "");
  if (!table.caption.empty()) out += "<caption>" + escape_xml(table.caption) + "</caption>";
  if (!table.header.empty()) {
    out += "<thead><tr>";
    for (const auto& cell : table.header) out += "<th>" + escape_xml(cell) + "</th>";
    out += "</tr></thead>";
  }
  out += "<tbody>";
  for (const TableRow& row : table.rows) {
    out += row.expired ? "<tr class=\"expired\">" : "<tr>";
    for (std::size_t i = 0; i < row.cells.size(); ++i)
      out += (is_wide && i < table.header.size()
                  ? fmt::format("<td data-of=\"{}\">", escape_xml(table.header[i]))
                  : "<td>") +
             escape_xml(row.cells[i]) + "</td>";
    out += "</tr>";
  }
  return out + "</tbody></table></div>";
}

}  // namespace

std::string result_words(Usability usability) {
  switch (usability) {
    case Usability::usable:
      return "usable";
    case Usability::with_caveats:
      return "usable with caveats";
    case Usability::not_usable:
      return "do not use";
  }
  return {};
}

Page::Page(std::string title, std::string subtitle)
    : title_(std::move(title)), subtitle_(std::move(subtitle)) {}

Page& Page::result(Usability usability, const std::vector<std::string>& sentences) {
  return finding("Result: " + result_words(usability), usability, sentences);
}

Page& Page::finding(const std::string& words, Usability usability,
                    const std::vector<std::string>& sentences) {
  banner_ = fmt::format("<div class=\"result {}\" role=\"status\"><b class=\"word\">{}</b><div>",
                        css_class(usability), escape_xml(words));
  for (const std::string& sentence : sentences) banner_ += "<p>" + escape_xml(sentence) + "</p>";
  banner_ += "</div></div>\n";
  return *this;
}

Page& Page::next(const std::string& action, const std::string& why) {
  banner_ += fmt::format("<p class=\"next\"><b>Next: {}</b> {}</p>\n", escape_xml(action), escape_xml(why));
  return *this;
}

Page& Page::section(const std::string& heading) {
  headings_.push_back({fmt::format("s{}", headings_.size() + 1), heading});
  body_ += fmt::format("<h2 id=\"{}\">{}</h2>\n", headings_.back().id, escape_xml(heading));
  return *this;
}

Page& Page::paragraph(const std::string& text) {
  body_ += "<p>" + escape_xml(text) + "</p>\n";
  return *this;
}

Page& Page::note(const std::string& text) {
  body_ += "<p class=\"note\">" + escape_xml(text) + "</p>\n";
  return *this;
}

Page& Page::figures(const std::vector<FigurePlace>& figures, const std::string& caption) {
  if (figures.empty()) return *this;
  body_ += "<div class=\"row\">";
  for (const FigurePlace& figure : figures)
    body_ += fmt::format("<figure data-figure=\"{}\"><figcaption><b>Figure {}.</b> {}</figcaption></figure>",
                         escape_xml(figure.id), ++figures_, escape_xml(figure.title));
  body_ += "</div>\n";
  if (!caption.empty()) body_ += "<p class=\"caption\">" + escape_xml(caption) + "</p>\n";
  return *this;
}

Page& Page::tables(const std::vector<Table>& tables) {
  body_ += "<div class=\"tables\">";
  for (const Table& table : tables) body_ += "<div>" + html_of(table) + "</div>";
  body_ += "</div>\n";
  return *this;
}

Page& Page::table(const std::vector<std::string>& header, const std::vector<TableRow>& rows) {
  body_ += html_of({{}, header, rows}) + "\n";
  return *this;
}

Page& Page::image(const std::string& file, const std::string& words) {
  body_ += fmt::format("<p><img loading=\"lazy\" src=\"{}\" alt=\"{}\"/></p>\n", escape_xml(file),
                       escape_xml(words));
  return *this;
}

Page& Page::details(const std::string& heading, const std::string& text) {
  body_ += "<details><summary>" + escape_xml(heading) + "</summary><pre>" + escape_xml(text) +
           "</pre></details>\n";
  return *this;
}

std::string Page::html(const nlohmann::ordered_json& record) const {
  std::string links;
  for (const auto& heading : headings_)
    links += fmt::format("<a href=\"#{}\">{}</a>", heading.id, escape_xml(heading.text));
  std::string body = "<main>\n<div class=\"title\"><h1>" + escape_xml(title_) +
                     "</h1><div id=\"controls\"></div></div>\n<p class=\"subtitle\">" +
                     escape_xml(subtitle_) + "</p>\n" + banner_;
  if (figures_ > 0)
    body +=
        "<p class=\"note scriptless\">Figures need JavaScript; the result, the numbers and the tables "
        "do not.</p>\n";
  // Where to go on is said behind the first screen.
  const std::size_t first = std::min(body_.find("<h2"), body_.size());
  body += body_.substr(0, first) + "<nav>" + links + "</nav>\n" + body_.substr(first) + "</main>";
  // What ends a script element, or opens a comment in it, is written otherwise.
  std::string json = files::json_line(record);
  for (std::size_t at = json.find('<'); at != std::string::npos; at = json.find('<', at + 1))
    json.replace(at, 1, "\\u003c");
  std::string page(report_template());
  put(page, "<!--TITLE-->", escape_xml(title_));
  put(page, "<!--BODY-->", body);
  put(page, "<!--RECORD-->", json);
  return page;
}

}  // namespace knothe::report
