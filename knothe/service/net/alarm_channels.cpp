#include "knothe/service/net/alarm_channels.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <mosquitto.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstring>
#include <nlohmann/json.hpp>
#include <thread>

#include "knothe/base/error.hpp"
#include "knothe/base/monotonic_time.hpp"
#include "knothe/files/json_line.hpp"
#include "knothe/model/forward/http_connection.hpp"
#include "knothe/service/net/mqtt_client.hpp"

extern char** environ;

namespace knothe::service {
namespace {

constexpr double k_patience = 10;  // s, for the other side's word
constexpr std::chrono::milliseconds k_glance{20};

class Webhook final : public AlarmChannel {
 public:
  explicit Webhook(const std::string& url)
      : address_(model::HttpAddress::parse(url)), slash_(url.ends_with("/") || address_.base.empty()) {}
  [[nodiscard]] std::string name() const override { return "webhook"; }
  std::size_t send(std::span<const Json> alarms, const std::atomic<bool>&) override {
    model::HttpConnection connection(address_, k_patience, "webhook");
    const int status = connection.post_for_status(slash_ ? "/" : "", files::json_line(alarms.front()));
    if (status < 200 || status > 299)
      throw DataError(fmt::format("{}:{} answered {}", address_.host, address_.port, status));
    return 1;
  }

 private:
  model::HttpAddress address_;
  bool slash_;
};

/// A connection for each alarm: they are rare, and it is then known whether the broker has it.
class MqttTopic final : public AlarmChannel {
 public:
  explicit MqttTopic(const project::Project& project) : project_(project), broker_(mqtt_broker(project)) {}
  [[nodiscard]] std::string name() const override { return "mqtt"; }
  std::size_t send(std::span<const Json> alarms, const std::atomic<bool>& stopping) override {
    topic_ = fmt::format("knothe/v1/{}/alarm", project_.serve.site);
    text_ = files::json_line(alarms.front());
    sent_ = false;
    refused_.clear();
    const auto client = make_mqtt_client(project_, passing_client_id(), false, this);
    mosquitto_connect_callback_set(client.get(), on_connect);
    mosquitto_publish_callback_set(
        client.get(), [](mosquitto*, void* self, int) { static_cast<MqttTopic*>(self)->sent_ = true; });
    int code = mosquitto_connect_async(client.get(), broker_.host.c_str(), broker_.port, 30);
    const auto start = monotonic_now();
    while (code == MOSQ_ERR_SUCCESS && !sent_ && refused_.empty() && seconds_since(start) < k_patience &&
           !stopping)
      code = mosquitto_loop(client.get(), 100, 1);
    mosquitto_disconnect(client.get());
    if (sent_) return 1;
    const std::string why = !refused_.empty()          ? refused_
                            : code == MOSQ_ERR_ERRNO   ? std::strerror(errno)
                            : code != MOSQ_ERR_SUCCESS ? mosquitto_strerror(code)
                                                       : "no answer";
    throw DataError(fmt::format("the MQTT broker {}:{}: {}", broker_.host, broker_.port, why));
  }

 private:
  static void on_connect(mosquitto* client, void* self, int code) {
    auto& topic = *static_cast<MqttTopic*>(self);
    if (code != 0) topic.refused_ = mosquitto_connack_string(code);
    if (code != 0) return;
    const int failed = mosquitto_publish(client, nullptr, topic.topic_.c_str(), topic.text_.size(),
                                         topic.text_.data(), 1, false);
    if (failed != MOSQ_ERR_SUCCESS) topic.refused_ = mosquitto_strerror(failed);
  }

  const project::Project& project_;
  MqttBroker broker_;
  std::string topic_, text_, refused_;
  bool sent_ = false;
};

/// `program` with `text` on its standard input, and nothing else open. What it ends with; −1 where it was
/// given up.
int run_program(const std::vector<std::string>& words, const std::string& text) {
  int ends[2] = {-1, -1};
  if (::pipe2(ends, O_CLOEXEC) != 0) throw system_error("could not make a pipe for", words[0]);
  // A pipe that holds all of it: a program that does not read cannot hold us up.
  (void)::fcntl(ends[1], F_SETPIPE_SZ, static_cast<int>(text.size() + 1));
  (void)::fcntl(ends[1], F_SETFL, O_NONBLOCK);
  const bool whole = ::write(ends[1], text.data(), text.size()) == std::ssize(text);
  ::close(ends[1]);
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_adddup2(&actions, ends[0], 0);
  posix_spawn_file_actions_addopen(&actions, 1, "/dev/null", O_WRONLY, 0);
  posix_spawn_file_actions_addopen(&actions, 2, "/dev/null", O_WRONLY, 0);
  posix_spawn_file_actions_addclosefrom_np(&actions, 3);
  std::vector<char*> arguments;
  for (const std::string& word : words) arguments.push_back(const_cast<char*>(word.c_str()));
  arguments.push_back(nullptr);
  pid_t child = 0;
  const int failed =
      whole ? ::posix_spawn(&child, words[0].c_str(), &actions, nullptr, arguments.data(), environ) : ENOBUFS;
  posix_spawn_file_actions_destroy(&actions);
  ::close(ends[0]);
  if (failed != 0) throw IoError(fmt::format("{} could not be run: {}", words[0], std::strerror(failed)));
  const auto start = monotonic_now();
  int status = 0;
  while (::waitpid(child, &status, WNOHANG) == 0) {
    if (seconds_since(start) > k_patience) {
      ::kill(child, SIGKILL);
      ::waitpid(child, &status, 0);
      return -1;
    }
    std::this_thread::sleep_for(k_glance);
  }
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

class Mail final : public AlarmChannel {
 public:
  explicit Mail(const project::ServeOptions& options) : options_(options.notify), site_(options.site) {}
  [[nodiscard]] std::string name() const override { return "mail"; }
  [[nodiscard]] std::chrono::milliseconds rest() const override {
    return std::chrono::milliseconds(static_cast<std::int64_t>(1e3 * options_.mail_rest));
  }
  std::size_t send(std::span<const Json> alarms, const std::atomic<bool>&) override {
    const int status = run_program({options_.sendmail, "-t", "-i"}, message(alarms));
    if (status != 0)
      throw IoError(status < 0 ? fmt::format("{} did not end within {} s", options_.sendmail, k_patience)
                               : fmt::format("{} ended with {}", options_.sendmail, status));
    return alarms.size();
  }

 private:
  [[nodiscard]] std::string message(std::span<const Json> alarms) const {
    const bool test = alarms.front().at("test").get<bool>();
    std::string text;
    if (!options_.mail_from.empty()) text += fmt::format("From: {}\n", options_.mail_from);
    text += fmt::format("To: {}\nSubject: knothe {}: {}\n", fmt::join(options_.mail, ", "), site_,
                        test                ? "test of the alarms"
                        : alarms.size() > 1 ? fmt::format("{} alarms", alarms.size())
                                            : alarms.front().at("alarm").at("severity").get<std::string>());
    text +=
        "MIME-Version: 1.0\nContent-Type: text/plain; charset=utf-8\nContent-Transfer-Encoding: 8bit\n"
        "Auto-Submitted: auto-generated\n\n";
    for (const Json& one : alarms) {
      const Json& alarm = one.at("alarm");
      const std::string of_test =
          one.contains("test_name") ? fmt::format(" of test {}", one.at("test_name").get<std::string>()) : "";
      text += fmt::format("{} ({}) at step {}{}: {}\n", alarm.at("severity").get<std::string>(),
                          alarm.at("kind").get<std::string>(), alarm.at("step").get<std::int64_t>(), of_test,
                          alarm.at("message").get<std::string>());
    }
    return text;
  }

  const project::NotifyOptions& options_;
  std::string site_;
};

}  // namespace

std::vector<std::unique_ptr<AlarmChannel>> alarm_channels(const project::Project& project) {
  const project::NotifyOptions& options = project.serve.notify;
  std::vector<std::unique_ptr<AlarmChannel>> channels;
  try {
    if (!options.webhook.empty()) channels.push_back(std::make_unique<Webhook>(options.webhook));
  } catch (const UsageError& error) {
    throw project.error_at("serve.notify.webhook", error.what());
  }
  if (options.mqtt && project.serve.mqtt.broker.empty())
    throw project.error_at("serve.notify.mqtt", "there is no broker: [serve.mqtt] broker");
  if (options.mqtt) channels.push_back(std::make_unique<MqttTopic>(project));
  for (const std::string& address : options.mail)
    if (address.find_first_of("\r\n,;<>") != std::string::npos || address.find('@') == std::string::npos)
      throw project.error_at("serve.notify.mail", fmt::format("\"{}\" is not an address", address));
  if (options.mail_from.find_first_of("\r\n") != std::string::npos)
    throw project.error_at("serve.notify.mail_from", "it has more than one line");
  if (!options.mail.empty()) channels.push_back(std::make_unique<Mail>(project.serve));
  return channels;
}

}  // namespace knothe::service
