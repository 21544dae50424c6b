#include "knothe/record/assimilation_output.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "knothe/base/console.hpp"
#include "knothe/base/text.hpp"
#include "knothe/files/json_line.hpp"
#include "knothe/imaging/series/camera_drift.hpp"
#include "knothe/record/forecast_text.hpp"
#include "knothe/record/number_text.hpp"
#include "knothe/record/picture_record.hpp"
#include "knothe/record/step_record.hpp"

namespace knothe::record {
namespace {

/// What a step's line says of its picture; the time line begins where the picture is in memory.
void add_picture(nlohmann::ordered_json& line, const project::PictureDatum& datum,
                 const project::PictureMeasurements& pictures) {
  const imaging::PictureResult& r = datum.picture;
  // The camera's motions are no data that are missing.
  line["missing"] = line["missing"].get<int>() - imaging::drift_modes(pictures.series().options().drift);
  line["picture"] = {{"name", r.picture},
                     {"missing", r.missing},
                     {"iterations", r.correlation.iterations},
                     {"start", r.correlation.searched    ? "search"
                               : r.correlation.predicted ? "model"
                                                         : "last"},
                     {"residual_rms", r.correlation.residual_rms},
                     {"elements_rejected", r.correlation.elements_rejected}};
  if (r.missing) line["picture"]["message"] = r.message;
  if (r.crack) line["picture"]["crack"] = crack_record(*r.crack, pictures.frame());
  auto& elapsed = line["elapsed_us"];
  elapsed["correlation"] = datum.correlation_us;
  elapsed["precision"] = datum.precision_us;
  double total = elapsed["total"].get<double>() + datum.correlation_us + datum.precision_us;
  elapsed["wait"] = datum.wait_us;
  if (r.crack) elapsed["crack"] = 1e3 * r.crack_ms, total += 1e3 * r.crack_ms;
  elapsed["total"] = total;
}

}  // namespace

std::string shown_verdict(const assimilation::Verdict& verdict, std::FILE* stream) {
  const std::string text = verdict_text(verdict);
  const std::size_t end = std::min(text.find('\n'), text.size());
  using Level = assimilation::VerdictLevel;
  const Colour colour = verdict.level == Level::ok        ? Colour::green
                        : verdict.level == Level::caution ? Colour::yellow
                                                          : Colour::red;
  return coloured(text.substr(0, end), colour, stream) + text.substr(end);
}

AssimilationOutput::AssimilationOutput(bool json, std::vector<model::Axis> axes, std::size_t steps)
    : json_(json), live_(!json && isatty(STDERR_FILENO) == 1), axes_(std::move(axes)), steps_(steps) {}

AssimilationOutput::~AssimilationOutput() {
  if (live_) std::fputs("\r\033[K", stderr);
}

void AssimilationOutput::show(const assimilation::StepResult& result,
                              const std::optional<project::PictureDatum>& picture,
                              const project::PictureMeasurements* pictures) {
  ++shown_;
  if (!result.update.trusted) untrusted_.push_back(result.update.step);
  run_.add(result.update.verdict);
  models_ = result.models;
  forecasts_ = result.forecasts;
  decision_ = result.decision;
  if (picture && picture->picture.missing) tell(picture->picture.message);
  tell_sensors(result);
  if (json_) print_record(result, picture, pictures);
  if (!result.update.notice.empty())
    tell(fmt::format("step {}: {}", result.update.step, result.update.notice));
  const double picture_us = picture ? picture->correlation_us + picture->precision_us : 0;
  tell_verdict(result.update);
  if (!json_)
    print_text(result,
               picture_us + result.update.elapsed_us.total() + result.forecast_us + result.decision_us);
}

/// A line that stays, in place of the one that is shown meanwhile.
void AssimilationOutput::tell(const std::string& line) const {
  fmt::print(stderr, "{}{}\n", live_ ? "\r\033[K" : "", for_people(line, stderr, 2));
}

/// The verdict, where it is another than at the step before.
void AssimilationOutput::tell_verdict(const assimilation::UpdateResult& update) {
  if (update.verdict.level == told_level_) return;
  told_level_ = update.verdict.level;
  tell(fmt::format("step {}: {}", update.step, shown_verdict(update.verdict, stderr)));
}

/// What a person should know of the sensors, once for each that stops.
void AssimilationOutput::tell_sensors(const assimilation::StepResult& result) {
  for (const auto& [sensors, what] :
       {std::pair(&result.stuck, "is stuck: the same value at five steps while the model moves"),
        std::pair(&result.absent, "is silent: no value at five steps")}) {
    for (const Eigen::Index i : *sensors)
      if (told_.insert(i).second) tell(fmt::format("step {}: sensor {} {}", result.update.step, i, what));
  }
}

void AssimilationOutput::print_record(const assimilation::StepResult& result,
                                      const std::optional<project::PictureDatum>& picture,
                                      const project::PictureMeasurements* pictures) const {
  auto record = step_record(result, axes_);
  if (picture) add_picture(record, *picture, *pictures);
  fmt::print("{}\n", files::json_line(record));
  std::fflush(stdout);
}

/// The line a person sees while it happens, and a row of the table that stays.
void AssimilationOutput::print_text(const assimilation::StepResult& result, double total_us) const {
  const assimilation::UpdateResult& r = result.update;
  const Precision precision(r.verdict);
  const bool is_ok = r.verdict.level == assimilation::VerdictLevel::ok;
  std::string text = fmt::format("step {:3}", r.step);
  for (std::size_t k = 0; k < axes_.size(); ++k) {
    const Eigen::Index i = k;
    text += fmt::format("  {} {}", axes_[k].name,
                        value_text(r.mean[i], precision.of_parameter(std::sqrt(r.covariance(i, i)), i),
                                   axes_[k].reference == 1 ? axes_[k].units : "1", precision));
  }
  if (r.map_order > 0) text += fmt::format("  order {}", r.map_order);
  if (!result.forecasts.empty()) {
    const assimilation::NamedForecast& first = result.forecasts[0];
    text += fmt::format(
        "  {} {}", first.name,
        value_text(first.forecast.mean, precision.of_forecast(first.forecast.std), first.units, precision));
  }
  if (result.decision) text += fmt::format("  next: {}", action_text(*result.decision));
  text += fmt::format("  {:.0f} µs", total_us);
  if (!is_ok) text += fmt::format("  {}", to_text(r.verdict.level));
  if (live_) fmt::print(stderr, "\r\033[K{}", cut_to_terminal(text, stderr));
  if ((r.step + 1) % 10 != 0 && shown_ != steps_) return;
  if (live_) std::fputs("\r\033[K", stderr);
  text = for_people(text, stdout, 2);
  fmt::print("{}\n", is_ok ? text : coloured(text, Colour::grey, stdout));
  std::fflush(stdout);
}

void AssimilationOutput::report_refinement(const project::Refinement& refinement) {
  run_.forget_model();
  const project::PosteriorMove& move = refinement.whole_move();
  tell(
      fmt::format("step {}: the full-order model was run ({} so far): the reduced model's error was {:.2g} "
                  "standard deviations; refined model: {}",
                  shown_, counted(refinement.runs(), "run"), move.mean, refinement.file()));
}

/// The input whose error would move a parameter most.
void AssimilationOutput::tell_largest_shift() const {
  double largest = 0;
  std::string text;
  for (const assimilation::InputShift& error : shifts_) {
    for (Eigen::Index a = 0; a < error.in_std.size(); ++a) {
      if (std::abs(error.in_std[a]) <= largest) continue;
      largest = std::abs(error.in_std[a]);
      text = fmt::format("{} % in {} would shift {} by {:.2g} standard deviations",
                         plain(100 * error.relative), error.name, axes_[a].name, largest);
    }
  }
  if (!text.empty())
    fmt::print("{}\n",
               for_people(fmt::format("not in these intervals: {} (report: all inputs)", text), stdout, 2));
}

void AssimilationOutput::finish(double elapsed_s, const std::string& results_folder,
                                const model::Loading& loading) {
  if (json_) {
    const nlohmann::ordered_json last = {{"done", true},
                                         {"steps", shown_},
                                         {"verdict", verdict_record(verdict())},
                                         {"untrusted", untrusted_},
                                         {"elapsed_s", elapsed_s}};
    fmt::print("{}\n", files::json_line(last));
    return;
  }
  const std::string trust = untrusted_.empty() ? "computation trusted"
                                               : fmt::format("computation not trusted at {} {}",
                                                             untrusted_.size() == 1 ? "step" : "steps",
                                                             fmt::join(untrusted_, ", "));
  fmt::print("{} in {:.2f} s, {}; results in {}\n", counted(shown_, "step"), elapsed_s, trust,
             results_folder);
  const assimilation::Verdict of_run = verdict();
  const bool is_ok = of_run.level == assimilation::VerdictLevel::ok;
  for (const assimilation::NamedForecast& forecast : forecasts_) {
    const std::string text = for_people(forecast_text(forecast, loading, Precision(of_run)), stdout, 2);
    fmt::print("{}\n", is_ok ? text : coloured(text, Colour::grey, stdout));
  }
  if (!models_.empty()) fmt::print("{}\n", assimilation::comparison_text(models_));
  if (decision_)
    fmt::print("{}\n", for_people(fmt::format("next: {}: {}", action_text(*decision_), decision_->message),
                                  stdout, 2));
  tell_largest_shift();
  fmt::print("{}\n", for_people(shown_verdict(of_run, stdout), stdout, 2));
}

}  // namespace knothe::record
