#include "knothe/files/calculix.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <map>
#include <sstream>
#include <string_view>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/numbers.hpp"

// The format: G. Dhondt, CalculiX CrunchiX User's Manual; K. Wittig, CalculiX GraphiX, "Result Format".

namespace knothe::files {
namespace {

std::string_view trimmed(std::string_view text) {
  const std::size_t begin = text.find_first_not_of(' ');
  if (begin == std::string_view::npos) return {};
  return text.substr(begin, text.find_last_not_of(" \r") - begin + 1);
}

std::vector<std::string> words_of(const std::string& line) {
  std::istringstream stream(line);
  std::vector<std::string> words;
  for (std::string word; stream >> word;) words.push_back(word);
  return words;
}

/// Lines of a file, one after the other.
class Lines {
 public:
  explicit Lines(const std::string& path) : path_(path), stream_(text_of(path)) {}

  bool next() {
    ++number_;
    return static_cast<bool>(std::getline(stream_, line_));
  }
  [[nodiscard]] const std::string& line() const { return line_; }
  [[nodiscard]] bool starts_with(std::string_view text) const { return line_.starts_with(text); }
  [[noreturn]] void fail(const std::string& what) const {
    throw DataError(fmt::format("{}:{}: error: {}", path_, number_, what));
  }
  /// Columns of fixed width: numbers may stand without a space between them.
  [[nodiscard]] std::string_view columns(std::size_t from, std::size_t count) const {
    return from < line_.size() ? trimmed(std::string_view(line_).substr(from, count)) : std::string_view();
  }
  [[nodiscard]] double number(std::size_t from, std::size_t count) const {
    const auto value = parse_number(columns(from, count));
    if (!value || !std::isfinite(*value))
      fail(fmt::format("\"{}\": a finite number is expected", columns(from, count)));
    return *value;
  }
  [[nodiscard]] std::int64_t integer(std::size_t from, std::size_t count) const {
    const std::string_view text = columns(from, count);
    std::int64_t value = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc() || end != text.data() + text.size())
      fail(fmt::format("\"{}\": an integer is expected", text));
    return value;
  }

 private:
  static std::string text_of(const std::string& path) {
    try {
      return read_text(path);
    } catch (const IoError& error) {
      throw DataError(error.what());
    }
  }

  std::string path_;
  std::istringstream stream_;
  std::string line_;
  std::size_t number_ = 0;
};

constexpr std::size_t k_id = 3, k_id_width = 10, k_values = 13, k_width = 12;  // " -1", I10, 6E12.5

class FrdReader {
 public:
  explicit FrdReader(const std::string& path) : lines_(path) {}

  FrdContents read() {
    while (lines_.next()) {
      const std::string_view key = lines_.columns(0, 6);
      if (key == "2C") read_nodes();
      if (key == "3C") read_cells();
      if (key == "100C" || key == "100CL") read_field();
    }
    if (contents_.ids.empty()) lines_.fail("this is no .frd file of CalculiX: it has no nodes");
    return std::move(contents_);
  }

 private:
  /// The format is the last number of the head of a block: 2 and 3 are binary.
  void require_text() const {
    const std::vector<std::string> words = words_of(lines_.line());
    if (!words.empty() && (words.back() == "2" || words.back() == "3"))
      lines_.fail("binary data: write *NODE FILE and *EL FILE, not *NODE OUTPUT or OUTPUT=BINARY");
  }

  void read_nodes() {
    require_text();
    while (lines_.next() && !lines_.starts_with(" -3")) {
      place_[lines_.integer(k_id, k_id_width)] = contents_.ids.size();
      contents_.ids.push_back(lines_.integer(k_id, k_id_width));
      for (std::size_t k = 0; k < 3; ++k)
        contents_.points.push_back(lines_.number(k_values + k * k_width, k_width));
    }
  }

  void read_cells() {
    require_text();
    while (lines_.next() && !lines_.starts_with(" -3")) {
      if (lines_.starts_with(" -1")) {
        contents_.cells.push_back({static_cast<int>(lines_.integer(13, 5)), {}});
        continue;
      }
      if (contents_.cells.empty()) lines_.fail("nodes before the first element");
      for (std::size_t at = 3; !lines_.columns(at, 10).empty(); at += 10) {
        const auto node = place_.find(lines_.integer(at, 10));
        if (node == place_.end()) lines_.fail("an element with a node that there is not");
        contents_.cells.back().nodes.push_back(node->second);
      }
    }
  }

  void read_field() {
    require_text();
    FrdField field;
    field.time = lines_.number(12, 12);
    while (lines_.next() && !lines_.starts_with(" -1") && !lines_.starts_with(" -3")) {
      if (lines_.starts_with(" -4")) field.name = lines_.columns(5, 8);
      // A component that is made of the others ("ALL") is announced with a last number of 1.
      if (!lines_.starts_with(" -5")) continue;
      const std::vector<std::string> words = words_of(lines_.line());
      if (words.size() > 1 && words[1] != "ALL") field.components.push_back(words[1]);
    }
    const std::size_t k = field.components.size();
    field.values.assign(contents_.ids.size() * k, 0.0);
    std::size_t node = 0, filled = 0;
    for (bool more = true; more && !lines_.starts_with(" -3"); more = lines_.next()) {
      if (lines_.starts_with(" -1")) {
        const auto found = place_.find(lines_.integer(k_id, k_id_width));
        if (found == place_.end()) lines_.fail("a value of a node that there is not");
        node = found->second;
        filled = 0;
      }
      for (std::size_t column = 0; column < 6 && filled < k; ++column, ++filled)
        field.values[node * k + filled] = lines_.number(k_values + column * k_width, k_width);
    }
    contents_.fields.push_back(std::move(field));
  }

  Lines lines_;
  FrdContents contents_;
  std::map<std::int64_t, std::size_t> place_;
};

/// "displacements (vx,vy,vz) for set TIP and time  0.1000000E+01".
struct TableHead {
  std::vector<std::string> labels;
  std::string set;
  double time = 0;
};

bool read_head(const std::string& line, TableHead& head) {
  const std::size_t open = line.find('('), close = line.find(')'), set = line.find(" for set "),
                    time = line.find(" and time ");
  if (open == std::string::npos || close < open || set < close || time < set || time == std::string::npos)
    return false;
  head.labels.clear();
  std::istringstream labels(line.substr(open + 1, close - open - 1));
  for (std::string label; std::getline(labels, label, ',');) head.labels.emplace_back(trimmed(label));
  head.set = trimmed(std::string_view(line).substr(set + 9, time - set - 9));
  const auto value = parse_number(trimmed(std::string_view(line).substr(time + 10)));
  if (value) head.time = *value;
  return value.has_value();
}

/// A row's name: what the table says of it beside numbers.
std::string row_name(const TableHead& head, const std::vector<std::string>& words, std::size_t& ids,
                     std::vector<std::string>& labels) {
  labels = head.labels;
  // Elements name their ids among the labels (elem, integ.pnt.); nodes do not.
  ids = words.size() > labels.size() ? words.size() - labels.size() : 0;
  while (!labels.empty() && (labels.front() == "elem" || labels.front().starts_with("integ"))) {
    labels.erase(labels.begin());
    ++ids;
  }
  std::string name = head.set;
  for (std::size_t i = 0; i < ids; ++i) name += "." + words[i];
  return name;
}

}  // namespace

FrdContents read_frd(const std::string& path) {
  return FrdReader(path).read();
}

DatContents read_dat(const std::string& path) {
  Lines lines(path);
  DatContents contents;
  std::map<std::string, std::size_t> place;
  TableHead head;
  bool in_table = false;
  while (lines.next()) {
    if (read_head(lines.line(), head)) {
      in_table = true;
      if (contents.time.empty() || head.time > contents.time.back()) contents.time.push_back(head.time);
      continue;
    }
    const std::vector<std::string> words = words_of(lines.line());
    if (!in_table || words.empty()) continue;
    std::size_t ids = 0;
    std::vector<std::string> labels;
    const std::string row = row_name(head, words, ids, labels);
    if (words.size() != ids + labels.size() || !parse_number(words.back())) {
      in_table = false;  // another kind of line
      continue;
    }
    for (Index k = 0; k < std::ssize(labels); ++k) {
      const auto value = parse_number(words[ids + k]);
      if (!value || !std::isfinite(*value))
        lines.fail(fmt::format("\"{}\": a finite number is expected", words[ids + k]));
      const auto [it, is_new] = place.try_emplace(row + "." + labels[k], contents.series.size());
      if (is_new) contents.series.push_back({it->first, {}});
      contents.series[it->second].values.push_back(*value);
    }
  }
  if (contents.series.empty())
    throw DataError(path + ": no table of *NODE PRINT or *EL PRINT: there is nothing to read");
  for (const DatSeries& series : contents.series)
    if (series.values.size() != contents.time.size())
      throw DataError(fmt::format("{}: {} is printed {} times, others {}: print all at the same times", path,
                                  series.name, series.values.size(), contents.time.size()));
  return contents;
}

}  // namespace knothe::files
