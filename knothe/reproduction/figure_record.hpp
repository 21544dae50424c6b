#pragma once
/// @file What the study says about one figure of the paper.
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "knothe/report/figures/svg_figure.hpp"

namespace knothe::reproduction {

/// "paper / here / why they differ", one line of a figure's table.
struct Row {
  std::string quantity;  ///< what is compared
  std::string unit;      ///< of the two values; "1" for a pure number
  std::string paper;     ///< what the paper says, for people
  std::string here;      ///< what came out here, for people
  std::string why;       ///< why they differ, or why they agree
  std::optional<double> paper_value = {};
  std::optional<double> here_value = {};
};

/// Plots side by side with one caption.
struct Panel {
  std::vector<report::Figure> figures;
  std::string caption;
};

/// A table beside the figure: the same numbers for other choices.
struct Table {
  std::string caption;
  std::vector<std::string> header;
  std::vector<std::vector<std::string>> rows;
};

/// One figure of the paper, or a group that belongs together.
struct FigureRecord {
  std::string number;   ///< of the paper: "5", "6-7", …; a word for what it leaves open
  std::string title;    ///< what it shows
  std::string setting;  ///< what was computed here, and what was chosen
  std::vector<Panel> panels;
  std::vector<Row> rows;
  std::vector<Table> tables;
  /// Named series behind the plots, for the JSON file.
  std::vector<std::pair<std::string, std::vector<double>>> data;
};

}  // namespace knothe::reproduction
