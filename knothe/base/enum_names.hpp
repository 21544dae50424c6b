#pragma once
/// @file Words for the values of an enumeration: one list of them, by which they are read, printed and named
/// in messages.
#include <concepts>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

namespace knothe {

/// A value and the word for it in files and on the command line.
template <class T>
struct Named {
  T value;
  const char* word;
};

/// An enumeration beside which its list stands:
/// `constexpr auto names_of(E) { return std::to_array<Named<E>>({{E::first, "first"}, …}); }`.
template <class E>
concept NamedEnum = std::is_enum_v<E> && requires(E value) {
  { names_of(value)[0].value } -> std::convertible_to<E>;
};

template <NamedEnum E>
[[nodiscard]] std::string to_text(E value) {
  for (const Named<E>& name : names_of(value))
    if (name.value == value) return name.word;
  return {};
}

/// The value for a word; nothing if there is none.
template <NamedEnum E>
[[nodiscard]] std::optional<E> from_text(std::string_view word) {
  for (const Named<E>& name : names_of(E{}))
    if (name.word == word) return name.value;
  return std::nullopt;
}

/// All the words, in the order of the list.
template <NamedEnum E>
[[nodiscard]] std::vector<std::string> words_of() {
  std::vector<std::string> words;
  for (const Named<E>& name : names_of(E{})) words.emplace_back(name.word);
  return words;
}

}  // namespace knothe
