#include "knothe/service/net/tokens.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>

namespace knothe::service {
namespace {

void require_secret(const project::Project& project, const std::string& key, const std::string& path,
                    const std::string& token) {
  const auto is_printable = [](char c) { return c >= ' ' && c < '\x7f'; };
  if (token.starts_with(' ') || !std::all_of(token.begin(), token.end(), is_printable))
    throw project.error_at(
        key,
        fmt::format("the token in {} begins with a blank, or has characters that are not printable ASCII "
                    "(UTF-16, a byte-order mark?): no client can send it",
                    path));
  if (token.size() < 16)
    throw project.error_at(
        key,
        fmt::format("the token in {} has fewer than 16 characters; `openssl rand -hex 32` makes one", path));
}

/// The first line of the file; empty where there is none.
std::string read_token(const project::Project& project, const std::string& key, const std::string& path) {
  if (path.empty()) return "";
  std::ifstream file(path);
  std::string token;
  if (!file || !std::getline(file, token))
    throw project.error_at(key, fmt::format("the token file {} cannot be read, or is empty", path));
  while (!token.empty() && (token.back() == '\r' || token.back() == ' ')) token.pop_back();
  require_secret(project, key, path, token);
  return token;
}

bool is_read_by_all(const std::string& path) {
  using std::filesystem::perms;
  std::error_code ignored;
  const perms found = std::filesystem::status(path, ignored).permissions();
  return (found & (perms::others_read | perms::others_write)) != perms::none;
}

}  // namespace

Tokens::Tokens(const project::Project& project)
    : read_(read_token(project, "serve.read_token", project.serve.read_token)),
      ingest_(read_token(project, "serve.ingest_token", project.serve.ingest_token)) {
  const std::string key = "serve.tokens", &path = project.serve.tokens;
  if (path.empty()) return;
  std::ifstream file(path);
  if (!file) throw project.error_at(key, fmt::format("the file {} cannot be read", path));
  if (is_read_by_all(path))
    throw project.error_at(key, fmt::format("{0} can be read by everybody here: chmod o= {0}", path));
  std::set<std::string> names, secrets = {read_, ingest_};
  int number = 0;
  for (std::string line; std::getline(file, line);) {
    ++number;
    std::istringstream words(line);
    Named named;
    std::string right, more;
    if (!(words >> named.name) || named.name.starts_with('#')) continue;
    words >> named.token >> right >> more;
    const auto fault = [&](const std::string& what) {
      return project.error_at(key, fmt::format("{}:{}: {}", path, number, what));
    };
    if (!more.empty() || (!right.empty() && right != "read"))
      throw fault("a line is NAME TOKEN, or NAME TOKEN read for one that may only read");
    require_secret(project, key, fmt::format("{}:{}", path, number), named.token);
    if (named.name.size() > 128) throw fault("a name has at most 128 bytes");
    if (!names.insert(named.name).second) throw fault(fmt::format("{} has a token already", named.name));
    if (!secrets.insert(named.token).second) throw fault("another has this token");
    named.acts = right.empty();
    named_.push_back(std::move(named));
  }
  if (named_.empty()) throw project.error_at(key, fmt::format("{} has no token: a line is NAME TOKEN", path));
}

bool Tokens::needed(bool acts) const {
  return !named_.empty() || !(acts ? ingest_ : read_).empty();
}

std::optional<std::string> Tokens::holder(const HttpRequest& request, bool acts) const {
  constexpr std::string_view k_bearer = "bearer ";
  const std::string header = request.header("authorization");
  std::string scheme = header.substr(0, k_bearer.size());
  for (char& c : scheme) c = c >= 'A' && c <= 'Z' ? c - 'A' + 'a' : c;
  if (scheme != k_bearer) return std::nullopt;
  const std::string_view given = std::string_view(header).substr(k_bearer.size());
  const std::string& shared = acts ? ingest_ : read_;
  std::optional<std::string> found;
  if (!shared.empty() && equal_in_constant_time(given, shared)) found = "";
  for (const Named& named : named_)
    if (equal_in_constant_time(given, named.token) && (named.acts || !acts)) found = named.name;
  return found;
}

bool equal_in_constant_time(std::string_view a, std::string_view b) {
  unsigned difference = a.size() != b.size() ? 1 : 0;
  for (std::size_t i = 0; i < a.size(); ++i)
    difference |=
        static_cast<unsigned char>(a[i]) ^ static_cast<unsigned char>(b.empty() ? 0 : b[i % b.size()]);
  return difference == 0;
}

}  // namespace knothe::service
