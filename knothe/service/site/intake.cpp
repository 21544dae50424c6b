#include "knothe/service/site/intake.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <future>
#include <limits>
#include <nlohmann/json.hpp>

#include "knothe/base/error.hpp"
#include "knothe/likelihood/data/time_matching.hpp"
#include "knothe/service/journal/noise_bytes.hpp"
#include "knothe/service/site/log.hpp"

namespace knothe::service {

Intake::Intake(std::shared_ptr<Site> site, std::function<bool(double)> wait)
    : site_(std::move(site)), wait_(std::move(wait)) {}

Measurement Intake::without_values(const PictureStamp& stamp) const {
  const std::size_t sensors = site_->setup().measurements.observation_count();
  Measurement datum;
  datum.key = stamp.key;
  datum.time = stamp.time;
  datum.values.assign(sensors, std::numeric_limits<double>::quiet_NaN());
  datum.status.assign(sensors, 1);
  return datum;
}

Measurement Intake::missing(const PictureStamp& stamp) {
  pictured_ = {{pictured_[1], step_of(stamp.time)}};
  site_->setup().pictures->skip();
  return without_values(stamp);
}

Intake::Measured Intake::measure(const PictureStamp& stamp, const files::Picture& picture) {
  Measured result{without_values(stamp), ""};
  Measurement& datum = result.datum;
  try {
    const auto step = step_of(stamp.time);
    Eigen::VectorXd increment = increment_to(step);
    pictured_ = {{pictured_[1], step}};
    const auto measured = site_->setup().pictures->measure(picture, stamp.name, std::move(increment));
    if (measured.picture.missing) result.trouble = measured.picture.message;
    std::copy_n(measured.values.data(), measured.values.size(),
                datum.values.begin());  // series come by others
    if (measured.noise)
      datum.noise = noise_bytes(project::with_series_noise(*measured.noise, site_->setup().measurements));
  } catch (const Error& error) {
    result.trouble = error.what();
  }
  for (std::size_t i = 0; i < datum.values.size(); ++i) datum.status[i] = std::isnan(datum.values[i]) ? 1 : 0;
  return result;
}

std::optional<std::size_t> Intake::step_of(double time) const {
  try {
    return likelihood::match_times({&time, 1}, site_->setup().problem.model->time, "the picture")[0];
  } catch (const DataError&) {
    return std::nullopt;  // it will be refused
  }
}

/// What the model says that displacements change by since the last picture, as `knothe assimilate` has it
/// when it correlates one picture ahead: by the parameters known after the picture before the last.
Eigen::VectorXd Intake::increment_to(std::optional<std::size_t> step) {
  const auto [before, last] = pictured_;
  if (!step || !last || !before) return {};
  while (!site_->settled() && !site_->lines().line(*before) && wait_(0.001)) {
  }
  const auto line = site_->lines().line(*before);
  if (!line) return {};
  const model::ObservedModel& model = *site_->setup().problem.model;
  const Eigen::VectorXd increment = model.predict(line->mean, *step) - model.predict(line->mean, *last);
  return increment.head(site_->setup().measurements.sensors.displacement_count());
}

Intake::StoreOutcome Intake::store(Measurement measurement, const std::string& name,
                                   std::optional<JournalFile> file) {
  const auto promise = std::make_shared<std::promise<JournalWriter::Answer>>();
  auto answer = promise->get_future();
  measurement.restores = Measurement::Restores::never;
  try {
    // What no request can name could never be withdrawn or released.
    const likelihood::DatumKey& key = measurement.key;
    (void)parse_json_key(Json{{"source", key.source}, {"session", key.session}, {"seq", key.seq}}.dump());
    site_->journal().ingest(
        std::move(measurement),
        [promise](const JournalWriter::Answer& stored) { promise->set_value(stored); }, std::move(file));
    const JournalWriter::Answer stored = answer.get();
    const auto* error = std::get_if<RequestError>(&stored);
    if (error == nullptr) return StoreOutcome::done;
    if (error->status() == 507 || error->status() == 503) return StoreOutcome::again;
    refuse(name, fmt::format("{}: {}", name, error->what()));
  } catch (const RequestError& error) {
    if (error.status() == 503) return StoreOutcome::again;
    refuse(name, fmt::format("{}: {}", name, error.what()));
  } catch (const Json::exception&) {
    refuse(name, fmt::format("{}: its name is not UTF-8", name));
  }
  return StoreOutcome::refused;
}

void Intake::refuse(const std::string& name, const std::string& reason) {
  log_event("warning", "a file was not taken", {{"site", site_->name()}, {"file", name}, {"reason", reason}});
  site_->alarms().raise(latest_step(), "warning", "sensors", reason);
}

std::size_t Intake::latest_step() const {
  const auto line = site_->lines().latest();
  return line ? line->step : 0;
}

}  // namespace knothe::service
