#pragma once
/// @file SHA-256 (FIPS 180-4): identity of models, seals of model files and of the journal's records.
#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>

struct evp_md_ctx_st;  // of OpenSSL

namespace knothe {

using Digest = std::array<std::uint8_t, 32>;

/// The hash of everything added so far.
class Sha256 {
 public:
  Sha256();
  void add(std::span<const std::uint8_t> bytes);
  void add(std::string_view text);
  /// The bytes of a number as it is in memory (little endian on every machine that we build for).
  template <class Number>
  requires std::is_arithmetic_v<Number>
  void add_number(Number number) {
    std::array<std::uint8_t, sizeof(Number)> bytes;
    __builtin_memcpy(bytes.data(), &number, sizeof(Number));
    add(bytes);
  }
  /// A text with its length before it: no two lists of texts look alike.
  void add_text(std::string_view text) {
    add_number(text.size());
    add(text);
  }
  /// Ends the sum; add nothing afterwards.
  [[nodiscard]] Digest finish();

 private:
  struct FreeContext {
    void operator()(evp_md_ctx_st* context) const;
  };
  std::unique_ptr<evp_md_ctx_st, FreeContext> context_;
};

[[nodiscard]] std::string to_hex(const Digest& digest);
[[nodiscard]] Digest sha256_of(std::string_view text);
/// Of a file's bytes. DataError where it cannot be read.
[[nodiscard]] Digest sha256_of_file(const std::string& path);

}  // namespace knothe
