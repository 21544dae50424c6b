#pragma once
/// @file What a reduced model leaves out, as a covariance that a likelihood can add
/// (docs/explanation/reduction.md, "The model's own error").
#include <Eigen/Core>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "knothe/base/index.hpp"
#include "knothe/model/compress/compression.hpp"
#include "knothe/model/observe/scalar_observations.hpp"
#include "knothe/model/observe/sensors.hpp"

namespace knothe::model {

/// Covariance of e = u − û over the parameters, at each step: Σ_t = V S_t Vᵀ + v_t I. Without the bias of a
/// mean: S_t are second moments about zero.
struct TruncationError {
  std::size_t count = 0;      ///< k space modes
  std::vector<double> space;  ///< [k, n_dof], V: orthonormal; of quantities in several units, in their scales
  std::vector<double> covariance;  ///< [n_t, k, k], S_t, m²
  std::vector<double> variance;    ///< [n_t], v_t: what V leaves out, per dof, m²
  /// τ = 1 + 2 Σ_k ρ_k, ρ_k the correlation of the errors of steps k apart (up to the first below 0.05): n
  /// steps tell no more of the error than n/τ independent ones.
  double persistence = 1;
  /// [m, n_t, k]: coefficients in V of the errors at the m off-grid solutions, which the model was not made
  /// from, m; empty where there were none.
  std::vector<double> off_grid;
  /// [m, d]: parameters of those solutions, in the order of `parameters`, and how far around them their
  /// errors speak for others, as a standard deviation: 0 for the whole box. Empty in files of before: the
  /// whole box.
  std::vector<double> off_grid_points, off_grid_reach;
  /// [d] exponents e: errors that speak for the whole box are alike where Σ e ln p is, within this standard
  /// deviation. Empty: everywhere.
  std::vector<double> alike;
  double alike_within = 0;
  /// [m, n_t] by name: errors of the model's outputs at those solutions, in the outputs' units. Of an output
  /// that one of them does not have nothing is known.
  std::map<std::string, std::vector<double>> off_grid_outputs;
  std::vector<std::string> parameters;  ///< the file's, in its order
  [[nodiscard]] std::size_t off_grid_count() const {
    return off_grid.empty() ? 0 : off_grid.size() / (count * variance.size());
  }
};

/// From the errors that are known: at the grid points (truncation alone) with equal weights and, added to
/// that, at `off_grid` solutions (truncation and interpolation) with equal weights. UsageError if sizes
/// differ.
[[nodiscard]] TruncationError truncation_error(const ModelContents& model, const Snapshots& snapshots,
                                               std::span<const OffGridSolution> off_grid = {},
                                               std::size_t modes = 20, std::size_t threads = 0);

/// Sets moments and persistence from errors whose coefficients in `error.space` (k × n_t each) have these
/// weights, which add up to one. Nothing is left outside that space.
void set_moments(std::span<const Eigen::MatrixXd> coefficients, std::span<const double> weights,
                 TruncationError& error);

/// Writes a model with its truncation error (/truncation/…) in one file, atomically. IoError.
void write_model(const ModelContents& contents, const TruncationError& error, const std::string& path);

/// What `write_model` wrote; `count` 0 if the file has none (made by another program, or by an older knothe).
[[nodiscard]] TruncationError read_truncation_error(const std::string& path);

/// The model's own error at the sensors and at the times of the data, taken as independent from one to the
/// next: N(0, F_t F_tᵀ + diag(left_out_t)), in the units of the observations.
struct ObservedTruncation {
  std::vector<Eigen::MatrixXd> factors;  ///< F_t, n × q, per time
  Eigen::MatrixXd left_out;              ///< n × times: variances of what the space modes leave out
};

/// Σ_t at the sensors (as in `observe_off_grid`; outputs by the mean square of their errors off the grid)
/// times max(1, τ / mean distance of the times in steps); between two times of the model linear. DataError
/// where the file has no truncation error.
[[nodiscard]] ObservedTruncation observe_truncation(const TruncationError& error, const ModelContents& model,
                                                    const std::string& where, const Sensors& sensors,
                                                    std::span<const ScalarObservation> scalars,
                                                    std::span<const double> times);

/// Errors u − û of the model at observations that are known exactly, of k full-order solutions at parameters
/// that it was not made from: e_j(t) = space · coefficients[t].col(j).
struct ObservedErrors {
  Eigen::MatrixXd space;                      ///< n × q, in the units of the observations
  std::vector<Eigen::MatrixXd> coefficients;  ///< n_t matrices q × k
  /// k × d: where, by the observed model's parameters, and how far around it they speak (0: in the whole
  /// box); empty: all in the whole box.
  Eigen::MatrixXd points, reach;
  Eigen::VectorXd alike;    ///< d: as in TruncationError; empty: none
  double alike_within = 0;  ///< likewise
  [[nodiscard]] Index count() const { return coefficients.empty() ? 0 : coefficients[0].cols(); }
};

/// Of the off-grid solutions, at the sensors (places as in `observe`; a scalar is a quantity or an output of
/// the model, or one of `scalars`) and these times; between two times of the model linear. Rows of which no
/// error is known, and those up to `observations`, are zero. Empty where the file has no such solutions,
/// or none of the sensors' errors is known.
[[nodiscard]] ObservedErrors observe_off_grid(const TruncationError& error, const ModelContents& model,
                                              const std::string& where, const Sensors& sensors,
                                              std::span<const ScalarObservation> scalars,
                                              std::span<const double> times, Index observations);

/// `knothe model import`, with the error that is known at the grid points.
struct ImportedModel {
  ModelContents model;
  TruncationError truncation;
};
[[nodiscard]] ImportedModel import_model_and_error(const std::string& path,
                                                   const CompressionOptions& options);

}  // namespace knothe::model
