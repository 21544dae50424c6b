#pragma once
/// @file An asynchronous HTTP/1.1 server on one thread (Boost.Beast), with server-sent events. No Boost in
/// this header: Beast is compiled in one translation unit.
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "knothe/service/site/metrics.hpp"

namespace knothe::service {

struct HttpRequest {
  std::string method, path;                    ///< path without the query, percent-decoded
  std::map<std::string, std::string> query;    ///< percent-decoded
  std::map<std::string, std::string> headers;  ///< names in lower case
  std::string body;
  std::shared_ptr<const void> body_room;  ///< of the room for all bodies; given back with the last copy

  [[nodiscard]] std::string header(const std::string& name) const;
  [[nodiscard]] std::string parameter(const std::string& name) const;
};

struct HttpResponse {
  int status = 200;
  std::string content_type = "application/json";
  std::string body;
  std::vector<std::pair<std::string, std::string>> headers = {};
};

/// `{"error":{"type":…,"message":…}}`.
[[nodiscard]] HttpResponse error_response(int status, const std::string& type, const std::string& message);

/// What is sent to one reader of events.
class EventSource {
 public:
  virtual ~EventSource() = default;
  /// The next piece of text, as server-sent events; empty if there is nothing now. On the server's thread.
  [[nodiscard]] virtual std::string next() = 0;
};

/// What is to become of a request whose head has been read.
enum class Admission {
  refused,
  other,
  ingest  ///< brings data: its connection is the last to be closed where there are too many
};

/// What the server asks; all on the server's thread.
class HttpHandler {
 public:
  using Answer = std::function<void(HttpResponse)>;
  virtual ~HttpHandler() = default;
  /// Looks at the head of a request before its body is read. Where it is refused, `refusal` is the answer.
  [[nodiscard]] virtual Admission admit(const HttpRequest& head, HttpResponse& refusal) = 0;
  /// `answer` is called once, from any thread.
  virtual void handle(HttpRequest request, Answer answer) = 0;
  /// A reader of events if the request asks for them; else nothing, and `handle` is called.
  [[nodiscard]] virtual std::unique_ptr<EventSource> events(const HttpRequest& request) = 0;
  /// Twenty times a second. False: the server is to stop.
  [[nodiscard]] virtual bool tick() = 0;
};

struct HttpServerOptions {
  std::string address = "127.0.0.1";
  unsigned short port = 0;         ///< 0: any free one
  std::size_t max_header = 16384;  ///< bytes
  std::size_t max_body = 8 << 20;  ///< bytes
  std::size_t max_bodies = 8;      ///< times `max_body`: of all requests together; half of it brings no data;
                                   ///< and of all answers that are not yet read
  std::size_t max_connections = 1024;
  double timeout = 30;       ///< s that head and body of a request may take, and that the client may not read
  double idle_timeout = 75;  ///< s between two requests of a connection
};

/// Where `max_connections` are open, a new one takes the place of the one that has kept us waiting longest,
/// of those that bring no data first; event streams are at most three quarters of them.
class HttpServer {
 public:
  /// Listens. IoError where the address cannot be had.
  HttpServer(HttpServerOptions options, HttpHandler& handler, Metrics& metrics);
  ~HttpServer();
  [[nodiscard]] unsigned short port() const;
  /// Serves until `tick` says no; then takes no more connections, finishes what is being answered (for at
  /// most two seconds), and returns.
  void run();
  /// After `run`, when nobody answers: closes what is still open.
  void finish();
  /// There may be something new for readers of events. From any thread.
  void wake();

  struct Implementation;

 private:
  std::shared_ptr<Implementation> implementation_;
};

/// Listens for a moment. IoError where the address cannot be had.
void try_to_listen(const std::string& address, unsigned short port);

/// Whether an address is of this machine alone.
[[nodiscard]] bool is_loopback(const std::string& address);

}  // namespace knothe::service
