#include "knothe/record/picture_record.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "knothe/imaging/correlation/correlation_noise.hpp"

namespace knothe::record {
namespace {

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

}  // namespace

nlohmann::ordered_json crack_record(const imaging::CrackMeasurement& crack,
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

nlohmann::ordered_json picture_record(const imaging::PictureSeries& series, const imaging::PictureResult& r,
                                      double noise_std, const std::optional<imaging::PictureFrame>& frame) {
  const auto& c = r.correlation;
  nlohmann::ordered_json line = {{"picture", r.picture},
                                 {"iterations", c.iterations},
                                 {"converged", c.converged},
                                 {"residual_rms", c.residual_rms},
                                 {"nodes", series.correlation().mesh().node_count()},
                                 {"elements_rejected", c.elements_rejected},
                                 {"elapsed_ms", r.elapsed_ms},
                                 {"noise_std_px", noise_std},
                                 {"elements", series.correlation().mesh().element_count()},
                                 {"noise_grey_levels", r.noise},
                                 {"gain", c.gain},
                                 {"offset", c.offset},
                                 {"searched", c.searched},
                                 {"missing", r.missing}};
  if (r.missing) line["message"] = r.message;
  if (!r.reference.empty()) line["reference"] = r.reference;
  if (r.crack) line["crack"] = crack_record(*r.crack, frame);
  return line;
}

std::string picture_text(const imaging::PictureResult& r, double noise_std,
                         const std::optional<imaging::PictureFrame>& frame) {
  if (r.missing) return "";
  const auto& c = r.correlation;
  std::string text = fmt::format("{}: {} iterations, residual {:.2f} grey levels, noise {:.4f} px", r.picture,
                                 c.iterations, c.residual_rms, noise_std);
  if (frame) text += fmt::format(" ({:.2f} µm)", noise_std * frame->scale() * 1e6);
  if (c.elements_rejected > 0)
    text += fmt::format(", {} elements without a measurement", c.elements_rejected);
  if (!r.reference.empty()) text += fmt::format(", measured against {} (reference replaced)", r.reference);
  text += fmt::format(", {:.0f} ms", r.elapsed_ms);
  return r.crack ? text + "\n    " + crack_text(*r.crack, frame) : text;
}

namespace {

/// Mean standard deviation of x, y, z, m, of `std`, which is 0 where nothing was measured.
std::array<double, 3> mean_deviation(const imaging::SurfaceMotion& motion, const Eigen::VectorXd& std) {
  std::array<double, 3> mean{};
  const double nodes = std::max<double>(1, std::count(motion.measured.begin(), motion.measured.end(), 1));
  for (Index i = 0; i < std.size(); ++i) mean[i % 3] += std[i] / nodes;
  return mean;
}

}  // namespace

nlohmann::ordered_json stereo_record(const imaging::StereoSeries& series, const imaging::StereoResult& r) {
  int iterations = 0;
  double squares = 0, noise = 0;
  const double cameras = r.pictures.size();
  std::vector<std::string> names;
  for (Index c = 0; c < std::ssize(r.pictures); ++c) {
    const auto& picture = r.pictures[c];
    names.push_back(picture.picture);
    iterations = std::max(iterations, picture.correlation.iterations);
    squares += picture.correlation.residual_rms * picture.correlation.residual_rms / cameras;
    if (!r.missing) noise += imaging::mean_std(series.camera(c).displacement_std(picture)) / cameras;
  }
  const std::vector<char> valid = series.valid_elements(r);
  nlohmann::ordered_json line = {{"picture", names.front()},
                                 {"pictures", names},
                                 {"iterations", iterations},
                                 {"converged", !r.missing},
                                 {"residual_rms", std::sqrt(squares)},
                                 {"nodes", series.surface().points.cols()},
                                 {"elements_rejected", std::count(valid.begin(), valid.end(), 0)},
                                 {"elapsed_ms", r.elapsed_ms},
                                 {"noise_std_px", noise},
                                 {"surface_epipolar_rms_px", series.surface().epipolar_rms},
                                 {"missing", r.missing}};
  if (r.missing) {
    line["message"] = r.message;
    return line;
  }
  line["noise_std_m"] = mean_deviation(r.motion, r.motion.std);
  if (r.calibration.cols() > 0) line["calibration_std_m"] = mean_deviation(r.motion, r.calibration_std());
  line["epipolar_rms_px"] = r.motion.epipolar_rms;
  line["chi_square_per_value"] = r.motion.chi_square / r.motion.redundancy;
  return line;
}

std::string stereo_text(const imaging::StereoResult& r) {
  if (r.missing) return "";
  const auto micrometres = [&](const char* what, const Eigen::VectorXd& of) {
    const auto std = mean_deviation(r.motion, of);
    return fmt::format("{} {:.3g}, {:.3g}, {:.3g} µm", what, 1e6 * std[0], 1e6 * std[1], 1e6 * std[2]);
  };
  return fmt::format("{}: {}{} (x, y, z), cameras contradict each other by {:.3g} px, {:.0f} ms",
                     r.pictures.front().picture, micrometres("noise", r.motion.std),
                     r.calibration.cols() > 0 ? micrometres(", calibration", r.calibration_std()) : "",
                     r.motion.epipolar_rms, r.elapsed_ms);
}

nlohmann::ordered_json pattern_record(const std::string& name, const imaging::PatternReport& r,
                                      const std::optional<imaging::PictureFrame>& frame) {
  nlohmann::ordered_json line = {{"pattern", name},
                                 {"mean_level", r.mean_level},
                                 {"contrast", r.contrast},
                                 {"rms_gradient", r.rms_gradient},
                                 {"saturated", r.saturated},
                                 {"black", r.black},
                                 {"speckle_size_px", r.speckle},
                                 {"elements", r.elements},
                                 {"elements_without_texture", r.elements_without_texture},
                                 {"nodes", r.nodes},
                                 {"noise_grey_levels", r.noise},
                                 {"noise_is_assumed", r.noise_is_assumed},
                                 {"noise_std_px", r.mean_std},
                                 {"largest_std_px", r.largest_std}};
  if (frame) line["noise_std_m"] = r.mean_std * frame->scale();
  line["advice"] = r.advice;
  return line;
}

std::string pattern_text(const imaging::PatternReport& r, const std::optional<imaging::PictureFrame>& frame) {
  std::string text = fmt::format(
      "rms gradient        {:.1f} grey levels of 256 per px\n"
      "mean, contrast      {:.0f} %, {:.0f} % of the full range\n"
      "saturated, black    {:.2f} %, {:.2f} % of the pixels\n"
      "speckle size        {:.1f} × {:.1f} px\n"
      "noise               {:.2f} grey levels{}\n"
      "displacement std    {:.4f} px on average, {:.4f} px at the worst node",
      r.rms_gradient, 100 * r.mean_level, 100 * r.contrast, 100 * r.saturated, 100 * r.black, r.speckle[0],
      r.speckle[1], r.noise, r.noise_is_assumed ? " (assumed)" : "", r.mean_std, r.largest_std);
  if (frame)
    text += fmt::format(" ({:.2f} and {:.2f} µm)", 1e6 * frame->scale() * r.mean_std,
                        1e6 * frame->scale() * r.largest_std);
  for (const std::string& advice : r.advice) text += "\n- " + advice;
  return text;
}

}  // namespace knothe::record
