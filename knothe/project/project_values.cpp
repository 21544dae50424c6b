#include "knothe/project/project_values.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <sstream>
#include <utility>

#include "knothe/base/text.hpp"
#include "knothe/project/option_table.hpp"

#define TOML_HEADER_ONLY 0
#define TOML_SHARED_LIB 1
#include <toml++/toml.h>

namespace knothe::project {
namespace {

std::string join(const std::string& parent, const std::string& key) {
  return parent.empty() ? key : parent + "." + key;
}

/// Whether `pattern` ("parameters.*.mean") stands for `path` ("parameters.Y0.mean").
bool matches(std::string_view pattern, std::string_view path) {
  while (!pattern.empty() && !path.empty()) {
    const auto a = pattern.substr(0, pattern.find('.')), b = path.substr(0, path.find('.'));
    if (a != "*" && a != b) return false;
    pattern.remove_prefix(std::min(pattern.size(), a.size() + 1));
    path.remove_prefix(std::min(path.size(), b.size() + 1));
  }
  return pattern.empty() && path.empty();
}

/// Whether the option is a value of any name ("simulate.noise.*"): a name may have dots ("TIP.81.vy").
bool is_named_value(const Option& option, const std::string& path) {
  const std::string_view pattern = option.path;
  return option.kind != ValueKind::table && option.kind != ValueKind::free_table && pattern.ends_with(".*") &&
         path.starts_with(pattern.substr(0, pattern.size() - 1));
}

const Option* find_option(const std::string& path) {
  for (const Option& option : option_table()) {
    if (matches(option.path, path) || is_named_value(option, path)) return &option;
  }
  return nullptr;
}

/// The keys that the table `path` may have.
std::vector<std::string> known_keys(const std::string& path) {
  std::vector<std::string> keys;
  for (const Option& option : option_table()) {
    const auto dot = option.path.rfind('.');
    const std::string parent = dot == std::string::npos ? "" : option.path.substr(0, dot);
    if (path.empty() ? parent.empty() : (!parent.empty() && matches(parent, path))) {
      keys.push_back(dot == std::string::npos ? option.path : option.path.substr(dot + 1));
    }
  }
  return keys;
}

class Reader {
 public:
  explicit Reader(Values& out) : out_(out) {}

  void read_table(const toml::table& table, const std::string& path) {
    const auto& begin = table.source().begin;
    const int line = begin.line, column = begin.column;
    out_.tables[path] = {line, column};
    // toml++ sorts keys by name; the order of a project file is a promise, so it is taken from the positions.
    std::vector<std::pair<const toml::key*, const toml::node*>> items;
    for (const auto& [key, node] : table) items.emplace_back(&key, &node);
    std::sort(items.begin(), items.end(), [](const auto& a, const auto& b) {
      const auto& p = a.first->source().begin;
      const auto& q = b.first->source().begin;
      return p.line != q.line ? p.line < q.line : p.column < q.column;
    });
    for (const auto& [key, node] : items) {
      const std::string name(key->str());
      const std::string here = join(path, name);
      const Option* option = find_option(here);
      const auto& position = key->source().begin;
      if (!option) {
        const auto keys = known_keys(path);
        complain(position, fmt::format("unknown {} \"{}\"{}{}", node->is_table() ? "table" : "key", name,
                                       path.empty() ? "" : " in [" + path + "]", did_you_mean(name, keys)));
        continue;
      }
      out_.children[path].push_back(name);
      read_value(*option, here, *node, position);
    }
    check_required(path, begin);
  }

 private:
  void complain(const toml::source_position& where, const std::string& text) {
    const int line = where.line, column = where.column;
    out_.complaints.push_back({line, column, text});
  }

  void check_required(const std::string& path, const toml::source_position& begin) {
    if (path.empty()) return;
    for (const Option& option : option_table()) {
      const auto dot = option.path.rfind('.');
      if (!option.required || !matches(option.path.substr(0, dot), path)) continue;
      const std::string key = option.path.substr(dot + 1);
      const auto there = out_.children.find(path);  // what is there but wrong has its own complaint
      if (there == out_.children.end() ||
          std::find(there->second.begin(), there->second.end(), key) == there->second.end()) {
        complain(begin, fmt::format("[{}] lacks \"{}\": {}", path, key, option.meaning));
      }
    }
  }

  void read_value(const Option& option, const std::string& path, const toml::node& node,
                  const toml::source_position& where) {
    switch (option.kind) {
      case ValueKind::table:
        return read_subtable(option, path, node, where);
      case ValueKind::free_table:
        return read_free_table(option, path, node, where);
      case ValueKind::text:
      case ValueKind::path:
      case ValueKind::choice:
        return read_text(option, path, node, where);
      case ValueKind::integer:
        if (const auto* i = node.as_integer(); i && i->get() >= 0)
          return store(path, std::int64_t(i->get()), where);
        break;
      case ValueKind::numbers:
        return read_numbers(option, path, node, where);
      case ValueKind::texts:
        if (const auto texts = list<std::string>(node, [](const auto& n) { return exact_text(n); }))
          return store(path, *texts, where);
        break;
      case ValueKind::matrix:
        if (const auto rows =
                list<std::vector<double>>(node, [](const auto& n) { return list<double>(n, finite); });
            rows && !rows->empty())
          return store(path, *rows, where);
        break;
      default: {
        const auto v = node.is_number() ? finite(node) : std::nullopt;
        if (!v || (option.kind == ValueKind::positive && !(*v > 0)) ||
            (option.kind == ValueKind::non_negative && *v < 0))
          break;
        return store(path, *v, where);
      }
    }
    wrong(option, path, node, where);
  }

  static std::optional<double> finite(const toml::node& node) {
    const auto v = node.value<double>();
    return v && std::isfinite(*v) ? v : std::nullopt;
  }

  static std::optional<std::string> exact_text(const toml::node& node) {
    const auto* text = node.as_string();
    return text ? std::optional(text->get()) : std::nullopt;
  }

  /// The items of an array; nothing where `read` finds nothing in one of them.
  template <class T, class Read>
  static std::optional<std::vector<T>> list(const toml::node& node, Read read) {
    const auto* array = node.as_array();
    if (array == nullptr) return std::nullopt;
    std::vector<T> items;
    for (const auto& entry : *array) {
      std::optional<T> item = read(entry);
      if (!item) return std::nullopt;
      items.push_back(std::move(*item));
    }
    return items;
  }

  /// The short form of [model] and [data] is a path.
  void read_subtable(const Option& option, const std::string& path, const toml::node& node,
                     const toml::source_position& where) {
    const std::string leaf = path == "model" ? "model.separated" : path == "data" ? "data.file" : "";
    if (const auto* table = node.as_table())
      read_table(*table, path);
    else if (!leaf.empty() && node.is_string())
      store(leaf, *exact_text(node), where);
    else
      wrong(option, path, node, where);
  }

  void read_numbers(const Option& option, const std::string& path, const toml::node& node,
                    const toml::source_position& where) {
    if (const auto numbers = list<double>(node, finite)) return store(path, *numbers, where);
    const auto* array = node.as_array();
    for (std::size_t i = 0; array != nullptr && i < array->size(); ++i) {
      const toml::node& item = (*array)[i];
      if (!finite(item))
        return complain(item.source().begin,
                        fmt::format("\"{}\"[{}] must be a finite number, not {}", path, i, words_for(item)));
    }
    wrong(option, path, node, where);
  }

  void read_text(const Option& option, const std::string& path, const toml::node& node,
                 const toml::source_position& where) {
    const auto* text = node.as_string();
    if (!text || text->get().empty()) return wrong(option, path, node, where);
    if (option.kind == ValueKind::choice &&
        std::find(option.choices.begin(), option.choices.end(), text->get()) == option.choices.end()) {
      complain(node.source().begin, fmt::format("\"{}\" must be one of {}, not \"{}\"{}", path,
                                                fmt::format("\"{}\"", fmt::join(option.choices, "\", \"")),
                                                text->get(), did_you_mean(text->get(), option.choices)));
      return;
    }
    store(path, text->get(), where);
  }

  /// The first number that is not finite; null if there is none.
  static const toml::node* first_without_json(const toml::node& node) {
    const toml::node* found = nullptr;
    if (const auto* number = node.as_floating_point(); number && !std::isfinite(number->get())) return &node;
    if (const auto* table = node.as_table())
      for (const auto& [key, item] : *table)
        if (found == nullptr) found = first_without_json(item);
    if (const auto* array = node.as_array())
      for (const auto& item : *array)
        if (found == nullptr) found = first_without_json(item);
    return found;
  }

  /// Any table, kept as JSON; it counts as a leaf.
  void read_free_table(const Option& option, const std::string& path, const toml::node& node,
                       const toml::source_position& where) {
    const auto* table = node.as_table();
    if (table == nullptr) return wrong(option, path, node, where);
    if (const toml::node* number = first_without_json(node))
      return complain(
          number->source().begin,
          fmt::format("\"{}\": JSON, which servers read, has no word for {}", path, words_for(*number)));
    std::ostringstream text;
    text << toml::json_formatter(*table);
    store(path, text.str(), where);
  }

  /// What was found in place of a value.
  static std::string words_for(const toml::node& node) {
    if (const auto* text = node.as_string()) return fmt::format("\"{}\"", text->get());
    if (const auto* integer = node.as_integer()) return fmt::format("{}", integer->get());
    if (const auto* number = node.as_floating_point()) return fmt::format("{}", number->get());
    if (const auto* flag = node.as_boolean()) return fmt::format("{}", flag->get());
    return node.is_table() ? "a table" : node.is_array() ? "an array" : "a date or time";
  }

  void wrong(const Option& option, const std::string& path, const toml::node& node,
             const toml::source_position& where) {
    const auto& position = node.source().begin.line > 0 ? node.source().begin : where;
    const std::string kind = describe(option.kind);
    const char* article = kind.starts_with('a') || kind.starts_with('i') ? "an" : "a";
    complain(position, fmt::format("\"{}\" must be {} {}, not {}", path, article, kind, words_for(node)));
  }

  template <class T>
  void store(const std::string& path, T content, const toml::source_position& where) {
    const int line = where.line, column = where.column;
    out_.leaves[path] = {std::move(content), line, column};
  }

  Values& out_;
};

}  // namespace

std::vector<std::string> Values::children_of(const std::string& table) const {
  const auto it = children.find(table);
  return it == children.end() ? std::vector<std::string>() : it->second;
}

std::string Values::resolved(const std::string& file) const {
  return file.empty() ? file : (std::filesystem::path(folder) / file).lexically_normal().string();
}

bool Values::passes(const Option& option, const std::string& path) {
  const Content& content = leaves.at(path).content;
  const auto* whole = std::get_if<std::int64_t>(&content);
  const auto* number = std::get_if<double>(&content);
  if (!whole && !number) return true;
  for (const Option::Check& check : option.checks) {
    if (check.holds(whole ? *whole : *number)) continue;
    complain(path, fmt::format(fmt::runtime(check.complaint), path));
    return false;
  }
  return true;
}

void Values::complain_of_shape(const Option& option, const std::string& path) {
  complain(path, fmt::format("\"{}\" must be {}", path, option.shape.empty() ? "smaller" : option.shape));
}

void Values::complain(const std::string& path, const std::string& text) {
  for (std::string p = path;; p.erase(p.rfind('.'))) {
    if (const auto it = leaves.find(p); it != leaves.end()) {
      complaints.push_back({it->second.line, it->second.column, text});
      return;
    }
    if (const auto it = tables.find(p); it != tables.end()) {
      complaints.push_back({it->second.first, it->second.second, text});
      return;
    }
    if (p.find('.') == std::string::npos) break;
  }
  complaints.push_back({1, 1, text});
}

Values parse_values(const std::string& text, const std::string& folder) {
  Values values;
  values.folder = folder;
  try {
    const toml::table table = toml::parse(text);
    Reader(values).read_table(table, "");
  } catch (const toml::parse_error& error) {
    const int line = error.source().begin.line, column = error.source().begin.column;
    std::string complaint = fmt::format("not valid TOML: {}", error.description());
    for (const auto& [table, key] : {std::pair("data", "file"), std::pair("model", "separated")})
      if (complaint.find(fmt::format("redefine existing string '{}", table)) != std::string::npos)
        complaint +=
            fmt::format(": beside [{0}.…] write `{0} = \"FILE\"` as [{0}] and `{1} = \"FILE\"`", table, key);
    values.complaints.push_back({line, column, complaint});
  }
  return values;
}

}  // namespace knothe::project
