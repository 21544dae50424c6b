#pragma once
/// @file The options of one struct: each entry binds path, member, meaning and rules, so that reading,
/// checking and the printed default come from it alone. Private to this room.
#include <array>
#include <concepts>
#include <functional>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "knothe/base/enum_names.hpp"
#include "knothe/project/option_table.hpp"
#include "knothe/project/project_values.hpp"

namespace knothe::project {

// Rules of an entry.
inline void positive(Option& o) {
  o.kind = ValueKind::positive;
}
inline void non_negative(Option& o) {
  o.kind = ValueKind::non_negative;
}
/// Where the option is needed at all, its reader asks for it.
inline void no_default(Option& o) {
  o.default_value.clear();
}
inline void required(Option& o) {
  o.required = true, no_default(o);
}
/// A path, or a list of them, relative to the project file.
void file(Option& o);
/// Any table, kept as JSON.
void free_table(Option& o);
using Rule = std::function<void(Option&)>;
[[nodiscard]] Rule check(std::function<bool(double)> holds, std::string complaint);
[[nodiscard]] Rule at_least(double least);
[[nodiscard]] Rule at_most(double most, const std::string& why = "");
[[nodiscard]] Rule between(double least, double most);
[[nodiscard]] Rule of_shape(std::string what);

/// Words of the components of a displacement or a place.
inline constexpr auto k_components = std::to_array<Named<int>>({{0, "x"}, {1, "y"}, {2, "z"}});

inline constexpr const char* k_component_words = "a list of components, each \"x\", \"y\" or \"z\"";

/// An empty one of what the file has for a T: a number, a text, or a list of such. A std::vector<int> is one
/// of components.
template <class T>
auto leaf_of(const T& value) {
  if constexpr (requires { value.value(); }) {
    return leaf_of(*value);
  } else if constexpr (std::integral<T>) {
    return std::int64_t{};
  } else if constexpr (std::is_same_v<T, double> || std::is_same_v<T, std::string>) {
    return T{};
  } else if constexpr (std::is_same_v<T, std::vector<int>>) {
    return std::vector<std::string>{};
  } else if constexpr (std::is_same_v<T, std::vector<std::size_t>>) {
    return std::vector<double>{};
  } else {
    return std::vector<decltype(leaf_of(value[0]))>{};
  }
}

/// Puts what the file has in place of `to`, if it is of its shape and in its range.
template <class From, class To>
bool convert(const From& from, To& to) {
  if constexpr (std::is_same_v<From, To>) {
    to = from;
  } else if constexpr (requires { to.value(); }) {
    return convert(from, to.emplace());
  } else if constexpr (std::is_same_v<From, std::string>) {
    to = from.size() == 1 ? from[0] - 'x' : -1;
    return to >= 0 && to <= 2;
  } else if constexpr (std::integral<To>) {
    if (!(from >= 0 && from <= static_cast<From>(std::numeric_limits<To>::max() / 2))) return false;
    to = static_cast<To>(from);
    return static_cast<From>(to) == from;
  } else {
    if constexpr (requires { to.resize(0); }) to.resize(from.size());
    bool fits = to.size() == from.size();
    for (std::size_t i = 0; fits && i < from.size(); ++i) fits = convert(from[i], to[i]);
    return fits;
  }
  return true;
}

/// As it would be written in the file; empty: there is nothing.
[[nodiscard]] std::string as_written(double value);
[[nodiscard]] std::string as_written(const std::string& value);
[[nodiscard]] std::string as_written_list(const std::vector<std::string>& items);
template <class T>
[[nodiscard]] std::string as_written(const T& value) {
  if constexpr (std::integral<T>) {
    return std::to_string(value);
  } else if constexpr (requires { value.value(); }) {
    return value ? as_written(*value) : std::string();
  } else {
    std::vector<std::string> items;
    for (const auto& item : value) {
      if constexpr (std::is_same_v<T, std::vector<int>>)
        items.push_back(as_written(std::string(k_components.at(item).word)));
      else
        items.push_back(as_written(item));
    }
    return as_written_list(items);
  }
}

/// A member of a member: `in(&A::b, &B::c)`.
template <class... Members>
[[nodiscard]] auto in(Members... members) {
  return [=](auto& s) -> auto& {
    return (s.*....*members);
  };
}

/// The options that fill an S. A member is a pointer to one, or a function that returns what is deeper in an
/// S.
template <class S>
class Section {
 public:
  /// `path` of its table ("method", "forecast.*"; empty: the file's top); with a meaning the table is an
  /// option too.
  explicit Section(std::string path, std::string meaning = "") : path_(std::move(path)) {
    if (!meaning.empty()) table("", std::move(meaning));
  }
  /// The same, with its options written down by `fill`.
  template <class Fill>
  Section(std::string path, std::string meaning, Fill fill) : Section(std::move(path), std::move(meaning)) {
    fill(*this);
  }

  /// A table in it; its members follow as "key.member", or "key.*" for values by name (a map).
  template <class... Rules>
  void table(const std::string& key, std::string meaning, Rules... rules) {
    append(key, ValueKind::table, std::move(meaning), {});
    (rules(options_.back()), ...);
  }

  template <class Member, class... Rules>
  void add(const std::string& key, Member member, std::string meaning, Rules... rules) {
    using T = std::remove_cvref_t<std::invoke_result_t<Member, S&>>;
    if constexpr (NamedEnum<T>) {
      return choice(key, member, names_of(T{}), std::move(meaning), rules...);
    } else if constexpr (requires { typename T::mapped_type; }) {
      append(key, kind_of(leaf_of(typename T::mapped_type{})), std::move(meaning),
             [member, table = path_ + (path_.empty() ? "" : ".") + key.substr(0, key.size() - 2)](
                 Values& values, const Option& option, const std::string&, S& s) {
               for (const std::string& name : values.children_of(table))
                 read_value(values, option, table + "." + name, std::invoke(member, s)[name]);
             });
    } else {
      const T& value = std::invoke(member, defaults_);
      append(key, kind_of(leaf_of(value)), std::move(meaning),
             [member](Values& values, const Option& option, const std::string& path, S& s) {
               read_value(values, option, path, std::invoke(member, s));
             });
      options_.back().default_value = as_written(value);
    }
    (rules(options_.back()), ...);
  }

  /// One of the words for values of T.
  template <class Member, class T, std::size_t n, class... Rules>
  void choice(const std::string& key, Member member, const std::array<Named<T>, n>& names,
              std::string meaning, Rules... rules) {
    append(key, ValueKind::choice, std::move(meaning),
           [member, names](Values& values, const Option&, const std::string& path, S& s) {
             for (const Named<T>& name : names)
               if (values.has(path) && values.get<std::string>(path) == name.word)
                 std::invoke(member, s) = name.value;
           });
    Option& option = options_.back();
    for (const Named<T>& name : names) {
      option.choices.emplace_back(name.word);
      if (std::invoke(member, defaults_) == name.value)
        option.default_value = as_written(option.choices.back());
    }
    (rules(option), ...);
  }
  /// For a bool: the words for false and true.
  template <class Member>
  void choice(const std::string& key, Member member, const char* no, const char* yes, std::string meaning) {
    choice(key, member, std::array<Named<bool>, 2>{{{false, no}, {true, yes}}}, std::move(meaning));
  }

  /// An S with what the file says; `name` is that of the user, where the path has a `*`.
  [[nodiscard]] S read(Values& values, const std::string& name = "") const {
    S s = defaults_;
    for (std::size_t i = 0; i < options_.size(); ++i) {
      std::string path = options_[i].path;
      if (!name.empty()) path.replace(path.find('*'), 1, name);
      if (readers_[i]) readers_[i](values, options_[i], path, s);
    }
    return s;
  }

  [[nodiscard]] const std::vector<Option>& options() const { return options_; }

 private:
  using Reader = std::function<void(Values&, const Option&, const std::string& path, S&)>;

  template <class T>
  static void read_value(Values& values, const Option& option, const std::string& path, T& value) {
    using Leaf = decltype(leaf_of(value));
    if (values.has(path)) {
      T given{};
      if (!convert(values.get<Leaf>(path), given)) return values.complain_of_shape(option, path);
      if (!values.passes(option, path)) return;
      value = std::move(given);
    }
    if constexpr (std::is_same_v<T, std::string>) {
      if (option.is_file) value = values.resolved(value);
    } else if constexpr (std::is_same_v<T, std::vector<std::string>>) {
      for (std::string& path_in_list : value)
        if (option.is_file) path_in_list = values.resolved(path_in_list);
    }
  }

  void append(const std::string& key, ValueKind kind, std::string meaning, Reader reader) {
    const std::string dot = path_.empty() || key.empty() ? "" : ".";
    options_.push_back({path_ + dot + key, kind, std::move(meaning), {}, {}, false, false, {}, {}});
    readers_.push_back(std::move(reader));
  }

  std::string path_;
  S defaults_{};
  std::vector<Option> options_;
  std::vector<Reader> readers_;  ///< of each option; none for a table
};

/// The options of several sections, one after the other.
template <class... S>
[[nodiscard]] std::vector<Option> joined(const Section<S>&... sections) {
  std::vector<Option> all;
  (all.insert(all.end(), sections.options().begin(), sections.options().end()), ...);
  return all;
}

}  // namespace knothe::project
