#include "knothe/service/net/api.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <deque>
#include <optional>

#include "knothe/base/cancellation.hpp"
#include "knothe/base/error.hpp"
#include "knothe/files/json_line.hpp"
#include "knothe/service/net/page_views.hpp"

namespace knothe::service {
namespace {

/// The page's own meta element narrows this by the hashes of its script and style.
constexpr const char* k_page_policy =
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; connect-src 'self'; "
    "img-src 'self' data: blob:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

constexpr std::size_t k_small_body = 1 << 16;  // bytes; JSON of this size is read in 1 ms

constexpr const char* k_acknowledge_route = "/v1/alarms/{id}/acknowledge";

/// The id of "/v1/alarms/ID/acknowledge"; nothing for another path.
std::optional<std::int64_t> alarm_of(std::string_view path) {
  constexpr std::string_view k_first = "/v1/alarms/", k_last = "/acknowledge";
  if (!path.starts_with(k_first) || !path.ends_with(k_last) || path.size() < k_first.size() + k_last.size())
    return std::nullopt;
  path = path.substr(k_first.size(), path.size() - k_first.size() - k_last.size());
  std::int64_t id = 0;
  const auto parsed = std::from_chars(path.data(), path.data() + path.size(), id);
  const bool is_number = parsed.ec == std::errc() && parsed.ptr == path.data() + path.size() && id >= 0;
  return is_number ? std::optional(id) : std::nullopt;
}

/// As it stands in the list of routes.
std::string route_of(const std::string& path) {
  return alarm_of(path) ? k_acknowledge_route : path;
}

struct Route {
  std::string method, path;
};
const std::vector<Route>& routes() {
  static const std::vector<Route> k_routes = {{"GET", "/"},
                                              {"GET", "/livez"},
                                              {"GET", "/readyz"},
                                              {"GET", "/metrics"},
                                              {"GET", "/v1/state"},
                                              {"GET", "/v1/states"},
                                              {"GET", "/v1/events"},
                                              {"GET", "/v1/status"},
                                              {"GET", "/v1/sites"},
                                              {"GET", "/v1/openapi.json"},
                                              {"GET", "/v1/description"},
                                              {"GET", "/v1/mesh"},
                                              {"GET", "/v1/field"},
                                              {"GET", "/v1/picture"},
                                              {"GET", "/v1/observations"},
                                              {"GET", "/v1/samples"},
                                              {"GET", "/v1/signal"},
                                              {"GET", "/v1/alarms"},
                                              {"POST", k_acknowledge_route},
                                              {"GET", "/v1/logbook"},
                                              {"POST", "/v1/notes"},
                                              {"GET", "/v1/tests"},
                                              {"POST", "/v1/tests"},
                                              {"POST", "/v1/tests/finish"},
                                              {"POST", "/v1/tests/resume"},
                                              {"POST", "/v1/sensors"},
                                              {"POST", "/v1/verify"},
                                              {"GET", "/v1/quarantine"},
                                              {"POST", "/v1/quarantine"},
                                              {"POST", "/v1/measurements"},
                                              {"POST", "/v1/withdraw"},
                                              {"GET", "/Info"},
                                              {"POST", "/Info"},
                                              {"POST", "/ModelInfo"},
                                              {"POST", "/InputSizes"},
                                              {"POST", "/OutputSizes"},
                                              {"POST", "/Evaluate"},
                                              {"POST", "/Gradient"},
                                              {"POST", "/ApplyJacobian"},
                                              {"POST", "/ApplyHessian"}};
  return k_routes;
}

HttpResponse json_response(const Json& value, int status = 200) {
  return {status, "application/json", files::json_line(value)};
}

void add_security_headers(HttpResponse& response, bool is_page) {
  response.headers.emplace_back("X-Content-Type-Options", "nosniff");
  response.headers.emplace_back("Cache-Control", "no-store");
  response.headers.emplace_back("Referrer-Policy", "no-referrer");
  response.headers.emplace_back("X-Frame-Options", "DENY");
  response.headers.emplace_back("Cross-Origin-Resource-Policy", "same-origin");
  response.headers.emplace_back("Content-Security-Policy",
                                is_page ? k_page_policy : "default-src 'none'; frame-ancestors 'none'");
}

std::string lower_case(std::string text) {
  for (char& c : text) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  return text;
}

/// "localhost:8080" → "localhost"; "[::1]:8080" → "::1"; empty where it is not HOST or HOST:PORT. Names of
/// hosts are the same in either case.
std::string host_name(const std::string& host) {
  const bool brackets = host.starts_with("[");
  const auto end = std::min(brackets ? host.find(']') : host.find(':'), host.size());
  if (brackets && end == host.size()) return "";
  const std::string port = host.substr(brackets ? end + 1 : end);
  if (!port.empty() && (port[0] != ':' || port.find_first_not_of("0123456789", 1) != std::string::npos))
    return "";
  return lower_case(brackets ? host.substr(1, end - 1) : host.substr(0, end));
}

/// "application/json; charset=utf-8" → "application/json".
std::string media_type(const HttpRequest& head) {
  std::string type = head.header("content-type");
  type.resize(std::min(type.find(';'), type.size()));
  std::erase(type, ' ');
  return lower_case(type);
}

bool brings_data(const HttpRequest& head) {
  return head.method == "POST" && head.path.starts_with("/v1/");
}

HttpResponse answer_of(const JournalWriter::Answer& answer) {
  if (const auto* error = std::get_if<RequestError>(&answer))
    return error_response(error->status(), error->type(), error->what());
  if (const auto* withdrawn = std::get_if<Withdrawn>(&answer)) return json_response(answer_of(*withdrawn));
  if (const auto* entry = std::get_if<LogbookEntry>(&answer)) return json_response(json_of(*entry));
  return json_response(answer_of(std::get<Appended>(answer)));
}

/// One reader of a site: lines, alarms and states that it has not seen. It holds no queue: a line that was
/// replaced before it was sent is sent once, as it is now.
class SiteEvents final : public EventSource {
 public:
  SiteEvents(std::shared_ptr<ServedSite> served, std::shared_ptr<Site> site, std::int64_t seen)
      : served_(std::move(served)),
        site_(std::move(site)),
        seen_(seen),
        alarms_seen_(seen),
        entries_seen_(site_->logbook().last_number()) {}
  /// Steps whose lines come first, each with its id.
  using First = std::deque<std::pair<std::int64_t, std::size_t>>;
  void begin_with(First lines) { first_ = std::move(lines); }

  /// Where another test has taken its place: what is left of the one before, then all of the other. A
  /// status, which says of which journal it is, comes first.
  std::string next() override {
    std::string out = next_of_site();
    auto current = served_->current();
    if (!out.empty() || current == site_) return out;
    site_ = std::move(current);
    entries_seen_ = 0;
    state_version_ = -1;
    return next_of_site();
  }

 private:
  std::string next_of_site() {
    std::string out;
    if (const std::int64_t version = site_->health().state_version(); version != state_version_) {
      state_version_ = version;
      out += "event: status\ndata: " + files::json_line(site_->status()) + "\n\n";
    }
    // Behind the status: that says of which journal they are.
    for (; out.size() < k_piece && !first_.empty(); first_.pop_front())
      if (const auto line = site_->lines().line(first_.front().second))
        out += event_of(first_.front().first, *line);
    if (!first_.empty()) return out;
    for (const Alarm& alarm : site_->alarms().after(alarms_seen_)) {
      out += "event: alarm\ndata: " + files::json_line(json_of(alarm)) + "\n\n";
      alarms_seen_ = std::max(alarms_seen_, SiteAlarms::last_event(alarm));
    }
    for (const LogbookEntry& entry : site_->logbook().after(entries_seen_)) {
      out += "event: logbook\ndata: " + files::json_line(json_of(entry)) + "\n\n";
      entries_seen_ = entry.number;
    }
    while (out.size() < k_piece) {
      const auto line = site_->lines().next_line(seen_);
      if (!line) break;
      seen_ = line->event;
      out += event_of(line->event, *line);
    }
    return out;
  }

  static std::string event_of(std::int64_t id, const Line& line) {
    return fmt::format("id: {}\nevent: {}\ndata: {}\n\n", id, line.withdrawn ? "withdrawn" : "step",
                       line.json);
  }

  static constexpr std::size_t k_piece = 1 << 16;
  std::shared_ptr<ServedSite> served_;
  std::shared_ptr<Site> site_;  ///< the test that is read
  std::int64_t seen_, alarms_seen_, entries_seen_, state_version_ = -1;
  First first_;
};

}  // namespace

HttpResponse error_response(int status, const std::string& type, const std::string& message) {
  const Json body = {{"error", {{"type", type}, {"message", message}}}};
  return {status, "application/json", body.dump(-1, ' ', false, Json::error_handler_t::replace)};
}

Api::Api(std::vector<std::shared_ptr<ServedSite>> sites, ApiOptions options, Metrics& metrics)
    : sites_(std::move(sites)), options_(std::move(options)), metrics_(metrics), umbridge_(sites_) {}

std::vector<std::string> Api::site_names() const {
  std::vector<std::string> names;
  for (const auto& site : sites_) names.push_back(site->name());
  return names;
}

std::shared_ptr<ServedSite> Api::served(const std::string& name) const {
  if (name.empty()) return sites_.front();
  for (const auto& site : sites_)
    if (site->name() == name) return site;
  throw RequestError(404, "UnknownSite", fmt::format("there is no site \"{}\"", name));
}

Admission Api::admit(const HttpRequest& head, HttpResponse& refusal) {
  const auto refuse = [&](int status, const std::string& type, const std::string& message) {
    refusal = error_response(status, type, message);
    if (status == 401) refusal.headers.emplace_back("WWW-Authenticate", "Bearer");
    add_security_headers(refusal, false);
    return Admission::refused;
  };
  const std::string host = head.header("host");
  // A page of another site that got a name of its own to point here (DNS rebinding), or that posts here.
  const std::string name = host_name(host);
  if (options_.loopback && head.headers.contains("host") && name != "localhost" && !is_loopback(name))
    return refuse(403, "WrongHost",
                  "this service is for this machine alone: call it by localhost or 127.0.0.1");
  const std::string origin = lower_case(head.header("origin"));
  const bool is_foreign =
      !origin.empty() && origin != "http://" + lower_case(host) && origin != "https://" + lower_case(host);
  // No page knows a token that its user has not given it. Behind a proxy the page's own origin is foreign.
  const bool ingests = brings_data(head);
  const bool known = options_.tokens.holder(head, ingests).has_value();
  if (is_foreign && !known) return refuse(403, "WrongOrigin", "pages of other origins are not served");
  bool path_known = false, method_known = false;
  std::string allowed;
  for (const Route& route : routes()) {
    if (route.path != route_of(head.path)) continue;
    path_known = true;
    method_known =
        method_known || route.method == head.method || (route.method == "GET" && head.method == "HEAD");
    allowed += (allowed.empty() ? "" : ", ") + route.method;
  }
  if (!path_known) return refuse(404, "NotFound", "there is no such route; /v1/openapi.json lists them");
  if (!method_known) {
    refusal = error_response(405, "MethodNotAllowed", "this route takes " + allowed);
    refusal.headers.emplace_back("Allow", allowed);
    add_security_headers(refusal, false);
    return Admission::refused;
  }
  if (head.path == "/" || head.path == "/livez" || head.path == "/readyz") return Admission::other;
  if (options_.tokens.needed(ingests) && !known)
    return refuse(401, "Unauthorized", "this route needs `Authorization: Bearer TOKEN`");
  if (!ingests) return Admission::other;
  const std::string type = media_type(head);
  const bool npy = type == "application/x-npy" && head.path == "/v1/measurements";
  if (!type.empty() && type != "application/json" && !npy)
    return refuse(415, "UnsupportedType",
                  fmt::format("\"{}\" is not taken here: send application/json{}", type.substr(0, 100),
                              head.path == "/v1/measurements" ? " or application/x-npy" : ""));
  return Admission::ingest;
}

void Api::handle(HttpRequest request, Answer answer) {
  const bool is_page = request.path == "/";
  const Answer finished = [answer = std::move(answer), is_page](HttpResponse response) {
    add_security_headers(response, is_page && response.status == 200);
    answer(std::move(response));
  };
  try {
    route(request, finished);
  } catch (const RequestError& error) {
    finished(error_response(error.status(), error.type(), error.what()));
  }
}

void Api::route(const HttpRequest& request, const Answer& answer) {
  const std::string& path = request.path;
  if (request.method == "POST" && path.starts_with("/v1/")) {
    // A large body takes long to read: not on the thread of HTTP.
    if (request.body.size() < k_small_body) return handle_post(request, answer);
    return later(*ingest_worker_, answer, [this, request, answer] { handle_post(request, answer); });
  }
  if (path == "/v1/events") (void)make_events(request);  // it is here as something is wrong: that is thrown
  if (path == "/livez") {
    const std::string hangs = complaint();
    return answer(
        {hangs.empty() ? 200 : 503, "text/plain; charset=utf-8", hangs.empty() ? "ok\n" : hangs + "\n"});
  }
  if (path == "/readyz") return answer(ready());
  // What takes longer than a look: not on the thread of HTTP.
  if (UmBridge::speaks(path))
    return later(*worker_, answer, [this, request, answer] { answer(umbridge_.answer(request)); });
  if (path == "/v1/states" && request.query.contains("test"))
    return later(*slow_worker_, answer, [this, request, answer] { answer(states_of_test(request)); });
  if (path == "/v1/tests")  // opens the journal of each
    return later(*slow_worker_, answer, [this, request, answer] { answer(read(request)); });
  if (path == "/v1/quarantine" || path == "/v1/mesh" || path == "/v1/field" || path == "/v1/picture" ||
      path == "/v1/samples" || path == "/v1/signal" || path == "/v1/states" || path == "/v1/description" ||
      path == "/v1/logbook")
    return later(*worker_, answer, [this, request, answer] { answer(read(request)); });
  answer(read(request));
}

/// Calls `what`, which answers or throws, from the worker's thread.
void Api::later(Worker& worker, const Answer& answer, std::function<void()> what) {
  const bool taken = worker.post([answer, what = std::move(what)] {
    try {
      what();
    } catch (const RequestError& error) {
      answer(error_response(error.status(), error.type(), error.what()));
    } catch (const std::exception& error) {
      answer(error_response(500, "InternalError", error.what()));
    }
  });
  if (!taken) throw RequestError(503, "Busy", "too many requests are waiting");
}

HttpResponse Api::states_of_test(const HttpRequest& request) {
  const auto site = served(request.parameter("site"));
  const std::string from = request.parameter("from"), test = request.parameter("test");
  if (test == site->current()->test()) return read(request);
  return {200, "application/json",
          test_lines_.lines_of(*site, test, from.empty() ? 0 : parse_index(from, "from"))};
}

HttpResponse Api::read(const HttpRequest& request) {
  const std::string& path = request.path;
  if (path == "/") return {200, "text/html; charset=utf-8", std::string(page())};
  if (path == "/metrics") return {200, "text/plain; version=0.0.4; charset=utf-8", metrics_.text()};
  if (path == "/v1/openapi.json") return {200, "application/json", openapi_document()};
  if (path == "/v1/sites") return json_response({{"sites", site_names()}});
  const auto site = site_of(request.parameter("site"));
  const std::string step = request.parameter("step");
  if (path == "/v1/state") return {200, "application/json", line_of(*site, "")->json};
  if (path == "/v1/states") {
    const std::string from = request.parameter("from");
    std::string body = "[";
    auto line = site->lines().line_from(from.empty() ? 0 : parse_index(from, "from"));
    for (; line; line = site->lines().line_from(line->step + 1))
      body += (body.size() > 1 ? ",\n" : "") + line->json;
    return {200, "application/json", body + "]"};
  }
  if (path == "/v1/status") return json_response(site->status());
  if (path == "/v1/description") return json_response(description(*site, site_names()));
  if (path == "/v1/mesh") return json_response(mesh(*site));
  if (path == "/v1/field")
    return json_response(field(*site, request.parameter("name"), step, request.parameter("parameter")));
  if (path == "/v1/picture") return {200, "image/png", picture(*site, step)};
  if (path == "/v1/observations") return json_response(observations(*site, step));
  if (path == "/v1/samples") return json_response(samples(*site, step));
  if (path == "/v1/signal") return json_response(signal(*site, request.parameter("sensor"), step));
  if (path == "/v1/quarantine") return json_response(site->journal().quarantine());
  if (path == "/v1/tests") return json_response({{"tests", tests_of(*served(request.parameter("site")))}});
  if (path == "/v1/logbook") {
    Json list = Json::array();
    for (const LogbookEntry& entry : site->logbook().after(0)) list.push_back(json_of(entry));
    return json_response({{"logbook", list}});
  }
  if (path == "/v1/alarms") {
    Json list = Json::array();
    for (const Alarm& alarm : site->alarms().after(0)) list.push_back(json_of(alarm));
    return json_response({{"alarms", list}});
  }
  throw RequestError(404, "NotFound", "there is no such route");
}

HttpResponse Api::ready() const {
  Json sites = Json::object();
  bool all = true;
  for (const auto& site : sites_) {
    const auto current = site->current();
    const std::string hangs = current->health().pulses().complaint();
    const bool ready = current->journal().ready() && hangs.empty();
    all = all && ready;
    sites[site->name()] = ready ? "ready" : hangs.empty() ? "replaying its journal, or stopping" : hangs;
  }
  return json_response({{"ready", all}, {"sites", sites}}, all ? 200 : 503);
}

void Api::handle_post(const HttpRequest& request, const Answer& answer) {
  if (request.path == "/v1/measurements") return handle_measurement(request, answer);
  if (request.path == "/v1/quarantine") return handle_release(request, answer);
  if (request.path == "/v1/withdraw") return handle_withdrawal(request, answer);
  // Opens a journal and waits for the disk: not on the thread of HTTP.
  if (request.path == "/v1/tests" || request.path == "/v1/tests/resume")
    return later(*worker_, answer, [this, request, answer] { handle_test(request, answer); });
  handle_entry(request, answer);
}

void Api::handle_measurement(const HttpRequest& request, const Answer& answer) {
  std::shared_ptr<Site> site = sites_.front()->current();
  try {
    SiteMeasurement datum;
    if (media_type(request) == "application/x-npy") {
      const auto either = [&](const std::string& name) {
        const std::string plain = request.header(name), own = request.header("x-knothe-" + name);
        if (!plain.empty() && !own.empty() && plain != own)
          throw RequestError(
              400, "Malformed",
              fmt::format("the headers {0} and X-Knothe-{0} say \"{1}\" and \"{2}\"", name, plain, own));
        return plain.empty() ? own : plain;
      };
      datum = parse_npy_measurement(
          request.body, {either("site"), either("source"), either("session"), either("seq"), either("time"),
                         either("status"), either("test")});
    } else {
      datum = parse_json_measurement(request.body);
    }
    if (datum.site.empty() && sites_.size() > 1)
      throw RequestError(400, "Malformed", "\"site\" is missing; this service has several");
    try {
      site = site_of(datum.site);
    } catch (const RequestError& error) {
      throw RequestError(400, error.type(), error.what());
    }
    site->require_test(datum.test);
    site->journal().ingest(std::move(datum.measurement),
                           [answer](const JournalWriter::Answer& stored) { answer(answer_of(stored)); });
  } catch (const RequestError& error) {
    site->journal().count(error.status() == 400   ? "malformed"
                          : error.status() == 409 ? "other_test"
                                                  : "not_ready");
    throw;
  }
}

void Api::handle_release(const HttpRequest& request, const Answer& answer) {
  SiteKey datum = parse_json_key(request.body, holder(request));
  site_of(datum.site.empty() ? request.parameter("site") : datum.site)
      ->journal()
      .release(std::move(datum.datum), std::move(datum.signature),
               [answer](const JournalWriter::Answer& stored) { answer(answer_of(stored)); });
}

void Api::handle_withdrawal(const HttpRequest& request, const Answer& answer) {
  SiteKey datum = parse_json_key(request.body, holder(request));
  site_of(datum.site.empty() ? request.parameter("site") : datum.site)
      ->journal()
      .withdraw(std::move(datum.datum), std::move(datum.signature),
                [answer](const JournalWriter::Answer& stored) { answer(answer_of(stored)); });
}

void Api::handle_entry(const HttpRequest& request, const Answer& answer) {
  const EntryRequest asked = parse_json_entry(request.body, holder(request));
  const auto site = site_of(asked.site.empty() ? request.parameter("site") : asked.site);
  const auto alarm = alarm_of(request.path);
  const std::string& path = request.path;
  const EntryKind kind = alarm                        ? EntryKind::acknowledgement
                         : path == "/v1/sensors"      ? EntryKind::sensor_on  // or off, as is asked
                         : path == "/v1/verify"       ? EntryKind::verification_asked
                         : path == "/v1/tests/finish" ? EntryKind::test_finished
                         : path == "/v1/tests/resume" ? EntryKind::test_resumed
                                                      : EntryKind::note;
  site->journal().enter(site->entry(kind, asked, alarm.value_or(0)),
                        [answer](const JournalWriter::Answer& stored) { answer(answer_of(stored)); });
}

/// Another test is begun or gone back to, or the one that runs is resumed.
void Api::handle_test(const HttpRequest& request, const Answer& answer) {
  const EntryRequest asked = parse_json_entry(request.body, holder(request));
  const auto site = served(asked.site.empty() ? request.parameter("site") : asked.site);
  const bool begins = request.path == "/v1/tests";
  if (begins && !asked.test)
    throw RequestError(400, "Malformed", "\"name\" is missing: of the test to be begun");
  if (!begins && !asked.test) return handle_entry(request, answer);
  Json body = json_of(begins ? site->begin_test(asked) : site->resume_test(asked));
  body["name"] = site->current()->test();
  body["journal"] = site->current()->journal().id();
  answer(json_response(body));
}

std::unique_ptr<EventSource> Api::events(const HttpRequest& request) {
  if (request.path != "/v1/events") return nullptr;
  try {
    return make_events(request);
  } catch (const RequestError&) {
    return nullptr;  // `handle` says what is wrong
  }
}

std::unique_ptr<EventSource> Api::make_events(const HttpRequest& request) const {
  const auto from_site = served(request.parameter("site"));
  const auto site = from_site->current();
  std::string last = request.header("last-event-id");
  if (last.empty()) last = request.parameter("last_event_id");
  std::int64_t seen = site->lines().last_event();
  SiteEvents::First first;
  if (!last.empty()) {
    // An event that has not been is one of another journal: all of this one is new to its reader.
    const std::size_t told = parse_index(last, "Last-Event-ID");
    seen = told > static_cast<std::size_t>(seen) ? 0 : static_cast<std::int64_t>(told);
  } else if (const std::string from = request.parameter("from"); !from.empty()) {
    // The lines as they are, in the order of the steps; then what changes.
    const auto lines = site->lines().events_from(parse_index(from, "from"));
    first.assign(lines.begin(), lines.end());
    for (const auto& [event, step] : lines) seen = std::max(seen, event);
  } else if (const auto line = site->lines().latest()) {
    first.emplace_back(seen, line->step);
  }
  auto source = std::make_unique<SiteEvents>(from_site, site, seen);
  source->begin_with(std::move(first));
  return source;
}

std::string Api::complaint() const {
  std::string all = pulses_.complaint();
  for (const auto& site : sites_)
    if (const std::string one = site->current()->health().pulses().complaint(); !one.empty())
      all += fmt::format("{}{}: {}", all.empty() ? "" : "; ", site->name(), one);
  return all;
}

bool Api::tick() {
  if (cancellation_requested()) return false;
  for (const auto& served : sites_) {
    const auto site = served->current();
    site->tick();
    if (options_.strict_deadline && site->health().missed_strict_deadline()) return false;
  }
  return true;
}

}  // namespace knothe::service
