#include "knothe/service/net/http_request.hpp"

#include <utility>  // before Asio: GCC 12 in C++20 needs std::exchange there

#include <algorithm>
#include <boost/asio/ip/address.hpp>
#include <cctype>
#include <string>

namespace knothe::service {
namespace {

std::string percent_decoded(std::string_view text) {
  const auto digit = [](char c) {
    return c >= '0' && c <= '9'   ? c - '0'
           : c >= 'a' && c <= 'f' ? c - 'a' + 10
           : c >= 'A' && c <= 'F' ? c - 'A' + 10
                                  : -1;
  };
  std::string out;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] == '%' && i + 2 < text.size() && digit(text[i + 1]) >= 0 && digit(text[i + 2]) >= 0) {
      out += static_cast<char>(16 * digit(text[i + 1]) + digit(text[i + 2]));
      i += 2;
    } else {
      out += text[i] == '+' ? ' ' : text[i];
    }
  }
  return out;
}

/// "?a=b&c=d"; empty: there is none.
void set_query(HttpRequest& request, std::string_view text) {
  std::string_view rest = text.substr(std::min<std::size_t>(text.size(), 1));
  while (!rest.empty()) {
    const auto pair = rest.substr(0, rest.find('&'));
    const auto equals = pair.find('=');
    request.query[percent_decoded(pair.substr(0, equals))] =
        equals == std::string_view::npos ? "" : percent_decoded(pair.substr(equals + 1));
    rest.remove_prefix(std::min(rest.size(), pair.size() + 1));
  }
}

}  // namespace

void set_target(HttpRequest& request, std::string_view target) {
  // As to a proxy: what it names is the host, whatever the header says (RFC 9112, 3.2.2).
  for (const std::string_view scheme : {"http://", "https://"}) {
    const bool is_absolute = target.size() > scheme.size() &&
                             std::equal(scheme.begin(), scheme.end(), target.begin(), [](char a, char b) {
                               return a == std::tolower(static_cast<unsigned char>(b));
                             });
    if (!is_absolute) continue;
    target.remove_prefix(scheme.size());
    const auto end = std::min(target.find_first_of("/?"), target.size());
    request.headers["host"] = std::string(target.substr(0, end));
    target.remove_prefix(end);
    if (!target.starts_with('/')) {
      request.path = "/";
      set_query(request, target);
      return;
    }
    break;
  }
  const auto question = target.find('?');
  request.path = percent_decoded(target.substr(0, question));
  if (question != std::string_view::npos) set_query(request, target.substr(question));
}

std::string HttpRequest::header(const std::string& name) const {
  const auto it = headers.find(name);
  return it == headers.end() ? "" : it->second;
}

std::string HttpRequest::parameter(const std::string& name) const {
  const auto it = query.find(name);
  return it == query.end() ? "" : it->second;
}

bool is_loopback(const std::string& address) {
  boost::system::error_code error;
  const auto parsed = boost::asio::ip::make_address(address, error);
  return !error && parsed.is_loopback();
}

}  // namespace knothe::service
