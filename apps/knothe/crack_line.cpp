#include "apps/knothe/crack_line.hpp"

#include <fmt/format.h>

namespace knothe::commands {

nlohmann::ordered_json crack_line(const imaging::CrackMeasurement& crack,
                                  const std::optional<imaging::PictureFrame>& frame) {
  nlohmann::ordered_json line = {{"found", crack.found}, {"log_evidence", crack.log_evidence}};
  if (!crack.found) {
    line["message"] = crack.message;
    return line;
  }
  line["tip_in_view"] = crack.tip_in_view;
  line["length"] = crack.length, line["length_std"] = crack.length_std,
  line["length_interval"] = crack.interval;
  line["others"] = crack.others;
  if (!crack.message.empty()) line["message"] = crack.message;
  line["tip"] = crack.tip, line["mouth"] = crack.mouth, line["mouth_opening"] = crack.mouth_opening;
  if (frame) {
    const double scale = frame->scale();
    line["length_m"] = scale * crack.length, line["length_std_m"] = scale * crack.length_std;
    line["length_interval_m"] = {scale * crack.interval[0], scale * crack.interval[1]};
    line["tip_m"] = frame->model_point(crack.tip[0], crack.tip[1]);
  }
  return line;
}

std::string crack_text(const imaging::CrackMeasurement& crack,
                       const std::optional<imaging::PictureFrame>& frame) {
  if (!crack.found) return "no crack: " + crack.message;
  const double scale = frame ? 1e3 * frame->scale() : 1;
  const std::string others = crack.message.empty() ? "" : "; " + crack.message;
  const char* unit = frame ? "mm" : "px";
  if (!crack.tip_in_view)
    return fmt::format("crack right through, at least {:.4g} {} long, from ({:.0f}, {:.0f}) px",
                       scale * crack.length, unit, crack.mouth[0], crack.mouth[1]) +
           others;
  return fmt::format("crack {:.4g} ± {:.2g} {} long, tip at ({:.0f}, {:.0f}) px, mouth open by {:.3g} {}",
                     scale * crack.length, scale * crack.length_std, unit, crack.tip[0], crack.tip[1],
                     scale * crack.mouth_opening, unit) +
         others;
}

}  // namespace knothe::commands
