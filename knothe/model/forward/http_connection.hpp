#pragma once
/// @file One HTTP/1.1 connection to a server, kept alive. No Boost in this header: Beast is compiled in one
/// translation unit.
#include <memory>
#include <string>

namespace knothe::model {

/// An address "http://HOST[:PORT][/BASE]".
struct HttpAddress {
  std::string host;
  std::string port = "80";
  std::string base;  ///< without a slash at its end
  std::string text;  ///< as messages show it

  /// Errors: UsageError that says what is wrong with the address.
  [[nodiscard]] static HttpAddress parse(const std::string& text);
};

struct HttpAnswer {
  int status = 0;
  std::string body;
};

/// Not thread-safe; make one per thread.
class HttpConnection {
 public:
  /// Connects at the first request. `timeout`: seconds that a request may take from first to last, connecting
  /// included; `table` of the project file says it, for messages.
  HttpConnection(HttpAddress address, double timeout, std::string table = "[model]");
  ~HttpConnection();
  HttpConnection(HttpConnection&&) noexcept;
  HttpConnection& operator=(HttpConnection&&) noexcept;

  /// Sends and waits. A connection that the server closed between two requests is opened again once. Errors:
  /// DataError (no connection, time over, connection lost, not HTTP), Interrupted if the user asked to stop.
  [[nodiscard]] HttpAnswer get(const std::string& target);
  [[nodiscard]] HttpAnswer post(const std::string& target, const std::string& body);
  /// The status alone: of an answer, however long, only the head is read. Closes the connection.
  [[nodiscard]] int post_for_status(const std::string& target, const std::string& body);

 private:
  struct Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace knothe::model
