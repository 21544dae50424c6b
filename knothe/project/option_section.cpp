#include "knothe/project/option_section.hpp"

#include <fmt/format.h>

#include <charconv>

namespace knothe::project {

void file(Option& o) {
  if (o.kind == ValueKind::text) o.kind = ValueKind::path;
  o.is_file = true;
}

void free_table(Option& o) {
  o.kind = ValueKind::free_table, o.default_value = "{}";
}

Rule check(std::function<bool(double)> holds, std::string complaint) {
  return [=](Option& o) { o.checks.push_back({holds, complaint}); };
}

Rule at_least(double least) {
  return check([=](double v) { return v >= least; }, fmt::format("\"{{}}\" must be at least {}", least));
}

Rule at_most(double most, const std::string& why) {
  return check([=](double v) { return v <= most; }, fmt::format("\"{{}}\" must be at most {}{}", most, why));
}

Rule between(double least, double most) {
  return check([=](double v) { return v >= least && v <= most; },
               fmt::format("\"{{}}\" must be from {} to {}", least, most));
}

Rule of_shape(std::string what) {
  return [=](Option& o) { o.shape = what; };
}

std::string as_written(double value) {
  std::array<char, 32> text{};
  const std::string number(text.data(), std::to_chars(text.data(), text.data() + text.size(), value).ptr);
  const auto e = number.find('e');  // 1e-06, 3e+10
  if (e == std::string::npos) return number;
  return fmt::format("{}e{}", number.substr(0, e), std::stoi(number.substr(e + 1)));
}

std::string as_written(const std::string& value) {
  return value.empty() ? value : "\"" + value + "\"";
}

std::string as_written_list(const std::vector<std::string>& items) {
  return items.empty() ? std::string() : fmt::format("[{}]", fmt::join(items, ", "));
}

}  // namespace knothe::project
