#pragma once
/// @file Is a speckle pattern good enough, and how accurately will displacements be known? Before a test,
/// from the reference picture alone; and the table of settings that a report on a measurement should hold.
#include <Eigen/Core>
#include <array>
#include <optional>
#include <string>
#include <vector>

#include "knothe/imaging/mesh/registration.hpp"
#include "knothe/imaging/series/picture_series.hpp"

namespace knothe::imaging {

struct PatternReport {
  double mean_level = 0,
         contrast = 0;              ///< mean and standard deviation of the region, share of the full range
  double rms_gradient = 0;          ///< root mean square of one component, grey levels of 256 per px
  double saturated = 0, black = 0;  ///< share of pixels at the largest level, at 0
  std::array<double, 2>
      speckle{};  ///< px, along x and y: full width of the autocorrelation at half its height
  int elements = 0, nodes = 0, elements_without_texture = 0;
  double noise = 0;               ///< γ, grey levels of the picture …
  bool noise_is_assumed = false;  ///< … 2 of 256, since nobody said and there is one reference
  Eigen::VectorXd std;            ///< px, predicted for each displacement; 0 where nothing can be measured
  double mean_std = 0, largest_std = 0;  ///< px
  std::vector<std::string> advice;       ///< what to change, in words; empty: nothing
};

/// Looks at the reference of a series, which needs no pictures.
[[nodiscard]] PatternReport pattern_report(const PictureSeries& series);

/// Smaller speckles are sampled too coarsely: a prefilter of 1 px halves the error, px.
inline constexpr double k_aliased_speckle = 3;

/// Full width at half its height of the autocorrelation of a picture's region along x and y, px; 0 where it
/// does not fall that far within 64 px.
[[nodiscard]] std::array<double, 2> speckle_size(const files::Picture& picture, const Region& region);

/// One line of a table: what, how much, in what.
struct ReportRow {
  std::string name, value, unit;
};

/// The settings and figures that the community's good-practice guide (International Digital Image Correlation
/// Society, 2018) wants reported: pictures, field of view, scale, elements, interpolant, criterion, noise
/// floor. `noise`: γ, grey levels; `std`: of the displacements, px, 0 where nothing is measured.
[[nodiscard]] std::vector<ReportRow> reporting_table(const PictureSeries& series,
                                                     const std::optional<PictureFrame>& frame, double noise,
                                                     const Eigen::VectorXd& std);

/// Errors: UsageError for a name that does not end in .txt, .json or .html.
void require_table_name(const std::string& path);
/// The table as a file: .txt, .json or .html by its ending. Errors: UsageError for another ending, IoError.
void write_reporting_table(const std::string& path, const std::vector<ReportRow>& rows);

}  // namespace knothe::imaging
