#include "knothe/report/pages/page.hpp"

#include <fmt/core.h>

#include "knothe/base/text.hpp"
#include "knothe/record/number_text.hpp"

namespace knothe::report {
namespace {

constexpr const char* k_style = R"css(
:root{--paper:#ffffff;--card:#f5f7f9;--ink:#1c2530;--muted:#5d6873;--grid:#dfe3e7;--line:#d5dade;--accent:#00629b;--warn:#b3261e;--caution:#b26a00;color-scheme:light dark}
@media screen and (prefers-color-scheme:dark){:root{--paper:#14181d;--card:#1d232a;--ink:#e4e8ec;--muted:#9ea8b2;--grid:#2d343c;--line:#38414a;--accent:#7cc4f5;--warn:#ff8a80;--caution:#ffb74d}}
*{box-sizing:border-box}
body{margin:0;background:var(--paper);color:var(--ink);font:16px/1.55 system-ui,-apple-system,"Segoe UI",Roboto,"Helvetica Neue",Arial,sans-serif}
main{max-width:1080px;margin:0 auto;padding:24px 18px 64px}
h1{font-size:1.75rem;line-height:1.2;margin:.2em 0}
h2{font-size:1.25rem;margin:2.2em 0 .5em;padding-top:.5em;border-top:1px solid var(--line)}
p{max-width:70ch;margin:.6em 0}
.subtitle{color:var(--muted);margin:0 0 1em}
nav{font-size:.9rem;margin:1em 0 0}
nav a{display:inline-block;margin:0 14px 4px 0}
a{color:var(--accent)}
.cards{display:grid;grid-template-columns:repeat(auto-fit,minmax(178px,1fr));gap:12px;margin:1.2em 0}
.card{background:var(--card);border-radius:8px;padding:12px 14px;border-left:4px solid var(--accent)}
.card.warning{border-color:var(--warn)}
.card.caution{border-color:var(--caution)}
.card b{display:block;font-size:.85rem;font-weight:600;color:var(--muted)}
.card span{display:block;font-size:1.35rem;font-weight:650;line-height:1.3}
.card small{color:var(--muted);font-size:.85rem}
.note{border-left:4px solid var(--muted);padding-left:12px;color:var(--muted)}
figure{margin:1em 0 1.6em;break-inside:avoid}
.row{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,380px),1fr));gap:18px 26px}
figcaption{color:var(--muted);font-size:.92rem;max-width:78ch;margin-top:.5em}
.scroll{overflow-x:auto}
table{border-collapse:collapse;font-size:.92rem;margin:1em 0}
th,td{text-align:left;vertical-align:top;padding:7px 14px 7px 0;border-bottom:1px solid var(--line)}
th{color:var(--muted);font-weight:600}
td:first-child{font-weight:600}
details{margin:1em 0}
summary{cursor:pointer;color:var(--accent)}
pre{background:var(--card);padding:12px;border-radius:8px;overflow-x:auto;font-size:.82rem;line-height:1.45}
@media print{body{font-size:10.5pt}main{max-width:none;padding:0}nav{display:none}h2{break-after:avoid}.card{border:1px solid #bbb;border-left:4px solid #00629b}a{color:inherit;text-decoration:none}}
)css";

}  // namespace

Page::Page(std::string title, std::string subtitle)
    : title_(std::move(title)), subtitle_(std::move(subtitle)) {}

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

Page& Page::cards(const std::vector<Card>& cards) {
  body_ += "<div class=\"cards\">";
  for (const auto& card : cards)
    body_ += fmt::format("<div class=\"card{}\"><b>{}</b><span>{}</span><small>{}</small></div>",
                         card.warning   ? " warning"
                         : card.caution ? " caution"
                                        : "",
                         escape_xml(card.name), escape_xml(card.value), escape_xml(card.remark));
  body_ += "</div>\n";
  return *this;
}

Page& Page::figure(const Figure& figure, const std::string& caption) {
  return figures({figure}, caption);
}

Page& Page::figures(const std::vector<Figure>& figures, const std::string& caption) {
  body_ += "<figure><div class=\"row\">";
  for (const auto& figure : figures) body_ += "<div>" + inline_svg(figure) + "</div>";
  body_ += "</div><figcaption>" + escape_xml(caption) + "</figcaption></figure>\n";
  return *this;
}

Page& Page::table(const std::vector<std::string>& header, const std::vector<TableRow>& rows) {
  body_ += "<div class=\"scroll\"><table>";
  if (!header.empty()) {
    body_ += "<thead><tr>";
    for (const auto& cell : header) body_ += "<th>" + escape_xml(cell) + "</th>";
    body_ += "</tr></thead>";
  }
  body_ += "<tbody>";
  for (const auto& row : rows) {
    body_ += "<tr>";
    for (const auto& cell : row.cells) body_ += "<td>" + escape_xml(cell) + "</td>";
    body_ += "</tr>";
  }
  body_ += "</tbody></table></div>\n";
  return *this;
}

Page& Page::details(const std::string& heading, const std::string& text) {
  body_ += "<details><summary>" + escape_xml(heading) + "</summary><pre>" + escape_xml(text) +
           "</pre></details>\n";
  return *this;
}

std::string Page::html() const {
  std::string links;
  for (const auto& heading : headings_)
    links += fmt::format("<a href=\"#{}\">{}</a>", heading.id, escape_xml(heading.text));
  return "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"/>"
         "<meta name=\"viewport\" content=\"width=device-width,initial-scale=1\"/><title>" +
         escape_xml(title_) + "</title><style>" + k_style + figure_css() +
         "</style></head>\n<body><main><h1>" + escape_xml(title_) + "</h1><p class=\"subtitle\">" +
         escape_xml(subtitle_) + "</p><nav>" + links + "</nav>\n" + body_ + "</main></body></html>\n";
}

}  // namespace knothe::report
