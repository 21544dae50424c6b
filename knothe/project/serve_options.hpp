#pragma once
/// @file The table [serve] of a project file: the online service.
#include <array>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "knothe/base/enum_names.hpp"
#include "knothe/project/camera_options.hpp"

namespace knothe::project {

struct Values;

/// [serve.mqtt]
struct MqttOptions {
  std::string broker;  ///< HOST or HOST:PORT; empty: no MQTT
  std::string user;
  std::string password, ca;  ///< files, resolved
};

/// How much an alarm matters; the order counts.
enum class Severity { info, warning, alarm };
constexpr auto names_of(Severity) {
  return std::to_array<Named<Severity>>(
      {{Severity::info, "info"}, {Severity::warning, "warning"}, {Severity::alarm, "alarm"}});
}

/// [serve.notify]
struct NotifyOptions {
  std::string webhook;  ///< http://…; empty: none
  bool mqtt = false;
  std::vector<std::string> mail;  ///< addresses; empty: none
  std::string mail_from;
  std::string sendmail = "/usr/sbin/sendmail";
  double mail_rest = 60;                  ///< s
  Severity severity = Severity::warning;  ///< and above
};

struct ServeOptions {
  std::string address = "127.0.0.1";
  int port = 8080;
  std::string journal;              ///< resolved
  std::string site;                 ///< name of this project's structure
  std::vector<std::string> others;  ///< project files of further sites, resolved
  int window = 3;
  /// Largest |value| that is assimilated: of "displacement", m, and of series by name.
  std::map<std::string, double> limits;
  std::optional<double> period, budget, stale_after;  ///< s
  std::string watch_pictures, watch_csv;              ///< folders, resolved; empty: none
  long first_picture = 0;
  double settle = 0.5;                           ///< s
  std::string read_token, ingest_token, tokens;  ///< files, resolved; empty: none
  long max_body = 8 << 20;                       ///< bytes
  int max_connections = 1024;
  double timeout = 30;     ///< s
  bool log_steps = false;  ///< else starts, stops, errors and states alone
  MqttOptions mqtt;
  NotifyOptions notify;
  CameraOptions camera;

  /// Whether data are pictures that are still to come, in a folder or from a camera.
  [[nodiscard]] bool takes_pictures() const { return !watch_pictures.empty() || camera.wanted; }
  /// Where those pictures are, or are kept; empty: nowhere.
  [[nodiscard]] const std::string& picture_folder() const {
    return watch_pictures.empty() ? camera.keep : watch_pictures;
  }
};

/// The table [serve]. `path` is the project file's: its stem is the site's name unless the file says
/// otherwise.
[[nodiscard]] ServeOptions read_serve(Values& values, const std::string& path);

}  // namespace knothe::project
