#include "knothe/service/net/http_server.hpp"

#include <fmt/format.h>

#include <utility>  // before Asio: GCC 12 in C++20 needs std::exchange there

#include <algorithm>
#include <atomic>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/write.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <chrono>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>

#include "knothe/base/error.hpp"
#include "knothe/service/net/http_request.hpp"
#include "knothe/service/site/log.hpp"

namespace knothe::service {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = boost::beast::http;
using ErrorCode = boost::system::error_code;
using std::chrono::milliseconds;

namespace {

constexpr milliseconds k_tick{50};
constexpr std::chrono::seconds k_heartbeat{10};
constexpr std::size_t k_drained = 1 << 20;  // bytes read and thrown away after a refusal, so that it arrives
constexpr std::size_t k_small_answer = 1 << 14;  // bytes; less is always sent
constexpr const char* k_stream_head =
    "HTTP/1.1 200 OK\r\nServer: knothe\r\nContent-Type: text/event-stream\r\nCache-Control: no-store\r\n"
    "X-Content-Type-Options: nosniff\r\nX-Accel-Buffering: no\r\nConnection: close\r\n\r\n";

/// Bytes of a request's body, or of an answer, of the room that all share.
class BodyRoom {
 public:
  explicit BodyRoom(std::shared_ptr<std::atomic<std::size_t>> used) : used_(std::move(used)) {}
  ~BodyRoom() { *used_ -= bytes_; }
  BodyRoom(const BodyRoom&) = delete;
  BodyRoom& operator=(const BodyRoom&) = delete;
  /// False where all would take more than `limit` then.
  [[nodiscard]] bool grow_to(std::size_t bytes, std::size_t limit) {
    const std::size_t all = *used_ += bytes - bytes_;
    bytes_ = bytes;
    return all <= limit;
  }
  [[nodiscard]] std::size_t bytes() const { return bytes_; }

 private:
  std::shared_ptr<std::atomic<std::size_t>> used_;
  std::size_t bytes_ = 0;
};

}  // namespace

class Session;

struct HttpServer::Implementation : std::enable_shared_from_this<Implementation> {
  HttpServerOptions options;
  HttpHandler& handler;
  Metrics& metrics;
  asio::io_context context{1};
  asio::ip::tcp::acceptor acceptor{context};
  asio::steady_timer timer{context};
  std::set<Session*> sessions;
  std::shared_ptr<std::atomic<std::size_t>> body_bytes = std::make_shared<std::atomic<std::size_t>>(0);
  std::shared_ptr<std::atomic<std::size_t>> answer_bytes = std::make_shared<std::atomic<std::size_t>>(0);
  std::atomic<bool> wake_posted{false};
  bool stopping = false;
  std::optional<std::chrono::steady_clock::time_point> stop_by;

  Implementation(HttpServerOptions o, HttpHandler& h, Metrics& m)
      : options(std::move(o)), handler(h), metrics(m) {}
  void listen();
  void accept();
  void tick();
  void wake_streams();
  void make_room();
  void make_room_for_answer(const Session& its);
  [[nodiscard]] std::size_t stream_count() const;
  /// What a fault ends is the connection it was in, not the service.
  template <class Work>
  void survive(Work work);
  void gauges(std::size_t streams) {
    metrics.set("knothe_connections", "", sessions.size());
    metrics.set("knothe_event_streams", "", streams);
  }
};

/// One connection. Keeps itself alive by the operation it waits for.
class Session : public std::enable_shared_from_this<Session> {
 public:
  Session(asio::ip::tcp::socket socket, std::shared_ptr<HttpServer::Implementation> server);
  ~Session();
  void start() { read_head(); }
  void wake();
  void stop();
  void close() { stream_.close(); }
  [[nodiscard]] bool streams() const { return source_ != nullptr; }
  /// Since when the client has kept us waiting; nothing while we work for it, or it is a reader of events.
  [[nodiscard]] std::optional<std::chrono::steady_clock::time_point> waiting_since() const {
    return waiting_since_;
  }
  /// It has a large answer that its client has not read.
  [[nodiscard]] bool holds_answer() const {
    return waiting_since_ && answer_room_ && answer_room_->bytes() > k_small_answer;
  }
  void give_up_answer() {
    answer_room_.reset();
    close();
  }
  [[nodiscard]] bool ingests() const { return admission_ == Admission::ingest; }

 private:
  using Parser = http::request_parser<http::string_body>;
  void read_head();
  void head_read(ErrorCode error);
  [[nodiscard]] std::optional<HttpResponse> objection() const;
  void read_body();
  void body_read(ErrorCode error);
  void dispatch();
  void respond(HttpResponse response, bool close);
  void refuse(HttpResponse response);
  void drain(std::size_t left);
  void begin_stream();
  void write_stream(std::string text);
  void watch_for_the_end();
  [[nodiscard]] HttpRequest request_of(const http::request<http::string_body>& message) const;
  void expire(double seconds) { stream_.expires_after(milliseconds(static_cast<long>(1e3 * seconds))); }

  std::shared_ptr<HttpServer::Implementation> server_;
  beast::tcp_stream stream_;
  beast::flat_buffer buffer_;  ///< bounded: trailers are read whole, and have no limit of their own
  std::optional<Parser> parser_;
  HttpRequest head_;  ///< as it was admitted: trailers, which come behind the body, change nothing
  std::optional<http::response<http::string_body>> response_;
  std::unique_ptr<EventSource> source_;
  std::string out_, sink_;
  std::chrono::steady_clock::time_point last_sent_;
  std::shared_ptr<BodyRoom> room_, answer_room_;
  std::optional<std::chrono::steady_clock::time_point> waiting_since_;
  Admission admission_ = Admission::other;
  bool writing_ = false, answered_ = true, head_request_ = false;
};

Session::Session(asio::ip::tcp::socket socket, std::shared_ptr<HttpServer::Implementation> server)
    : server_(std::move(server)), stream_(std::move(socket)), buffer_(2 * server_->options.max_header) {
  server_->sessions.insert(this);
}

Session::~Session() {
  server_->sessions.erase(this);
}

void Session::read_head() {
  if (server_->stopping) return;
  parser_.emplace();
  parser_->header_limit(server_->options.max_header);
  parser_->body_limit(server_->options.max_body);
  // A new connection has as long for its head as for a body; later ones may stay idle between requests. Drops
  // of bytes do not prolong it.
  expire(response_ ? server_->options.idle_timeout : server_->options.timeout);
  waiting_since_ = std::chrono::steady_clock::now();
  http::async_read_header(
      stream_, buffer_, *parser_,
      [self = shared_from_this()](ErrorCode error, std::size_t) { self->head_read(error); });
}

void Session::head_read(ErrorCode error) {
  if (error == http::error::header_limit || error == http::error::buffer_overflow)
    return refuse(
        error_response(431, "HeaderTooLarge",
                       fmt::format("the header is larger than {} bytes", server_->options.max_header)));
  if (error == http::error::body_limit)
    return refuse(error_response(413, "TooLarge",
                                 fmt::format("the body is larger than {} bytes", server_->options.max_body)));
  if (error == http::error::end_of_stream || error == beast::error::timeout ||
      error == asio::error::operation_aborted ||
      (error && error.category() == asio::error::get_system_category()) ||
      error == http::error::partial_message)
    return;  // closed, or too slow: nobody listens
  if (error) return refuse(error_response(400, "NotHttp", "the request is not HTTP/1.1: " + error.message()));
  const auto hosts = parser_->get().count(http::field::host);
  if (hosts > 1 || (hosts == 0 && parser_->get().version() >= 11))
    return refuse(error_response(400, "NotHttp", "a request of HTTP/1.1 has one Host: header"));
  head_ = request_of(parser_->get());
  HttpResponse refusal;
  const Admission admission = server_->handler.admit(head_, refusal);
  if (admission == Admission::refused) return refuse(std::move(refusal));
  admission_ = admission;
  if (auto why = objection()) return refuse(std::move(*why));
  room_ = std::make_shared<BodyRoom>(server_->body_bytes);
  if (const auto length = parser_->content_length(); length && *length > server_->options.max_body)
    return refuse(error_response(
        413, "TooLarge",
        fmt::format("the body has {} bytes; at most {} are taken", *length, server_->options.max_body)));
  expire(server_->options.timeout);
  if (parser_->is_done()) return dispatch();
  if (parser_->get().version() < 11 || !beast::iequals(head_.header("expect"), "100-continue"))
    return read_body();
  out_ = "HTTP/1.1 100 Continue\r\n\r\n";
  asio::async_write(stream_, asio::buffer(out_), [self = shared_from_this()](ErrorCode failed, std::size_t) {
    if (!failed) self->read_body();
  });
}

void Session::read_body() {
  http::async_read_some(
      stream_, buffer_, *parser_,
      [self = shared_from_this()](ErrorCode error, std::size_t) { self->body_read(error); });
}

void Session::body_read(ErrorCode error) {
  const HttpServerOptions& options = server_->options;
  if (error == http::error::body_limit)
    return refuse(
        error_response(413, "TooLarge", fmt::format("the body is larger than {} bytes", options.max_body)));
  if (error == http::error::buffer_overflow)
    return refuse(error_response(431, "HeaderTooLarge", "the trailer of the body is too large"));
  if (error.category() == http::make_error_code(http::error::bad_chunk).category() &&
      error != http::error::partial_message && error != http::error::end_of_stream)
    return refuse(error_response(400, "NotHttp", "the body cannot be read: " + error.message()));
  if (error) return;  // closed, or too slow: nobody listens
  const std::size_t all = options.max_bodies * options.max_body;
  if (!room_->grow_to(parser_->get().body().size(), ingests() ? all : all / 2))
    return refuse(error_response(503, "Busy", "too many large requests at once"));
  parser_->is_done() ? dispatch() : read_body();
}

/// What stands against the body of a request, by its head: where a body ends must be beyond doubt, or what is
/// in it is the next request.
std::optional<HttpResponse> Session::objection() const {
  const auto& head = parser_->get();
  const auto encodings = head.count(http::field::transfer_encoding);
  const bool has_length = head.count(http::field::content_length) > 0;
  if (encodings > 0 && has_length)
    return error_response(400, "NotHttp", "a body has a Content-Length or a Transfer-Encoding, not both");
  if (encodings > 1 || (encodings == 1 && !beast::iequals(head[http::field::transfer_encoding], "chunked")))
    return error_response(501, "UnknownEncoding", "the only Transfer-Encoding that is taken is chunked");
  if (encodings == 1 && head.version() < 11)
    return error_response(400, "NotHttp", "HTTP/1.0 knows no Transfer-Encoding");
  const bool posts = head.method() == http::verb::post;
  if (posts && encodings == 0 && !has_length)
    return error_response(411, "LengthRequired", "the body has no Content-Length");
  if (!posts && (encodings > 0 || parser_->content_length().value_or(0) > 0))
    return error_response(413, "TooLarge",
                          fmt::format("{} takes no body", std::string(head.method_string())));
  return std::nullopt;
}

HttpRequest Session::request_of(const http::request<http::string_body>& message) const {
  HttpRequest request;
  request.method = std::string(message.method_string());
  for (const auto& field : message) {
    std::string name(field.name_string());
    for (char& c : name) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
    // Fields of one name are a list (RFC 9110, 5.3): no reader takes one of them for all.
    const auto [place, is_new] = request.headers.try_emplace(name, std::string(field.value()));
    if (!is_new) place->second += ", " + std::string(field.value());
  }
  set_target(request, {message.target().data(), message.target().size()});  // may name the host
  return request;
}

void Session::dispatch() {
  const bool keep_alive = parser_->get().keep_alive();
  HttpRequest request = std::exchange(head_, {});
  request.body = std::move(parser_->get().body());
  request.body_room = std::exchange(room_, nullptr);
  waiting_since_.reset();
  head_request_ = request.method == "HEAD";
  if (head_request_) request.method = "GET";
  stream_.expires_never();
  if (request.method == "GET" && (source_ = server_->handler.events(request))) return begin_stream();
  answered_ = false;
  // The answer may come from another thread, and after the connection has gone.
  const auto answer = [self = shared_from_this(), keep_alive](HttpResponse response) {
    asio::post(self->server_->context, [self, keep_alive, response = std::move(response)]() mutable {
      self->answered_ = true;
      self->respond(std::move(response), !keep_alive);
    });
  };
  try {
    server_->handler.handle(std::move(request), answer);
  } catch (const std::exception& error) {
    answer(error_response(500, "InternalError", error.what()));
  }
}

void Session::respond(HttpResponse response, bool close) {
  close = close || server_->stopping;
  const HttpServerOptions& options = server_->options;
  answer_room_ = std::make_shared<BodyRoom>(server_->answer_bytes);
  const std::size_t sent_bytes = head_request_ ? 0 : response.body.size();
  if (!answer_room_->grow_to(sent_bytes, options.max_bodies * options.max_body))
    server_->make_room_for_answer(*this);
  server_->metrics.count("knothe_requests_total", fmt::format("status=\"{}\"", response.status));
  response_.emplace(static_cast<http::status>(response.status), 11);
  response_->set(http::field::server, "knothe");
  response_->set(http::field::content_type, response.content_type);
  for (const auto& [name, value] : response.headers) response_->set(name, value);
  response_->keep_alive(!close);
  const std::size_t length = response.body.size();
  if (!head_request_) response_->body() = std::move(response.body);
  response_->content_length(length);
  expire(server_->options.timeout);
  waiting_since_ = std::chrono::steady_clock::now();
  const auto sent = [self = shared_from_this(), close](ErrorCode error, std::size_t) {
    std::string().swap(self->response_->body());  // a connection may stay idle for long
    self->answer_room_.reset();
    if (error) return;
    if (!close) return self->read_head();
    ErrorCode ignored;
    self->stream_.socket().shutdown(asio::ip::tcp::socket::shutdown_send, ignored);
    self->drain(k_drained);
  };
  if (head_request_) {
    // Head only: the length is that of the body that a GET would have brought.
    const auto serializer = std::make_shared<http::response_serializer<http::string_body>>(*response_);
    serializer->split(true);
    http::async_write_header(stream_, *serializer,
                             [serializer, sent](ErrorCode error, std::size_t n) { sent(error, n); });
  } else {
    http::async_write(stream_, *response_, sent);
  }
}

void Session::refuse(HttpResponse response) {
  head_request_ = parser_->is_header_done() && parser_->get().method() == http::verb::head;
  room_.reset();
  std::string().swap(parser_->get().body());  // to assign an empty one would keep the memory
  respond(std::move(response), true);
}

/// A client that still sends would not see our answer if we closed at once.
void Session::drain(std::size_t left) {
  expire(2);
  sink_.resize(16384);
  stream_.async_read_some(asio::buffer(sink_),
                          [self = shared_from_this(), left](ErrorCode error, std::size_t n) {
                            if (!error && n < left) self->drain(left - n);
                          });
}

void Session::begin_stream() {
  const std::size_t most = server_->options.max_connections / 4 * 3;
  if (server_->stream_count() > std::max<std::size_t>(most, 1)) {
    source_.reset();
    return refuse(error_response(503, "Busy", fmt::format("there are {} readers of events already", most)));
  }
  if (head_request_) {
    source_.reset();
    out_ = k_stream_head;
    return asio::async_write(stream_, asio::buffer(out_),
                             [self = shared_from_this()](ErrorCode error, std::size_t) {
                               if (!error) self->drain(0);
                             });
  }
  ErrorCode ignored;
  stream_.socket().set_option(asio::ip::tcp::no_delay(true), ignored);
  server_->metrics.count("knothe_requests_total", "status=\"200\"");
  watch_for_the_end();
  write_stream(std::string(k_stream_head) + "retry: 1000\n\n");
}

void Session::write_stream(std::string text) {
  writing_ = true;
  out_ = std::move(text);
  expire(server_->options.timeout);
  asio::async_write(stream_, asio::buffer(out_), [self = shared_from_this()](ErrorCode error, std::size_t) {
    self->writing_ = false;
    self->last_sent_ = std::chrono::steady_clock::now();
    if (error) return self->stop();
    self->stream_.expires_never();
    self->wake();
  });
}

/// Reads, to learn that the reader has gone; what it sends is thrown away.
void Session::watch_for_the_end() {
  sink_.resize(512);
  stream_.socket().async_read_some(asio::buffer(sink_),
                                   [self = shared_from_this()](ErrorCode error, std::size_t) {
                                     if (error) return self->stop();
                                     self->watch_for_the_end();
                                   });
}

void Session::wake() {
  if (!source_ || writing_ || !stream_.socket().is_open()) return;
  std::string text = source_->next();
  if (text.empty() && std::chrono::steady_clock::now() - last_sent_ > k_heartbeat) text = ": still here\n\n";
  if (!text.empty()) write_stream(std::move(text));
}

void Session::stop() {
  if (!answered_) return;  // it is being answered
  stream_.close();
}

namespace {

void listen_at(asio::ip::tcp::acceptor& acceptor, const std::string& address, unsigned short port) {
  try {
    const asio::ip::tcp::endpoint endpoint(asio::ip::make_address(address), port);
    acceptor.open(endpoint.protocol());
    acceptor.set_option(asio::socket_base::reuse_address(true));
    acceptor.bind(endpoint);
    acceptor.listen(256);
  } catch (const boost::system::system_error& error) {
    throw IoError(fmt::format("cannot listen at {}:{}: {}; choose another with --port, or stop what is there",
                              address, port, error.code().message()));
  }
}

}  // namespace

void try_to_listen(const std::string& address, unsigned short port) {
  asio::io_context context;
  asio::ip::tcp::acceptor acceptor(context);
  listen_at(acceptor, address, port);
}

void HttpServer::Implementation::listen() {
  listen_at(acceptor, options.address, options.port);
}

void HttpServer::Implementation::accept() {
  acceptor.async_accept([self = shared_from_this()](ErrorCode error, asio::ip::tcp::socket socket) {
    if (!self->acceptor.is_open()) return;
    if (error) {  // out of descriptors: wait for some to come back
      self->make_room();
      const auto pause = std::make_shared<asio::steady_timer>(self->context, milliseconds(100));
      return pause->async_wait([self, pause](ErrorCode) {
        if (self->acceptor.is_open()) self->accept();
      });
    }
    self->accept();
    if (self->sessions.size() >= self->options.max_connections) self->make_room();
    if (self->sessions.size() >= self->options.max_connections) return;  // it closes: that tells
    ErrorCode ignored;
    socket.set_option(asio::ip::tcp::no_delay(true), ignored);
    std::make_shared<Session>(std::move(socket), self)->start();
  });
}

/// Closes the connection that has kept us waiting longest, of those that bring no data first.
void HttpServer::Implementation::make_room() {
  Session* longest = nullptr;
  const auto before = [](const Session& a, const Session& b) {
    return a.ingests() != b.ingests() ? b.ingests() : *a.waiting_since() < *b.waiting_since();
  };
  for (Session* session : sessions)
    if (session->waiting_since() && (longest == nullptr || before(*session, *longest))) longest = session;
  if (longest == nullptr) return;
  sessions.erase(longest);  // it lives on until the operation that it waits for has ended
  longest->shared_from_this()->close();
}

/// Closes the connections whose clients have kept us waiting longest with a large answer, until all that is
/// left, with this one's, has room; one answer by itself may be of any size.
void HttpServer::Implementation::make_room_for_answer(const Session& its) {
  while (*answer_bytes > options.max_bodies * options.max_body) {
    Session* longest = nullptr;
    for (Session* session : sessions)
      if (session != &its && session->holds_answer() &&
          (longest == nullptr || *session->waiting_since() < *longest->waiting_since()))
        longest = session;
    if (longest == nullptr) return;
    sessions.erase(longest);
    longest->shared_from_this()->give_up_answer();
  }
}

std::size_t HttpServer::Implementation::stream_count() const {
  return std::count_if(sessions.begin(), sessions.end(), [](const Session* s) { return s->streams(); });
}

template <class Work>
void HttpServer::Implementation::survive(Work work) {
  try {
    work();
  } catch (const std::exception& error) {
    log_event("error", "a connection was ended by a fault of the service", {{"reason", error.what()}});
  }
}

void HttpServer::Implementation::wake_streams() {
  std::size_t streams = 0;
  // A session may end while it is woken: the set is copied, the ends are posted.
  const std::vector<Session*> all(sessions.begin(), sessions.end());
  for (Session* session : all) {
    if (!sessions.contains(session) || !session->streams()) continue;
    ++streams;
    const auto keep = session->shared_from_this();
    bool whole = false;
    survive([&] {
      keep->wake();
      whole = true;
    });
    if (!whole) keep->close();
  }
  gauges(streams);
}

void HttpServer::Implementation::tick() {
  timer.expires_after(k_tick);
  timer.async_wait([self = shared_from_this()](ErrorCode error) {
    if (error) return;
    self->tick();
    if (!self->stopping && !self->handler.tick()) {
      self->stopping = true;
      self->stop_by = std::chrono::steady_clock::now() + std::chrono::seconds(2);
      ErrorCode ignored;
      self->acceptor.close(ignored);
    }
    if (self->stopping) {
      const std::vector<Session*> all(self->sessions.begin(), self->sessions.end());
      for (Session* session : all)
        if (self->sessions.contains(session)) session->shared_from_this()->stop();
      if (self->sessions.empty() || std::chrono::steady_clock::now() > *self->stop_by) self->context.stop();
    } else {
      self->wake_streams();
    }
  });
}

HttpServer::HttpServer(HttpServerOptions options, HttpHandler& handler, Metrics& metrics)
    : implementation_(std::make_shared<Implementation>(std::move(options), handler, metrics)) {
  implementation_->listen();
}

HttpServer::~HttpServer() = default;

unsigned short HttpServer::port() const {
  return implementation_->acceptor.local_endpoint().port();
}

void HttpServer::run() {
  Implementation& i = *implementation_;
  i.accept();
  i.tick();
  while (!i.context.stopped()) i.survive([&] { i.context.run(); });
}

void HttpServer::finish() {
  Implementation& i = *implementation_;
  ErrorCode ignored;
  i.acceptor.close(ignored);
  i.timer.cancel();
  i.context.restart();
  i.survive([&] { i.context.poll(); });  // answers that came after the end
  const std::vector<Session*> all(i.sessions.begin(), i.sessions.end());
  for (Session* session : all)
    if (i.sessions.contains(session)) session->shared_from_this()->close();
  i.context.restart();
  i.survive([&] { i.context.poll(); });
}

void HttpServer::wake() {
  if (implementation_->wake_posted.exchange(true)) return;
  asio::post(implementation_->context, [self = implementation_] {
    self->wake_posted = false;
    self->wake_streams();
  });
}

}  // namespace knothe::service
