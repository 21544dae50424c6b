#include "knothe/project/serve_options.hpp"

#include <filesystem>

#include "knothe/project/option_section.hpp"

namespace knothe::project {
namespace {

using S = ServeOptions;

void add_data_options(Section<S>& s) {
  s.add("site", &S::site, "Name of the structure; without it, that of the project file.");
  s.add("others", &S::others, "Project files of further structures, served beside this one.", file);
  s.add("journal", &S::journal, "The journal; without it, NAME.journal beside NAME.toml.", file);
  s.add("window", &S::window,
        "By how many steps a datum may be late and still be assimilated; a later one is quarantined.");
  s.table("limits", "Limits of plausible values: a datum with a larger value is quarantined, with an alarm.");
  s.add("limits.*", &S::limits,
        "Largest absolute value that is assimilated, of `displacement` in m or of the series of that name in "
        "its unit; without it, 100 times the largest prediction of the model in its box.",
        positive);
  s.add("period", &S::period, "Time between two data, s; without it, the median of the last ones.", positive);
  s.add("budget", &S::budget, "Time that an update may take, s; without it, one period.", positive);
  s.add("stale_after", &S::stale_after,
        "Age of the last datum from which the state is STALE, s; without it, 5 periods.", positive);
  s.add("watch_pictures", &S::watch_pictures,
        "Folder to which a camera writes its pictures: each new one is measured against the references and "
        "assimilated. References are [dic] references, or the pictures there whose names begin with "
        "`reference`.",
        file);
  s.add("first_picture", &S::first_picture,
        "Number of the picture that belongs to the first time: the number in its name, if no `pictures.csv` "
        "gives the times; for a camera, the number of the frame, counted from 0.");
  s.add("watch_csv", &S::watch_csv,
        "Folder to which CSV files of measurements are written: each new one is assimilated.", file);
  s.add("settle", &S::settle,
        "Time for which a file in a watched folder must not have changed before it is read, s.", positive);
}

void add_connection_options(Section<S>& s) {
  s.add("read_token", &S::read_token, "File with the bearer token that reading needs.", file);
  s.add("ingest_token", &S::ingest_token, "File with the bearer token that sending measurements needs.",
        file);
  s.add("tokens", &S::tokens,
        "File with bearer tokens of people and machines, a line each: `NAME TOKEN`, or `NAME TOKEN read` for "
        "one that may only read. Requests are signed by that name, and reading needs a token too.",
        file);
  s.add("max_body", &S::max_body, "Largest body of a request, bytes.", at_least(1024));
  s.add("max_connections", &S::max_connections, "Connections open at a time.", at_least(1));
  s.add("timeout", &S::timeout, "Time that a request may take to arrive, s.", positive);
  s.choice("log", &S::log_steps, "events", "steps",
           "What is logged on stderr: starts, stops, errors and states, or every step too.");
  s.table("mqtt", "Measurements by MQTT too, at topic knothe/v1/SITE/SOURCE/data.");
  s.add("mqtt.broker", in(&S::mqtt, &MqttOptions::broker), "The broker, `\"HOST\"` or `\"HOST:PORT\"`.",
        required);
  s.add("mqtt.user", in(&S::mqtt, &MqttOptions::user), "User name at the broker.");
  s.add("mqtt.password", in(&S::mqtt, &MqttOptions::password), "File with the password.", file);
  s.add("mqtt.ca", in(&S::mqtt, &MqttOptions::ca),
        "File with the certificates that verify the broker; with it, TLS is used.", file);
}

void add_camera_options(Section<S>& s) {
  s.table("camera",
          "A GigE or USB3 camera (by Aravis) whose frames are measured as watched pictures are; without "
          "address and serial, the first that is found.");
  s.add("camera.address", in(&S::camera, &CameraOptions::address),
        "Network address of the camera, or its identifier as `arv-tool-0.8` prints it.");
  s.add("camera.serial", in(&S::camera, &CameraOptions::serial), "Serial number of the camera.");
  s.add("camera.frame_rate", in(&S::camera, &CameraOptions::frame_rate),
        "Frames per second; without it, the camera's setting. For a hardware trigger, the rate of its "
        "signal; without it, frames are counted.",
        positive);
  s.add("camera.exposure", in(&S::camera, &CameraOptions::exposure),
        "Exposure time, s; without it, the camera's setting.", positive);
  s.add("camera.gain", in(&S::camera, &CameraOptions::gain),
        "Gain in the camera's unit, mostly dB; without it, the camera's setting.", non_negative);
  s.add("camera.region", in(&S::camera, &CameraOptions::region),
        "Region of the sensor that is read, pixels; without it, the camera's setting.",
        of_shape("four integers, [x, y, width, height]"), no_default);
  s.add("camera.pixel_format", in(&S::camera, &CameraOptions::pixel_format),
        "Mono8, Mono10, Mono12, Mono14 or Mono16; without it, the camera's setting.");
  s.add("camera.packet_size", in(&S::camera, &CameraOptions::packet_size),
        "Bytes in a packet of a GigE camera: up to the network's MTU; without it, the camera's setting.",
        between(576, 65000));
  s.add("camera.trigger", in(&S::camera, &CameraOptions::trigger),
        "What makes the camera take a frame: its own clock, the service at `frame_rate`, or a line.");
  s.add("camera.trigger_line", in(&S::camera, &CameraOptions::trigger_line),
        "The line of a hardware trigger, as the camera calls it.");
  s.add("camera.keep", in(&S::camera, &CameraOptions::keep),
        "Folder in which frames are kept, with a table `pictures.csv` of their times; without it they are "
        "not kept. References may be there, as in `watch_pictures`.",
        file);
  s.add("camera.keep_format", in(&S::camera, &CameraOptions::keep_format),
        "Format of the frames that are kept, of 8 or 16 bits as the camera's.");
}

void add_notify_options(Section<S>& s) {
  s.table("notify", "Where alarms are sent; `knothe doctor FILE.toml --test-alarms` sends a test message.");
  s.add("notify.webhook", in(&S::notify, &NotifyOptions::webhook),
        "Address, http://HOST[:PORT]/PATH, to which each alarm is posted as JSON.");
  s.choice("notify.mqtt", in(&S::notify, &NotifyOptions::mqtt), "off", "on",
           "Whether alarms are published at knothe/v1/SITE/alarm of the broker of [serve.mqtt].");
  s.add("notify.mail", in(&S::notify, &NotifyOptions::mail), "Addresses that alarms are mailed to.");
  s.add("notify.mail_from", in(&S::notify, &NotifyOptions::mail_from),
        "Sender of the mail; without it, what sendmail writes.");
  s.add("notify.sendmail", in(&S::notify, &NotifyOptions::sendmail),
        "Program that takes the mail on its standard input, as sendmail -t -i does.", file);
  s.add("notify.mail_rest", in(&S::notify, &NotifyOptions::mail_rest),
        "Minimum time between two mails, s: alarms in between are mailed together.", positive);
  s.add("notify.severity", in(&S::notify, &NotifyOptions::severity), "The lowest severity that is sent.");
}

const Section<S>& serve_section() {
  static const Section<S> k_section(
      "serve", "The online service (`knothe serve`, docs/reference/service.md).", [](Section<S>& s) {
        s.add("address", &S::address, "Address to listen at; anything but loopback needs both tokens.");
        s.add("port", &S::port, "Port to listen at, 0 for a free one; `--port` overrides it.",
              at_most(65535));
        add_data_options(s);
        add_camera_options(s);
        add_connection_options(s);
        add_notify_options(s);
      });
  return k_section;
}

bool is_name(const std::string& site) {
  return !site.empty() && site.size() <= 64 &&
         site.find_first_not_of("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-_.") ==
             std::string::npos;
}

void check_camera(Values& values, const ServeOptions& serve) {
  const CameraOptions& camera = serve.camera;
  const auto complain_if = [&](bool when, const std::string& key, const std::string& text) {
    if (when) values.complain("serve.camera." + key, text);
  };
  complain_if(!camera.address.empty() && !camera.serial.empty(), "serial",
              "[serve.camera] has both \"address\" and \"serial\": give one");
  complain_if(
      !camera.region.empty() && (camera.region.size() != 4 || camera.region[2] * camera.region[3] == 0),
      "region", "\"serve.camera.region\" must be four integers, [x, y, width, height], with a positive size");
  complain_if(camera.trigger == CameraTrigger::software && !camera.frame_rate, "trigger",
              "[serve.camera]: a software trigger needs \"frame_rate\", at which the service triggers, Hz");
  if (camera.wanted && !serve.watch_pictures.empty())
    values.complain(
        "serve.watch_pictures",
        "\"serve.watch_pictures\" and [serve.camera] both say where pictures come from: give one");
}

}  // namespace

std::vector<Option> serve_option_table() {
  return joined(serve_section());
}

ServeOptions read_serve(Values& values, const std::string& path) {
  const std::string stem = std::filesystem::path(path).stem().string();
  ServeOptions serve = serve_section().read(values);
  serve.camera.wanted = values.has_table("serve.camera");
  check_camera(values, serve);
  if (serve.site.empty()) serve.site = stem;
  if (!is_name(serve.site)) {
    if (values.has("serve.site"))
      values.complain("serve.site", "\"serve.site\" must be 1 to 64 letters, digits, '-', '_' or '.'");
    serve.site = "site";
  }
  if (serve.journal.empty()) serve.journal = values.resolved(stem + ".journal");
  return serve;
}

}  // namespace knothe::project
