#pragma once
/// @file Who may ask for what.
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "knothe/project/project_file.hpp"
#include "knothe/service/net/http_request.hpp"

namespace knothe::service {

/// Bearer tokens: one that all readers share, one that all who send data share, and those of people and
/// machines with names.
class Tokens {
 public:
  Tokens() = default;  ///< none: everybody may do everything
  /// Of the files that `[serve]` names. ProjectError for one that is missing, or has a token that is too
  /// short to be a secret, and for a file of names that everybody on this machine may read.
  explicit Tokens(const project::Project& project);

  /// Whether a token is needed: to read, or to send data and to act (`acts`).
  [[nodiscard]] bool needed(bool acts) const;
  /// Whose token came with the request, if it is one that suffices: empty for a shared one.
  [[nodiscard]] std::optional<std::string> holder(const HttpRequest& request, bool acts) const;

 private:
  struct Named {
    std::string name, token;
    bool acts = true;
  };
  std::string read_, ingest_;
  std::vector<Named> named_;
};

/// Whether two texts are equal, in a time that depends on their lengths alone.
[[nodiscard]] bool equal_in_constant_time(std::string_view a, std::string_view b);

}  // namespace knothe::service
