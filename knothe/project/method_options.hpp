#pragma once
/// @file The table [method] of a project file: how the posterior is computed.
#include <array>
#include <cstdint>

#include "knothe/assimilation/update/update_options.hpp"
#include "knothe/base/enum_names.hpp"
#include "knothe/posterior/method.hpp"

namespace knothe::project {

struct Values;

/// Whether the full-order model is asked where the posterior is.
enum class ModelVerification { off, full_order };

constexpr auto names_of(ModelVerification /*verification*/) {
  return std::to_array<Named<ModelVerification>>(
      {{ModelVerification::off, "off"}, {ModelVerification::full_order, "full-order"}});
}

struct MethodOptions {
  posterior::Method kind = posterior::Method::automatic;
  /// Form, map, bias, changes; `update_options` adds what stands below.
  assimilation::UpdateOptions update;
  posterior::ModeSearchLevel mode_search = posterior::ModeSearchLevel::tempered;  ///< of `knothe infer`
  bool student_t = false;                                                         ///< else Gaussian
  double degrees_of_freedom = 4;
  double gate = 0;
  bool unknown_noise_level = false;
  double noise_level_shape = 2, noise_level_scale = 1;
  double offset_std = 0;          ///< m
  bool truncation_error = false;  ///< the model's own error is added to the noise
  ModelVerification verify = ModelVerification::off;
  int verify_runs = 14;  ///< at most
  int samples = 10000;
  int verification_points = 1024;  ///< of `knothe infer`
  int evaluations = 0;             ///< of `knothe infer`; 0: as there
  double seconds = 0;              ///< of `knothe infer`; 0: no limit
  std::uint64_t seed = 1;
};

/// The table [method]; complains of what is out of range.
[[nodiscard]] MethodOptions read_method(Values& values);

}  // namespace knothe::project
