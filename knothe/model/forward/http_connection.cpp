#include "knothe/model/forward/http_connection.hpp"

#include <fmt/format.h>

#include <utility>  // before Asio: GCC 12 in C++20 needs std::exchange there

#include <boost/asio/connect.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <chrono>
#include <limits>
#include <optional>

#include "knothe/base/cancellation.hpp"
#include "knothe/base/error.hpp"

namespace knothe::model {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = boost::beast::http;
using ErrorCode = boost::system::error_code;
using Clock = std::chrono::steady_clock;

HttpAddress HttpAddress::parse(const std::string& text) {
  const auto wrong = [&](const std::string& why) -> UsageError {
    return UsageError(
        fmt::format("\"{}\" is not the address of a server: {}; it should look like "
                    "\"http://127.0.0.1:4242\"",
                    text, why));
  };
  const std::string scheme = "http://";
  if (text.starts_with("https://"))
    throw wrong("https is not supported; put a local proxy or a tunnel in front of the server");
  if (!text.starts_with(scheme)) throw wrong("it does not begin with http://");
  HttpAddress address;
  const auto slash = text.find('/', scheme.size());
  std::string authority = text.substr(scheme.size(), slash - scheme.size());
  if (slash != std::string::npos) address.base = text.substr(slash);
  while (address.base.ends_with("/")) address.base.pop_back();
  if (authority.starts_with("[")) {  // IPv6
    const auto end = authority.find(']');
    if (end == std::string::npos) throw wrong("a bracket is not closed");
    address.host = authority.substr(1, end - 1);
    authority.erase(0, end + 1);
  } else {
    address.host = authority.substr(0, authority.find(':'));
    authority.erase(0, address.host.size());
  }
  if (address.host.empty()) throw wrong("it names no host");
  if (!authority.empty()) {
    address.port = authority.substr(1);
    const bool digits = authority[0] == ':' && !address.port.empty() && address.port.size() <= 5 &&
                        address.port.find_first_not_of("0123456789") == std::string::npos;
    if (!digits || std::stoi(address.port) < 1 || std::stoi(address.port) > 65535)
      throw wrong("its port is not a number from 1 to 65535");
  }
  address.text = text;
  while (address.text.ends_with("/")) address.text.pop_back();
  return address;
}

/// Everything is done by asynchronous operations, run here one at a time: only those have deadlines.
struct HttpConnection::Implementation {
  HttpAddress address;
  double timeout;
  std::string table;
  asio::io_context context;
  std::optional<beast::tcp_stream> stream;
  beast::flat_buffer buffer;
  Clock::time_point deadline;

  Implementation(HttpAddress a, double t, std::string of)
      : address(std::move(a)), timeout(t), table(std::move(of)) {}

  /// Runs the operation that `start` begins (it gets a handler for its error code) to its end or the
  /// deadline.
  template <class Start>
  ErrorCode run(const Start& start) {
    // Shared with the handler: looking up a host cannot be called off, and may end after we have given up.
    const auto outcome = std::make_shared<std::optional<ErrorCode>>();
    start([outcome](const ErrorCode& error) { *outcome = error; });
    context.restart();
    while (true) {
      context.run_for(std::chrono::milliseconds(100));
      if (*outcome) return **outcome;
      if (!cancellation_requested() && Clock::now() < deadline + std::chrono::seconds(1)) continue;
      if (stream) stream->close();
      context.restart();
      context.run_for(std::chrono::milliseconds(100));
      check_cancellation("a request to " + address.text + " was given up");
      return beast::error::timeout;
    }
  }

  /// `again`: the server has just closed a connection that was used before.
  void connect(bool again) {
    asio::ip::tcp::resolver resolver(context);
    const auto endpoints = std::make_shared<asio::ip::tcp::resolver::results_type>();
    const auto resolved = run([&](auto done) {
      resolver.async_resolve(address.host, address.port, [endpoints, done](ErrorCode error, auto found) {
        *endpoints = std::move(found);
        done(error);
      });
    });
    if (resolved == beast::error::timeout)
      throw DataError(fmt::format("{}: the host was not found within {:g} s", address.text, timeout));
    if (resolved)
      throw DataError(fmt::format("{}: there is no such host: {}", address.text, resolved.message()));
    stream.emplace(context);
    buffer.clear();
    stream->expires_at(deadline);
    const auto connected = run([&](auto done) {
      stream->async_connect(*endpoints, [done](ErrorCode error, const auto&) { done(error); });
    });
    if (!connected) {
      stream->socket().set_option(asio::ip::tcp::no_delay(true));
      return;
    }
    stream.reset();
    throw DataError(
        connected == beast::error::timeout
            ? fmt::format("{}: no connection within {:g} s ({} timeout)", address.text, timeout, table)
        : again
            ? fmt::format("{}: the server closed the connection and takes no new one ({}): it may have died",
                          address.text, connected.message())
            : fmt::format("{}: cannot connect to the server: {}; is it running?", address.text,
                          connected.message()));
  }

  HttpAnswer request(http::verb verb, const std::string& target, const std::string& body,
                     bool reads_body = true) {
    deadline =
        Clock::now() + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(timeout));
    http::request<http::string_body> message(verb, address.base + target, 11);
    const bool numeric6 = address.host.find(':') != std::string::npos;
    message.set(http::field::host, (numeric6 ? "[" + address.host + "]" : address.host) + ":" + address.port);
    message.set(http::field::user_agent, "knothe");
    message.set(http::field::accept, "application/json, */*");
    if (verb == http::verb::post) {
      message.set(http::field::content_type, "application/json");
      message.body() = body;
    }
    message.prepare_payload();
    bool again = false;
    for (bool reused = stream.has_value();; reused = false, again = true) {
      if (!stream) connect(again);
      stream->expires_at(deadline);
      http::response_parser<http::string_body> parser;
      parser.body_limit(reads_body ? std::uint64_t{1} << 30 : std::numeric_limits<std::uint64_t>::max());
      ErrorCode error = run([&](auto done) {
        http::async_write(*stream, message, [done](ErrorCode e, std::size_t) { done(e); });
      });
      if (!error)
        error = run([&](auto done) {
          const auto ended = [done](ErrorCode e, std::size_t) { done(e); };
          if (reads_body)
            http::async_read(*stream, buffer, parser, ended);
          else
            http::async_read_header(*stream, buffer, parser, ended);
        });
      if (!error) {
        auto answer = parser.release();
        if (!answer.keep_alive() || !reads_body) stream.reset();
        return {static_cast<int>(answer.result_int()), std::move(answer.body())};
      }
      stream.reset();
      const bool closed_between = reused && !parser.got_some() && error != beast::error::timeout;
      if (!closed_between) fail(target, error);
    }
  }

  [[noreturn]] void fail(const std::string& target, const ErrorCode& error) const {
    const std::string where = address.text + target;
    if (error == beast::error::timeout)
      throw DataError(fmt::format("{}: no answer within {:g} s ({} timeout)", where, timeout, table));
    if (error == http::error::end_of_stream || error == http::error::partial_message ||
        error == asio::error::connection_reset || error == asio::error::eof ||
        error == asio::error::broken_pipe)
      throw DataError(fmt::format(
          "{}: the server closed the connection before it had answered: it may have died", where));
    throw DataError(fmt::format("{}: the answer cannot be read: {}", where, error.message()));
  }
};

HttpConnection::HttpConnection(HttpAddress address, double timeout, std::string table)
    : implementation_(std::make_unique<Implementation>(std::move(address), timeout, std::move(table))) {}
HttpConnection::~HttpConnection() = default;
HttpConnection::HttpConnection(HttpConnection&&) noexcept = default;
HttpConnection& HttpConnection::operator=(HttpConnection&&) noexcept = default;

HttpAnswer HttpConnection::get(const std::string& target) {
  return implementation_->request(http::verb::get, target, "");
}
HttpAnswer HttpConnection::post(const std::string& target, const std::string& body) {
  return implementation_->request(http::verb::post, target, body);
}
int HttpConnection::post_for_status(const std::string& target, const std::string& body) {
  return implementation_->request(http::verb::post, target, body, false).status;
}

}  // namespace knothe::model
