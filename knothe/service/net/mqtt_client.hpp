#pragma once
/// @file A client of the broker that the table [serve.mqtt] names. Private to this room.
#include <memory>
#include <string>

#include "knothe/project/project_file.hpp"

struct mosquitto;

namespace knothe::service {

struct MqttBroker {
  std::string host;
  int port = 1883;
};

/// ProjectError for an address that is none.
[[nodiscard]] MqttBroker mqtt_broker(const project::Project& project);

/// The same at each start, and of no other service, wherever its journal lies: kept beside that, in
/// NAME-client. IoError where it cannot be.
[[nodiscard]] std::string durable_client_id(const std::string& journal);
/// Another each time.
[[nodiscard]] std::string passing_client_id();

/// A client that is not connected yet, with user, password and certificates of the project. `durable`: the
/// broker keeps for a client of that id what comes while it is away. `self` is given to callbacks. DataError
/// for a file that cannot be used, IoError.
[[nodiscard]] std::shared_ptr<mosquitto> make_mqtt_client(const project::Project& project,
                                                          const std::string& id, bool durable, void* self);

}  // namespace knothe::service
