#include "knothe/service/site/service.hpp"

#include <fmt/format.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <set>

#include "knothe/base/error.hpp"
#include "knothe/service/camera/aravis_camera.hpp"
#include "knothe/service/camera/camera_watch.hpp"
#include "knothe/service/net/api.hpp"
#include "knothe/service/net/mqtt.hpp"
#include "knothe/service/site/folder_watch.hpp"
#include "knothe/service/site/log.hpp"

namespace knothe::service {

namespace {

/// sd_notify(3) without its library: one datagram, if systemd asks for it.
void notify_systemd(const std::string& text) {
  const char* path = std::getenv("NOTIFY_SOCKET");
  if (path == nullptr || *path == '\0') return;
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (std::strlen(path) >= sizeof address.sun_path) return;
  std::strcpy(address.sun_path, path);
  if (path[0] == '@') address.sun_path[0] = '\0';
  const int number = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (number < 0) return;
  const socklen_t size = offsetof(sockaddr_un, sun_path) + std::strlen(path);
  (void)::sendto(number, text.data(), text.size(), MSG_NOSIGNAL, reinterpret_cast<const sockaddr*>(&address),
                 size);
  ::close(number);
}

/// As many open files as the connections may need, where the system lets us: how many connections there can
/// be then, beside the files. With more, each new one would wait for another's end.
std::size_t allow_connections(std::size_t wanted) {
  constexpr std::size_t k_files = 256, k_min_files = 40;
  rlimit limit{};
  if (::getrlimit(RLIMIT_NOFILE, &limit) != 0) return wanted;
  if (limit.rlim_cur < wanted + k_files) {
    limit.rlim_cur = std::min<rlim_t>(wanted + k_files, limit.rlim_max);
    (void)::setrlimit(RLIMIT_NOFILE, &limit);
  }
  const std::size_t files =
      std::min<std::size_t>(k_files, std::max<std::size_t>(k_min_files, limit.rlim_cur / 2));
  const std::size_t room = limit.rlim_cur > files ? limit.rlim_cur - files : 1;
  if (room < wanted)
    log_event("warning", "fewer connections than [serve] max_connections: the limit of open files is too low",
              {{"connections", room}, {"max_connections", wanted}, {"open_files", limit.rlim_cur}});
  return std::min(room, wanted);
}

/// Tells systemd that the service is there and well, as often as its watchdog wants.
class WatchedApi final : public HttpHandler {
 public:
  WatchedApi(Api& api, const std::vector<std::shared_ptr<ServedSite>>& sites) : api_(api), sites_(sites) {
    if (const char* us = std::getenv("WATCHDOG_USEC"))
      interval_ = std::chrono::microseconds(std::atoll(us) / 3);
  }
  Admission admit(const HttpRequest& head, HttpResponse& refusal) override {
    return api_.admit(head, refusal);
  }
  void handle(HttpRequest request, Answer answer) override {
    api_.handle(std::move(request), std::move(answer));
  }
  std::unique_ptr<EventSource> events(const HttpRequest& request) override { return api_.events(request); }
  bool tick() override {
    if (!api_.tick()) {
      notify_systemd("STOPPING=1");
      return false;
    }
    bool ready = true;
    for (const auto& site : sites_) ready = ready && site->current()->journal().ready();
    if (ready && !told_) notify_systemd("READY=1");
    told_ = told_ || ready;
    const auto now = monotonic_now();
    // Who hangs is started again: systemd's watchdog sees to it.
    if (interval_.count() > 0 && now - last_ > interval_ && api_.complaint().empty()) {
      notify_systemd("WATCHDOG=1");
      last_ = now;
    }
    return true;
  }

 private:
  Api& api_;
  const std::vector<std::shared_ptr<ServedSite>>& sites_;
  std::chrono::microseconds interval_{0};
  MonotonicTime last_ = monotonic_now();
  bool told_ = false;
};

/// What brings data of a test by itself.
ServedSite::Watches watches_of(const std::shared_ptr<Site>& site, Metrics& metrics) {
  ServedSite::Watches watches;
  if (FolderWatch::is_wanted(site->project())) watches.push_back(std::make_shared<FolderWatch>(site));
  if (site->project().serve.camera.wanted)
    watches.push_back(std::make_shared<CameraWatch>(site, metrics, open_aravis_camera));
  return watches;
}

/// ProjectError where the project wants a camera and the program was built without.
void require_cameras(const project::Project& project) {
  if (const std::string lacks = what_cameras_need(); project.serve.camera.wanted && !lacks.empty())
    throw project.error_at("serve.camera", lacks);
}

/// SQLite would wait for ever for what a pipe says.
void require_journal_file(const project::Project& project) {
  std::error_code ignored;
  const auto there = std::filesystem::status(project.serve.journal, ignored);
  if (std::filesystem::exists(there) && !std::filesystem::is_regular_file(there))
    throw DataError(fmt::format("{}: is not a file: no journal can be kept there", project.serve.journal));
}

}  // namespace

void serve(const project::Project& project, const ServiceOptions& arguments) {
  std::signal(SIGPIPE, SIG_IGN);
  std::signal(SIGXFSZ, SIG_IGN);  // a write beyond the limit fails, as on a full disk
  require_cameras(project);
  require_journal_file(project);
  const project::ServeOptions& options = project.serve;
  const bool loopback = is_loopback(options.address);
  ApiOptions api_options{loopback, Tokens(project), arguments.strict_deadline};
  if (!loopback && !(api_options.tokens.needed(false) && api_options.tokens.needed(true)))
    throw project.error_at(
        "serve.address",
        fmt::format(
            "{} is not a loopback address: serve.read_token and serve.ingest_token, or serve.tokens, must "
            "name token files",
            options.address));
  Metrics metrics;
  HttpServer* server = nullptr;
  const auto changed = [&server] {
    if (server != nullptr) server->wake();
  };
  const ServedSite::Settings settings{
      arguments.test, arguments.strict_deadline, changed,
      [&metrics](const std::shared_ptr<Site>& site) { return watches_of(site, metrics); }};
  std::vector<std::shared_ptr<ServedSite>> sites = {std::make_shared<ServedSite>(project, settings, metrics)};
  std::set<std::string> names = {sites[0]->name()};
  for (const std::string& other : options.others) {
    const project::Project next = project::read_project(other);
    require_cameras(next);
    require_journal_file(next);
    if (!names.insert(next.serve.site).second)
      throw next.error_at(
          "serve.site",
          fmt::format("there is another site \"{}\"; give this one a name: [serve] site", next.serve.site));
    sites.push_back(std::make_shared<ServedSite>(next, settings, metrics));
  }
  Api api(sites, api_options, metrics);
  WatchedApi watched(api, sites);
  HttpServerOptions http_options;
  http_options.address = options.address;
  http_options.port = arguments.port.value_or(options.port);
  http_options.max_body = options.max_body;
  http_options.max_connections = allow_connections(options.max_connections);
  http_options.timeout = options.timeout;
  HttpServer http(http_options, watched, metrics);
  server = &http;
  const bool six = options.address.find(':') != std::string::npos;
  const std::string url =
      fmt::format("http://{}{}{}:{}/", six ? "[" : "", options.address, six ? "]" : "", http.port());
  log_event("info", "listening", {{"url", url}});
  if (arguments.listening) arguments.listening(url);
  std::unique_ptr<MqttReceiver> mqtt;
  if (!options.mqtt.broker.empty())
    mqtt = std::make_unique<MqttReceiver>(project, sites, metrics, api.pulses());
  for (const auto& site : sites) site->start();
  http.run();
  mqtt.reset();
  for (const auto& site : sites) site->stop();
  api.finish();
  http.finish();
  log_event("info", "stopped", {{"url", url}});
  end_log();
  for (const auto& served : sites)
    if (const auto site = served->current(); site->health().missed_strict_deadline())
      throw Error(ExitStatus::deadline,
                  fmt::format("site {}: an update was later than its budget of {:.3g} ms (--strict-deadline)",
                              site->name(), 1e3 * site->health().budget_s()));
  for (const auto& served : sites)
    if (const auto tally = served->current()->journal().tally(); tally.read_only)
      throw Interrupted(fmt::format("Stopped. Site {} refused measurements at the end: {}",
                                    served->current()->name(), tally.trouble));
  throw Interrupted("Stopped. All acknowledged data are saved.");
}

}  // namespace knothe::service
