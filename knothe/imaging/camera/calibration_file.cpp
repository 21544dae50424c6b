#include "knothe/imaging/camera/calibration_file.hpp"

#include <fmt/format.h>

#include <Eigen/LU>
#include <algorithm>
#include <map>
#include <optional>
#include <pugixml.hpp>
#include <sstream>
#include <string_view>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/numbers.hpp"

namespace knothe::imaging {
namespace {

/// A calibration: its text, as XML where it is, and the name of its file for messages.
struct CalibrationText {
  std::string path, text;
  pugi::xml_document xml;

  [[noreturn]] void fail(const std::string& what) const {
    throw DataError(fmt::format("{}: calibration: {}", path, what));
  }
  [[nodiscard]] bool has(std::string_view part) const { return text.find(part) != std::string::npos; }
  void parse() {
    if (const auto parsed = xml.load_buffer(text.data(), text.size()); !parsed)
      fail(fmt::format("is no XML from byte {} on: {}", parsed.offset, parsed.description()));
  }
};

/// The numbers in a text, parted by blanks, commas and brackets; `key` is for the message.
std::vector<double> numbers_in(const CalibrationText& file, std::string_view text, const std::string& key) {
  constexpr std::string_view k_parting = " \t\r\n,[]{}";
  std::vector<double> numbers;
  for (std::size_t begin = text.find_first_not_of(k_parting); begin != std::string_view::npos;) {
    const std::size_t end = std::min(text.find_first_of(k_parting, begin), text.size());
    const std::string_view word = text.substr(begin, end - begin);
    const auto number = files::parse_number(word);
    if (!number || !std::isfinite(*number)) file.fail(fmt::format("{}: '{}' is not a number", key, word));
    numbers.push_back(*number);
    begin = text.find_first_not_of(k_parting, end);
  }
  return numbers;
}

void check(const CalibrationText& file, const Camera& camera, Index number) {
  if (!(camera.fx > 0 && camera.fy > 0))
    file.fail(
        fmt::format("camera {}: focal lengths {} and {} px must be positive", number, camera.fx, camera.fy));
  const Eigen::Matrix3d& r = camera.rotation;
  if (!((r * r.transpose() - Eigen::Matrix3d::Identity()).norm() < 1e-3 && r.determinant() > 0))
    file.fail(fmt::format("camera {}: the rotation is not one (R Rᵀ ≠ 1): is a number missing?", number));
}

/// Of a matrix rounded to a few digits the nearest rotation: one step of Newton's for the polar factor,
/// twice.
Eigen::Matrix3d orthonormal(Eigen::Matrix3d r) {
  for (int k = 0; k < 2 && std::abs(r.determinant()) > 0.5; ++k) r = 0.5 * (r + r.inverse().transpose());
  return r;
}

/// A matrix of OpenCV's FileStorage, row by row, in YAML or XML; nothing where the key is missing.
std::optional<std::vector<double>> opencv_matrix(const CalibrationText& file, const std::string& key) {
  if (const pugi::xml_node storage = file.xml.child("opencv_storage")) {
    const pugi::xml_node data = storage.child(key.c_str()).child("data");
    return data ? std::optional(numbers_in(file, data.text().get(), key)) : std::nullopt;
  }
  const std::string_view text = file.text;
  const std::size_t at = text.find(fmt::format("\n{}:", key));
  if (at == std::string_view::npos) return std::nullopt;
  const std::size_t begin = text.find("data:", at), end = text.find(']', std::min(begin, text.size()));
  if (end == std::string_view::npos) file.fail(fmt::format("{}: has no data: […]", key));
  return numbers_in(file, text.substr(begin + 5, end - begin - 5), key);
}

std::vector<double> required(const CalibrationText& file, const std::vector<std::string>& keys,
                             std::size_t least) {
  for (const std::string& key : keys)
    if (const auto found = opencv_matrix(file, key)) {
      if (found->size() < least)
        file.fail(fmt::format("{}: {} numbers, {} are needed", key, found->size(), least));
      return *found;
    }
  file.fail(
      fmt::format("no matrix {}: an OpenCV file of two cameras holds M1, D1, M2, D2, R and T; put "
                  "intrinsics and extrinsics into one file",
                  keys.front()));
}

/// Sets k1 … k6, p1, p2 from OpenCV's order k1, k2, p1, p2, k3, k4, k5, k6, then s1 … s4, τx, τy.
void set_distortion(const CalibrationText& file, Camera& camera, std::vector<double> d,
                    const std::string& key) {
  d.resize(std::max<std::size_t>(d.size(), 14), 0.0);
  camera.radial = {d[0], d[1], d[4], d[5], d[6], d[7]};
  camera.tangential = {d[2], d[3]};
  if (std::any_of(d.begin() + 8, d.end(), [](double value) { return value != 0; }))
    file.fail(
        fmt::format("{}: thin-prism or tilt coefficients are not known here; calibrate without "
                    "CALIB_THIN_PRISM_MODEL and CALIB_TILTED_MODEL",
                    key));
}

/// Each name with a number behind it.
std::vector<std::string> numbered(const std::vector<std::string>& names, Index number) {
  std::vector<std::string> keys;
  for (const std::string& name : names) keys.push_back(fmt::format("{}{}", name, number));
  return keys;
}

/// `matrix`, `distortion`: keys that may stand for them.
Camera opencv_lens(const CalibrationText& file, const std::vector<std::string>& matrix,
                   const std::vector<std::string>& distortion) {
  const auto m = required(file, matrix, 9);
  Camera camera;
  camera.fx = m[0], camera.cx = m[2], camera.fy = m[4], camera.cy = m[5];
  if (m[1] != 0)
    file.fail(fmt::format("{}: OpenCV leaves the skew {} out; set it to 0", matrix.front(), m[1]));
  set_distortion(file, camera, required(file, distortion, 4), distortion.front());
  return camera;
}

std::vector<Camera> opencv_cameras(const CalibrationText& file) {
  if (opencv_matrix(file, "camera_matrix") || opencv_matrix(file, "cameraMatrix"))
    return {opencv_lens(file, {"camera_matrix", "cameraMatrix"},
                        {"distortion_coefficients", "dist_coeffs", "distCoeffs"})};
  std::vector<Camera> cameras;
  for (Index n = 1; n <= 2; ++n)
    cameras.push_back(
        opencv_lens(file, numbered({"M", "K", "cameraMatrix"}, n), numbered({"D", "distCoeffs"}, n)));
  const auto r = required(file, {"R"}, 9), t = required(file, {"T"}, 3);
  cameras[1].rotation = orthonormal(Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(r.data()));
  cameras[1].translation << t[0], t[1], t[2];
  return cameras;
}

/// One camera of DICe's parameter lists, or the whole file.
class DiceList {
 public:
  DiceList(const CalibrationText& file, const pugi::xml_node& list, std::string name)
      : file_(file), list_(list), name_(std::move(name)) {}

  /// The element with that name, at any depth.
  [[nodiscard]] pugi::xml_node element(std::string_view key) const {
    return list_.find_node([&](const pugi::xml_node& node) { return node.attribute("name").value() == key; });
  }
  [[nodiscard]] std::optional<std::string_view> value(std::string_view key) const {
    const pugi::xml_attribute found = element(key).attribute("value");
    return found ? std::optional<std::string_view>(found.value()) : std::nullopt;
  }
  /// 0 where the key is missing.
  [[nodiscard]] double number(const std::string& key) const {
    const auto text = value(key);
    if (!text) return 0;
    const auto found = numbers_in(file_, *text, fmt::format("{} {}", name_, key));
    if (found.size() != 1) file_.fail(fmt::format("{} {}: one number is needed", name_, key));
    return found.front();
  }
  /// R of the rows, or of the angles; 1 where there are neither.
  [[nodiscard]] Eigen::Matrix3d rotation() const {
    Eigen::Matrix3d r;
    if (!value("ROW 0")) return rotation_of_angles(number("ALPHA"), number("BETA"), number("GAMMA"));
    for (int k = 0; k < 3; ++k) {
      const std::string key = fmt::format("ROW {}", k);
      const auto found = numbers_in(file_, value(key).value_or(""), fmt::format("{} {}", name_, key));
      if (found.size() != 3) file_.fail(fmt::format("{} ROW {}: three numbers are needed", name_, k));
      r.row(k) << found[0], found[1], found[2];
    }
    return orthonormal(r);
  }

 private:
  const CalibrationText& file_;
  pugi::xml_node list_;
  std::string name_;
};

Camera dice_camera(const CalibrationText& file, const pugi::xml_node& element, const std::string& name) {
  const DiceList list(file, element, name);
  Camera camera;
  for (const char* key : {"CX", "CY", "FX", "FY"})
    if (!list.value(key)) file.fail(fmt::format("{}: {} is missing: is the file whole?", name, key));
  camera.cx = list.number("CX"), camera.cy = list.number("CY");
  camera.fx = list.number("FX"), camera.fy = list.number("FY");
  for (Index k = 0; k < 6; ++k) camera.radial[k] = list.number(fmt::format("K{}", k + 1));
  camera.tangential = {list.number("P1"), list.number("P2")};
  camera.rotation = list.rotation();
  camera.translation = Eigen::Vector3d(list.number("TX"), list.number("TY"), list.number("TZ"));
  for (const char* key : {"S1", "S2", "S3", "S4", "T1", "T2"})
    if (list.number(key) != 0)
      file.fail(fmt::format("{} {}: thin-prism and tilt coefficients are not known here; calibrate without",
                            name, key));
  // DICe's models other than OpenCV's are left alone: their source says that it is not sure of them.
  if (list.number("FS") != 0)
    file.fail(fmt::format("{} FS: DICe leaves the skew out; calibrate without, or set it to 0", name));
  const bool bends = std::any_of(camera.radial.begin(), camera.radial.end(), [](double k) { return k != 0; });
  const auto model = list.value("LENS_DISTORTION_MODEL").value_or("NO_LENS_DISTORTION");
  if (bends && model != "OPENCV_LENS_DISTORTION")
    file.fail(fmt::format("{}: lens distortion of kind {} is not known here; OPENCV_LENS_DISTORTION is", name,
                          model));
  return camera;
}

std::vector<Camera> dice_cameras(const CalibrationText& file) {
  const DiceList whole(file, file.xml, "file");
  std::vector<Camera> cameras;
  for (;;) {
    const std::string name = fmt::format("CAMERA {}", cameras.size());
    const pugi::xml_node element = whole.element(name);
    if (!element) break;
    cameras.push_back(dice_camera(file, element, name));
  }
  if (whole.value("extrinsics_relative_camera_to_camera") == "true" && !cameras.empty() &&
      (!cameras[0].rotation.isIdentity() || !cameras[0].translation.isZero()))
    file.fail(
        "extrinsics_relative_camera_to_camera with a first camera that is not at the origin is not "
        "known here; save the poses relative to the world");
  return cameras;
}

/// The lines `NAME [unit]; value` of a MatchID table, parted by a semicolon or tab; "Kappa 1" is Kappa1.
std::map<std::string, double> matchid_table(const CalibrationText& file) {
  std::map<std::string, double> table;
  std::istringstream lines(file.text);
  for (std::string line; std::getline(lines, line);) {
    const std::size_t end = line.find_first_of(";\t");
    if (end == std::string::npos) continue;
    std::string key = line.substr(0, std::min(end, line.find('[')));
    std::erase(key, ' ');
    const auto numbers = numbers_in(file, std::string_view(line).substr(end + 1), key);
    if (numbers.size() != 1) file.fail(fmt::format("{}: one number is needed", key));
    table[key] = numbers.front();
  }
  return table;
}

std::vector<Camera> matchid_cameras(const CalibrationText& file) {
  std::map<std::string, double> table = matchid_table(file);
  const auto take = [&](const std::string& key, bool is_needed) {
    const auto found = table.extract(key);
    if (found.empty() && is_needed) file.fail(fmt::format("{} is missing: is the file whole?", key));
    return found.empty() ? 0 : found.mapped();
  };
  std::vector<Camera> cameras(2);
  for (Index c = 0; c < 2; ++c) {
    Camera& camera = cameras[c];
    const std::string name = fmt::format("Cam{}_", c);
    camera.fx = take(name + "Fx", true), camera.fy = take(name + "Fy", true);
    camera.cx = take(name + "Cx", true), camera.cy = take(name + "Cy", true);
    camera.skew = take(name + "Fs", false);
    for (Index k = 0; k < 3; ++k) camera.radial[k] = take(fmt::format("{}Kappa{}", name, k + 1), false);
    camera.tangential = {take(name + "P1", false), take(name + "P2", false)};
  }
  const double theta = take("Theta", true), phi = take("Phi", true), psi = take("Psi", true);
  cameras[1].rotation = rotation_of_angles(theta, phi, psi);
  for (int k = 0; k < 3; ++k) cameras[1].translation[k] = take(std::string("T") + "xyz"[k], true);
  for (const auto& [key, value] : table)
    if (key.starts_with("Cam") && value != 0) file.fail(fmt::format("{} is not known here", key));
  return cameras;
}

/// One or more; `file` is made of the text.
std::vector<Camera> all_cameras(CalibrationText& file) {
  if (file.has("<opencv_storage") || file.has("DICe_xml_camera_system_file")) file.parse();
  std::vector<Camera> cameras;
  if (file.has("<opencv_storage") || file.has("opencv-matrix"))
    cameras = opencv_cameras(file);
  else if (file.has("DICe_xml_camera_system_file"))
    cameras = dice_cameras(file);
  else if (file.has("\nCam0_Fx"))
    cameras = matchid_cameras(file);
  else if (file.has("DICe_XML_Calibration_File"))
    file.fail("this is DICe's form of before 2020; open and save it with a DICe of today");
  else if (file.has("<orientation>"))
    file.fail(
        "this is a project of VIC-3D, whose model of the lens is not published; calibrate with OpenCV or "
        "DICe from the same pictures of the target");
  else
    file.fail(
        "no calibration that is known: OpenCV's .yaml or .xml of two cameras, DICe's .xml, or MatchID's "
        ".caldat");
  for (Index c = 0; c < std::ssize(cameras); ++c) check(file, cameras[c], c);
  return cameras;
}

}  // namespace

std::vector<Camera> read_cameras(const std::string& path) {
  return parse_cameras(files::read_text(path), path);
}

std::vector<Camera> parse_cameras(const std::string& text, const std::string& path) {
  CalibrationText file{path, "\n" + text, {}};  // every key begins a line
  std::vector<Camera> cameras = all_cameras(file);
  if (cameras.size() < 2)
    file.fail(fmt::format("{} camera(s) found; two or more are needed", cameras.size()));
  return cameras;
}

Camera read_lens(const std::string& path) {
  CalibrationText file{path, "\n" + files::read_text(path), {}};
  const std::vector<Camera> cameras = all_cameras(file);
  if (cameras.empty()) file.fail("no camera found; one is needed");
  Camera lens = cameras.front();
  lens.rotation.setIdentity(), lens.translation.setZero();
  return lens;
}

}  // namespace knothe::imaging
