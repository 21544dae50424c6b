#pragma once
/// @file What the commands say of a crack that was measured in a picture.
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "knothe/imaging/crack/crack_measurement.hpp"
#include "knothe/imaging/mesh/registration.hpp"

namespace knothe::commands {

/// For `--json`: px, and with a frame the model's place (m) of the tip and lengths in m beside them.
[[nodiscard]] nlohmann::ordered_json crack_line(const imaging::CrackMeasurement& crack,
                                                const std::optional<imaging::PictureFrame>& frame);
/// One line for people.
[[nodiscard]] std::string crack_text(const imaging::CrackMeasurement& crack,
                                     const std::optional<imaging::PictureFrame>& frame);

}  // namespace knothe::commands
