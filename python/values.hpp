#pragma once
/// @file What the package gives to the engine as plain values, and what models say at parameter points.
#include <array>
#include <optional>
#include <span>
#include <string>
#include <tuple>
#include <vector>

#include "knothe/library/assimilation.hpp"
#include "knothe/model/observe/observed_model.hpp"
#include "knothe/posterior/prior/prior.hpp"
#include "python/arrays.hpp"

namespace knothe::python {

using Integers = py::array_t<std::int64_t, py::array::c_style | py::array::forcecast>;
/// Compressed sparse rows: values, columns, row_begin.
using SparseRows = std::tuple<Doubles, Integers, Integers>;
/// Name, family ("normal", "uniform", "lognormal") and its two numbers; or "posterior", and after two numbers
/// its folder of results and the parameter's name there.
using PriorValues = std::tuple<std::string, std::string, double, double, std::string, std::string>;

/// One of the two; an empty `std` and no precision: no noise of its own.
[[nodiscard]] Noise noise_of(const Doubles& std, const std::optional<SparseRows>& precision);
/// UsageError for another family.
[[nodiscard]] std::vector<Prior> priors_of(const std::vector<PriorValues>& priors);

/// Of each prior its support (lower, upper), and its density at points: what figures want.
[[nodiscard]] py::list densities_of(const std::vector<posterior::Prior>& priors);

/// `posterior::prior_values` at points (n × d): what `population` divides out.
[[nodiscard]] py::dict prior_at(const std::vector<posterior::Prior>& priors, const Eigen::MatrixXd& points);

/// Attributes of a parameter's variable as results files have them, by name: units, long_name, reference and
/// reference_units.
[[nodiscard]] py::dict labels_of(std::span<const model::Axis> axes);

/// Numbers at n parameter points: m each, and their derivatives by d parameters.
struct Prediction {
  std::size_t points = 0, count = 0, dimension = 0;
  std::vector<double> values;    ///< n × m
  std::vector<double> jacobian;  ///< n × m × d, or empty
};
/// A pair of arrays; the second is None where there is no Jacobian.
[[nodiscard]] py::tuple arrays_of(Prediction prediction);

/// What sensors say at `points` (n × d, inside the box: else UsageError) and a step.
[[nodiscard]] Prediction predict(const model::ObservedModel& model, std::span<const double> points,
                                 std::size_t step, bool jacobian);

/// Points of d coordinates each, checked: their number. UsageError.
[[nodiscard]] std::size_t count_points(std::span<const double> points, std::size_t dimension);

}  // namespace knothe::python
