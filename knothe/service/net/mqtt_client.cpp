#include "knothe/service/net/mqtt_client.hpp"

#include <fmt/format.h>
#include <mosquitto.h>

#include <charconv>
#include <fstream>
#include <random>

#include "knothe/base/error.hpp"
#include "knothe/files/atomic_file.hpp"

namespace knothe::service {
namespace {

std::string first_line(const std::string& path) {
  std::ifstream file(path);
  std::string line;
  if (!file || !std::getline(file, line))
    throw DataError(fmt::format("{}: the file with the MQTT password cannot be read, or is empty", path));
  return line;
}

}  // namespace

std::string passing_client_id() {
  std::random_device device;
  return fmt::format("knothe-{:08x}{:08x}", device(), device());
}

std::string durable_client_id(const std::string& journal) {
  const std::string path = journal + "-client";
  std::string id;
  if (std::ifstream(path) >> id && id.starts_with("knothe-") && id.size() <= 23) return id;  // MQTT 3.1.3.1
  id = passing_client_id();
  files::write_text_atomically(path, id + "\n");
  return id;
}

MqttBroker mqtt_broker(const project::Project& project) {
  const project::MqttOptions& options = project.serve.mqtt;
  const auto colon = options.broker.rfind(':');
  MqttBroker broker{options.broker.substr(0, colon)};
  if (colon != std::string::npos) {
    const char* end = options.broker.data() + options.broker.size();
    const auto parsed = std::from_chars(options.broker.data() + colon + 1, end, broker.port);
    if (parsed.ec != std::errc() || parsed.ptr != end || broker.port < 1 || broker.port > 65535)
      broker.host.clear();
  } else if (!options.ca.empty()) {
    broker.port = 8883;
  }
  if (broker.host.empty())
    throw project.error_at("serve.mqtt.broker",
                           fmt::format("\"{}\" is not HOST or HOST:PORT", options.broker));
  return broker;
}

std::shared_ptr<mosquitto> make_mqtt_client(const project::Project& project, const std::string& id,
                                            bool durable, void* self) {
  const project::MqttOptions& options = project.serve.mqtt;
  mosquitto_lib_init();  // counted, for the life of the program
  std::shared_ptr<mosquitto> client(mosquitto_new(id.c_str(), !durable, self), mosquitto_destroy);
  if (!client) throw IoError("the MQTT client could not be made");
  if (!options.user.empty()) {
    const std::string password = options.password.empty() ? "" : first_line(options.password);
    mosquitto_username_pw_set(client.get(), options.user.c_str(),
                              password.empty() ? nullptr : password.c_str());
  }
  if (!options.ca.empty()) {
    const int code = mosquitto_tls_set(client.get(), options.ca.c_str(), nullptr, nullptr, nullptr, nullptr);
    if (code != MOSQ_ERR_SUCCESS)
      throw DataError(
          fmt::format("{}: certificates cannot be used: {}", options.ca, mosquitto_strerror(code)));
  }
  return client;
}

}  // namespace knothe::service
