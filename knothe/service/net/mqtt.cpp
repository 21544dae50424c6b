#include "knothe/service/net/mqtt.hpp"

#include <fmt/format.h>
#include <mosquitto.h>
#include <sys/socket.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <future>
#include <map>
#include <set>
#include <thread>

#include "knothe/base/error.hpp"
#include "knothe/files/json_line.hpp"
#include "knothe/service/net/dead_letters.hpp"
#include "knothe/service/net/mqtt_client.hpp"
#include "knothe/service/site/log.hpp"

namespace knothe::service {
namespace {

constexpr std::chrono::milliseconds k_first_pause{1000}, k_longest_pause{30'000}, k_glance{50};
constexpr double k_max_message = 120;  // s; a client that takes longer for one hangs
constexpr int k_max_kept = 1 << 20;    // bytes of a refused message
constexpr std::size_t k_max_told = 64;
constexpr int k_suspicious = 3;  // short connections, one after the other

}  // namespace

struct MqttReceiver::Implementation {
  std::vector<std::shared_ptr<ServedSite>> sites;
  Metrics& metrics;
  std::string host;
  int port = 1883;
  std::size_t max_body;
  std::string id;
  DeadLetters refused;
  std::set<std::string> told;  ///< topics and reasons that an alarm has been raised of
  std::atomic<bool> stopping{false};
  std::map<int, std::string> asked;  ///< topics by number of the packet; of the client's thread alone
  bool connected = false;            ///< the same
  std::chrono::steady_clock::time_point connected_at;
  int short_connections = 0;  ///< one after the other
  std::shared_ptr<mosquitto> client;
  std::shared_ptr<Pulse> pulse;
  std::thread thread;

  Implementation(std::vector<std::shared_ptr<ServedSite>> s, Metrics& m, const project::Project& project)
      : sites(std::move(s)),
        metrics(m),
        max_body(project.serve.max_body),
        id(durable_client_id(project.serve.journal)),
        refused(project.serve.journal + "-refused.jsonl") {}

  /// What became of a message, as the body of an answer of HTTP; nothing if it is to come again.
  std::optional<Json> handle(const mosquitto_message& message) {
    try {
      if (message.payloadlen < 0 || static_cast<std::size_t>(message.payloadlen) > max_body)
        throw RequestError(
            413, "TooLarge",
            fmt::format("the message has {} bytes; at most {} are taken", message.payloadlen, max_body));
      const std::string_view topic = message.topic;
      const std::string_view payload(static_cast<const char*>(message.payload), message.payloadlen);
      if (topic.ends_with("/withdraw")) {
        SiteKey named = parse_mqtt_key(topic, payload);
        // It may come again after the datum was corrected, unknown to whoever sent it.
        if (named.datum.which == RecordName::Which::last) named.datum.which = RecordName::Which::first;
        const auto stored = store(
            [&](auto done) { site_of(named.site)->journal().withdraw(named.datum, {}, std::move(done)); });
        const auto* withdrawn = stored ? std::get_if<Withdrawn>(&*stored) : nullptr;
        if (withdrawn != nullptr && withdrawn->replaced && !message.retain)
          throw RequestError(409, "Withdrawn",
                             "it was withdrawn before, and its replacement stays: to withdraw that, give the "
                             "\"record\" of the answer to it");
        return answer(named.datum.key.seq, stored);
      }
      SiteMeasurement datum = parse_mqtt_measurement(topic, payload);
      using Restores = Measurement::Restores;
      datum.measurement.restores = message.retain ? Restores::never : Restores::if_changed;
      return answer(datum.measurement.key.seq, store([&](auto done) {
                      const auto site = site_of(datum.site);
                      site->require_test(datum.test);
                      site->journal().ingest(datum.measurement, std::move(done));
                    }));
    } catch (const RequestError& error) {
      log_event("warning", "a message was refused",
                {{"topic", message.topic}, {"type", error.type()}, {"reason", error.what()}});
      if (error.status() == 400 || error.status() == 413)
        sites.front()->current()->journal().count("malformed");
      // That a broker brings again what was withdrawn since is not news.
      if (!(message.retain && error.type() == "Withdrawn") && !keep(message, error)) return std::nullopt;
      return Json{{"error", {{"type", error.type()}, {"message", error.what()}}}};
    }
  }

  /// Its sender will be told that it has arrived: what nobody assimilates is kept, and said. False: not now.
  bool keep(const mosquitto_message& message, const RequestError& error) {
    const std::string_view payload(static_cast<const char*>(message.payload),
                                   std::clamp(message.payloadlen, 0, k_max_kept));
    const auto now = std::chrono::system_clock::now().time_since_epoch();
    const Json letter = {
        {"received_at", 1e-3 * std::chrono::duration_cast<std::chrono::milliseconds>(now).count()},
        {"topic", message.topic},
        {"type", error.type()},
        {"reason", error.what()},
        {"bytes", message.payloadlen},
        {"payload", std::string(payload)}};
    while (!refused.store(letter)) {
      log_event("error", "a refused message cannot be kept: it is not acknowledged",
                {{"file", refused.path()}});
      if (stopping) return false;
      pulse->beat();
      std::this_thread::sleep_for(std::chrono::milliseconds(500));
    }
    if (told.size() < k_max_told && told.insert(fmt::format("{} {}", message.topic, error.type())).second) {
      const auto site = site_at(message.topic);
      const auto line = site->lines().latest();
      site->alarms().raise(line ? line->step : 0, "warning", "sensors",
                           fmt::format("a message at {} was refused: {}; it is kept in {}, as others will be",
                                       message.topic, error.what(), refused.path()));
    }
    return true;
  }

  /// The site that a topic is of; the first, if it is none's.
  [[nodiscard]] std::shared_ptr<Site> site_at(std::string_view topic) const {
    for (const auto& site : sites)
      if (topic.find(fmt::format("/{}/", site->name())) != std::string_view::npos) return site->current();
    return sites.front()->current();
  }

  /// The test that runs now: another may have taken its place when a message is tried again.
  [[nodiscard]] std::shared_ptr<Site> site_of(const std::string& name) const {
    for (const auto& site : sites)
      if (site->name() == name) return site->current();
    throw RequestError(400, "UnknownSite", fmt::format("there is no site \"{}\"", name));
  }

  static std::optional<Json> answer(std::int64_t seq, const std::optional<JournalWriter::Answer>& stored) {
    if (!stored) return std::nullopt;
    if (const auto* error = std::get_if<RequestError>(&*stored)) throw RequestError(*error);
    const auto* withdrawn = std::get_if<Withdrawn>(&*stored);
    Json answer = withdrawn != nullptr ? answer_of(*withdrawn) : answer_of(std::get<Appended>(*stored));
    answer["seq"] = seq;
    return answer;
  }

  using Done = std::function<void(JournalWriter::Answer)>;
  /// Asks the journal, and waits until it is on disk; again while the disk is full or the journal is
  /// replayed.
  std::optional<JournalWriter::Answer> store(const std::function<void(Done)>& ask) {
    while (!stopping) {
      pulse->beat();  // who waits for a full disk is alive
      const auto promise = std::make_shared<std::promise<JournalWriter::Answer>>();
      auto answer = promise->get_future();
      try {
        ask([promise](const JournalWriter::Answer& stored) { promise->set_value(stored); });
        JournalWriter::Answer stored = answer.get();
        const auto* error = std::get_if<RequestError>(&stored);
        if (error == nullptr || (error->status() != 507 && error->status() != 503)) return stored;
      } catch (const RequestError& error) {
        if (error.status() != 503) throw;
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(100));
    }
    return std::nullopt;
  }

  /// Connected, or on the way there, until the end. The library's own thread would give up where the first
  /// attempt fails.
  void run() {
    using std::chrono::milliseconds;
    milliseconds pause = k_first_pause;
    std::string said;
    int code = mosquitto_connect_async(client.get(), host.c_str(), port, 30);
    while (!stopping) {
      while (code == MOSQ_ERR_SUCCESS && !stopping) {
        pulse->beat();
        code = mosquitto_loop(client.get(), 200, 1);
        if (connected) pause = k_first_pause, said.clear();
      }
      pulse->rest();
      if (stopping) break;
      const std::string reason = code == MOSQ_ERR_ERRNO ? std::strerror(errno) : mosquitto_strerror(code);
      if (!connected && reason != said && code != MOSQ_ERR_CONN_REFUSED)
        log_event("error", "the MQTT broker cannot be reached: the connection is retried",
                  {{"broker", host}, {"port", port}, {"reason", reason}});
      said = reason;
      connected = false;
      for (milliseconds waited{0}; waited < pause && !stopping; waited += k_glance)
        std::this_thread::sleep_for(k_glance);
      pause = std::min(2 * pause, k_longest_pause);
      pulse->beat();
      if (!stopping) code = mosquitto_reconnect_async(client.get());
    }
    mosquitto_disconnect(client.get());
  }

  static void on_connect(mosquitto* client, void* self, int code) {
    auto* receiver = static_cast<Implementation*>(self);
    if (code != 0) {
      log_event("error", "the MQTT broker refused",
                {{"broker", receiver->host}, {"reason", mosquitto_connack_string(code)}});
      return;
    }
    receiver->connected = true;
    receiver->connected_at = std::chrono::steady_clock::now();
    log_event("info", "connected to the MQTT broker", {{"broker", receiver->host}, {"port", receiver->port}});
    receiver->subscribe(client);
  }

  /// Asks for the data and withdrawals of each site in packets of their own: some brokers take few topics in
  /// one.
  void subscribe(mosquitto* broker) {
    asked.clear();
    for (const auto& site : sites)
      for (const char* what : {"data", "withdraw"})
        subscribe(broker, fmt::format("knothe/v1/{}/+/{}", site->name(), what));
  }

  void subscribe(mosquitto* broker, const std::string& topic) {
    int number = 0;
    const int failed = mosquitto_subscribe(broker, &number, topic.c_str(), 1);
    if (failed != MOSQ_ERR_SUCCESS)
      log_event("error", "nothing could be asked of the MQTT broker",
                {{"broker", host}, {"topic", topic}, {"reason", mosquitto_strerror(failed)}});
    else
      asked[number] = topic;
  }

  /// From now on data come, but for sites that the broker refuses (128: its rules say so); no error of MQTT
  /// 3.1.1 would tell.
  static void on_subscribe(mosquitto*, void* self, int number, int count, const int* granted) {
    const auto* receiver = static_cast<Implementation*>(self);
    const auto topic = receiver->asked.find(number);
    if (topic == receiver->asked.end() || count < 1) return;
    if (granted[0] > 2)
      log_event("error", "the MQTT broker refused a subscription",
                {{"broker", receiver->host}, {"topic", topic->second}, {"code", granted[0]}});
    else
      log_event("info", "subscribed at the MQTT broker",
                {{"broker", receiver->host}, {"topic", topic->second}, {"qos", granted[0]}});
  }

  static void on_disconnect(mosquitto*, void* self, int code) {
    auto* receiver = static_cast<Implementation*>(self);
    const auto lasted = std::chrono::steady_clock::now() - receiver->connected_at;
    const bool is_short = code != 0 && receiver->connected && lasted < k_longest_pause;
    receiver->short_connections = is_short ? receiver->short_connections + 1 : 0;
    if (receiver->short_connections == k_suspicious)
      log_event(
          "error",
          "the MQTT broker ends each connection soon: another service may use this client's name; if it "
          "has a copy of the file with it, delete the copy",
          {{"broker", receiver->host}, {"client", receiver->id}});
    if (code != 0 && receiver->connected)
      log_event("warning", "the MQTT broker is away",
                {{"broker", receiver->host}, {"reason", mosquitto_strerror(code)}});
  }

  static void on_message(mosquitto* client, void* self, const mosquitto_message* message) {
    auto* receiver = static_cast<Implementation*>(self);
    try {
      const auto answer = receiver->handle(*message);
      if (!answer) {
        // Stopping: not acknowledged. The library would acknowledge when we return, so the connection ends
        // first.
        ::shutdown(mosquitto_socket(client), SHUT_RDWR);
        mosquitto_disconnect(client);
        return;
      }
      std::string topic = message->topic;
      topic.replace(topic.rfind('/') + 1, std::string::npos, "answer");
      const std::string text = files::json_line(*answer);
      mosquitto_publish(client, nullptr, topic.c_str(), text.size(), text.data(), 0, false);
    } catch (const std::exception& error) {
      log_event("error", "a message could not be taken",
                {{"topic", message->topic}, {"reason", error.what()}});
    }
  }
};

MqttReceiver::MqttReceiver(const project::Project& project, std::vector<std::shared_ptr<ServedSite>> sites,
                           Metrics& metrics, Pulses& pulses)
    : implementation_(std::make_unique<Implementation>(std::move(sites), metrics, project)) {
  Implementation& i = *implementation_;
  const MqttBroker broker = mqtt_broker(project);
  i.host = broker.host, i.port = broker.port;
  // The same name at each start: the broker keeps for it what comes meanwhile.
  i.client = make_mqtt_client(project, i.id, true, &i);
  // Else the library sends the receipt before it calls us: what it writes then waits until we return.
  mosquitto_threaded_set(i.client.get(), true);
  mosquitto_connect_callback_set(i.client.get(), Implementation::on_connect);
  mosquitto_subscribe_callback_set(i.client.get(), Implementation::on_subscribe);
  mosquitto_disconnect_callback_set(i.client.get(), Implementation::on_disconnect);
  mosquitto_message_callback_set(i.client.get(), Implementation::on_message);
  i.pulse = pulses.add("the MQTT client", k_max_message);
  i.thread = std::thread([&i] { i.run(); });
}

MqttReceiver::~MqttReceiver() {
  implementation_->stopping = true;
  if (implementation_->thread.joinable()) implementation_->thread.join();
  implementation_->client.reset();
}

}  // namespace knothe::service
