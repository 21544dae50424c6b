#include "knothe/project/serve_options.hpp"

#include <filesystem>

#include "knothe/project/project_values.hpp"

namespace knothe::project {

ServeOptions read_serve(Values& values, const std::string& path) {
  const std::filesystem::path folder = std::filesystem::path(path).parent_path();
  const auto resolved = [&](const std::string& file) {
    return file.empty() ? file : (folder / file).lexically_normal().string();
  };
  const auto seconds = [&](const std::string& key) {
    return values.has(key) ? std::optional<double>(values.number(key, 0)) : std::nullopt;
  };
  ServeOptions serve;
  serve.address = values.text("serve.address", serve.address);
  serve.port = static_cast<int>(values.integer("serve.port", serve.port));
  if (serve.port > 65535) values.complain("serve.port", "\"serve.port\" must be at most 65535");
  const std::string stem = std::filesystem::path(path).stem().string();
  serve.site = values.text("serve.site", stem);
  if (serve.site.empty() || serve.site.size() > 64 ||
      serve.site.find_first_not_of("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-_.") !=
          std::string::npos) {
    if (values.has("serve.site"))
      values.complain("serve.site", "\"serve.site\" must be 1 to 64 letters, digits, '-', '_' or '.'");
    serve.site = "site";
  }
  serve.journal = resolved(values.text("serve.journal", stem + ".journal"));
  for (const std::string& other : values.texts("serve.others")) serve.others.push_back(resolved(other));
  serve.window = static_cast<int>(values.integer("serve.window", serve.window));
  serve.period = seconds("serve.period");
  serve.budget = seconds("serve.budget");
  serve.stale_after = seconds("serve.stale_after");
  serve.watch_pictures = resolved(values.text("serve.watch_pictures", ""));
  serve.watch_csv = resolved(values.text("serve.watch_csv", ""));
  serve.first_picture = static_cast<long>(values.integer("serve.first_picture", serve.first_picture));
  serve.settle = values.number("serve.settle", serve.settle);
  serve.read_token = resolved(values.text("serve.read_token", ""));
  serve.ingest_token = resolved(values.text("serve.ingest_token", ""));
  values.at_least("serve.max_body", 1024);
  serve.max_body = static_cast<long>(values.integer("serve.max_body", serve.max_body));
  values.at_least("serve.max_connections", 1);
  serve.max_connections = static_cast<int>(values.integer("serve.max_connections", serve.max_connections));
  serve.timeout = values.number("serve.timeout", serve.timeout);
  serve.log = values.text("serve.log", serve.log);
  serve.mqtt = {values.text("serve.mqtt.broker", ""), values.text("serve.mqtt.user", ""),
                resolved(values.text("serve.mqtt.password", "")), resolved(values.text("serve.mqtt.ca", ""))};
  return serve;
}

}  // namespace knothe::project
