#include "knothe/project/option_table.hpp"

namespace knothe::project {

using K = ValueKind;

std::vector<Option> serve_option_table() {
  return {
      {"serve", K::table, "", "The online service (`knothe serve`, docs/service.md).", {}},
      {"serve.address",
       K::text,
       "127.0.0.1",
       "Address to listen at; anything but loopback needs both tokens.",
       {}},
      {"serve.port", K::integer, "8080", "Port to listen at, 0 for a free one; `--port` overrides it.", {}},
      {"serve.site", K::text, "", "Name of the structure; without it, that of the project file.", {}},
      {"serve.others", K::texts, "[]", "Project files of further structures, served beside this one.", {}},
      {"serve.journal", K::path, "", "The journal; without it, NAME.journal beside NAME.toml.", {}},
      {"serve.window",
       K::integer,
       "3",
       "By how many places a datum may come late and still be put in its place; later, it is quarantined.",
       {}},
      {"serve.period",
       K::positive,
       "",
       "Time between two data, s; without it, the median of the last ones.",
       {}},
      {"serve.budget",
       K::positive,
       "",
       "Time that an update may take, s; without it, a tenth of the period.",
       {}},
      {"serve.stale_after",
       K::positive,
       "",
       "Age of the last datum from which the state is STALE, s; without it, 5 periods.",
       {}},
      {"serve.read_token", K::path, "", "File with the bearer token that reading needs.", {}},
      {"serve.ingest_token", K::path, "", "File with the bearer token that sending measurements needs.", {}},
      {"serve.max_body", K::integer, "8388608", "Largest body of a request, bytes.", {}},
      {"serve.max_connections", K::integer, "1024", "Connections open at a time.", {}},
      {"serve.timeout", K::positive, "30", "Time that a request may take to arrive, s.", {}},
      {"serve.log",
       K::choice,
       "events",
       "What is logged on stderr: starts, stops, errors and states, or every step too.",
       {"events", "steps"}},
      {"serve.mqtt", K::table, "", "Measurements by MQTT too, at topic knothe/v1/SITE/SOURCE/data.", {}},
      {"serve.mqtt.broker", K::text, "", "The broker, `\"HOST\"` or `\"HOST:PORT\"`.", {}, true},
      {"serve.mqtt.user", K::text, "", "User name at the broker.", {}},
      {"serve.mqtt.password", K::path, "", "File with the password.", {}},
      {"serve.mqtt.ca",
       K::path,
       "",
       "File with the certificates that the broker is checked by; with it, TLS is spoken.",
       {}},
  };
}

}  // namespace knothe::project
