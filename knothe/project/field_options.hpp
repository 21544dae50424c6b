#pragma once
/// @file The table [data.fields]: displacement fields that another program exported.
#include <array>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "knothe/files/fields/exported_field.hpp"
#include "knothe/imaging/mesh/registration.hpp"

namespace knothe::project {

struct Values;

/// What a project says of its fields; nothing is looked up on disk yet.
struct FieldOptions {
  std::string files;  ///< folder, or folder and pattern of names, resolved; empty: there are none
  files::FieldMapping mapping;
  std::string reference;                      ///< resolved; empty: none
  std::vector<std::string> static_fields;     ///< names in the folder
  std::vector<double> times;                  ///< of each file
  std::string steps;                          ///< table of files and times, resolved; empty: none
  bool time_from_name = false;                ///< else what the files state
  double time_zero = 0;                       ///< what is 0 in the model, s or as the files have it
  std::map<std::string, std::string> series;  ///< by the model's name: that in the files
  std::optional<double> std;                  ///< m
  double relative_scale_std = 0;
  std::vector<double> motion_std{0, 0, 0};  ///< of each field: m, degrees, change of magnification
  double min_distance = 0;                  ///< m
  double outliers = 0;                      ///< how far from its neighbours a point is lost; 0: none
  std::optional<double> scale;              ///< m per px
  std::vector<std::array<double, 2>> points, model_points;  ///< as in the files; m
  std::optional<std::array<double, 2>> origin;              ///< of the model, as in the files
  double angle = 0;                                         ///< degrees
  imaging::View view = imaging::View::side;
  std::optional<double> plane;                  ///< m
  std::optional<std::array<double, 4>> region;  ///< of the model's face, two corners, m
};

/// Reads [data.fields]. Complaints go to `values`.
[[nodiscard]] FieldOptions read_field_options(Values& values);

}  // namespace knothe::project
