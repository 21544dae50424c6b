#pragma once
/// @file Measurements by MQTT (libmosquitto): topic knothe/v1/SITE/SOURCE/data, QoS 1, the JSON of
/// `POST /v1/measurements`. No mosquitto in this header.
#include <memory>
#include <vector>

#include "knothe/service/site/served_site.hpp"

namespace knothe::service {

/// A connection to a broker, kept up by a thread of its own. A message is acknowledged to the broker (PUBACK)
/// only after its datum is on disk, or was refused for what it is; while the disk is full it is not, and
/// comes again. The session is durable: what is published while the service is down comes at its next start.
/// What was refused is kept in JOURNAL-refused.jsonl, and raises an alarm, before it is acknowledged.
/// What became of a message is published at knothe/v1/SITE/SOURCE/answer. A datum is withdrawn by the JSON of
/// `POST /v1/withdraw` at knothe/v1/SITE/SOURCE/withdraw.
class MqttReceiver {
 public:
  /// Begins to connect. ProjectError for an address that is none, DataError for a file that cannot be used.
  MqttReceiver(const project::Project& project, std::vector<std::shared_ptr<ServedSite>> sites,
               Metrics& metrics, Pulses& pulses);
  ~MqttReceiver();

 private:
  struct Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace knothe::service
