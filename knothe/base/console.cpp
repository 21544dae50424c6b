#include "knothe/base/console.hpp"

#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <string_view>

namespace knothe {
namespace {

bool is_terminal(std::FILE* stream) {
  return isatty(fileno(stream)) == 1;
}

bool begins_character(char byte) {
  return (byte & '\xC0') != '\x80';  // UTF-8
}

std::size_t characters(std::string_view text) {
  std::size_t count = 0;
  for (const char byte : text) count += begins_character(byte) ? 1 : 0;
  return count;
}

void wrap_line(const std::string& line, std::size_t width, std::size_t indent, std::string& out) {
  const std::size_t first = line.find_first_not_of(' ');
  if (first == std::string::npos) return;
  const std::string margin(first + indent, ' ');
  std::size_t column = 0;
  for (std::size_t begin = 0; begin < line.size();) {
    const std::size_t word = std::min(line.find_first_not_of(' ', begin), line.size());
    const std::size_t end = std::min(line.find(' ', word), line.size());
    const std::size_t blanks = word - begin,
                      length = characters(std::string_view(line).substr(word, end - word));
    const bool breaks = begin > 0 && column > margin.size() && column + blanks + length > width;
    out += breaks ? "\n" + margin : std::string(blanks, ' ');
    out += line.substr(word, end - word);
    column = (breaks ? margin.size() : column + blanks) + length;
    begin = end;
  }
}

}  // namespace

std::string coloured(const std::string& text, Colour colour, std::FILE* stream) {
  const char* const no_colour = std::getenv("NO_COLOR");
  const char* const terminal = std::getenv("TERM");
  const bool is_plain = (no_colour != nullptr && *no_colour != '\0') ||
                        (terminal != nullptr && std::string_view(terminal) == "dumb");
  if (is_plain || !is_terminal(stream)) return text;
  static constexpr const char* codes[] = {"1;31", "1;32", "1;33", "90"};
  return std::string("\033[") + codes[static_cast<int>(colour)] + "m" + text + "\033[0m";
}

std::string wrapped(const std::string& text, std::size_t width, std::size_t indent) {
  std::string out;
  for (std::size_t begin = 0, end = 0; end != std::string::npos; begin = end + 1) {
    end = text.find('\n', begin);
    const std::string line = text.substr(begin, end - begin);
    if (begin > 0) out += "\n";
    if (characters(line) <= width)
      out += line;
    else
      wrap_line(line, width, indent, out);
  }
  return out;
}

std::string for_people(const std::string& text, std::FILE* stream, std::size_t indent) {
  return is_terminal(stream) ? wrapped(text, k_line_width, indent) : text;
}

std::string cut_to_terminal(const std::string& text, std::FILE* stream) {
  winsize size{};
  const bool is_known = ioctl(fileno(stream), TIOCGWINSZ, &size) == 0 && size.ws_col > 1;
  const std::size_t most = (is_known ? size.ws_col : 80) - 1;
  std::size_t count = 0;
  for (std::size_t i = 0; i < text.size(); ++i)
    if (begins_character(text[i]) && ++count > most) return text.substr(0, i);
  return text;
}

}  // namespace knothe
