/// @file The part of the sequential update that finds the posterior of a target that is set: by a grid, by
/// one map of all data, or by composed maps; corrected by importance weights or by quadrature, and judged.
#include <fmt/format.h>

#include <cmath>

#include "knothe/assimilation/update/composed_density.hpp"
#include "knothe/assimilation/update/sequential_update.hpp"
#include "knothe/assimilation/update/tensor_quadrature.hpp"
#include "knothe/base/monotonic_time.hpp"
#include "knothe/transport/diagnose/trust.hpp"

namespace knothe::assimilation {
namespace {

/// Below this effective sample size (fraction) weighted points give way to quadrature, where the parameters
/// are few enough: it costs less than the points that would be needed, and finds the modes that a map may
/// miss.
constexpr double k_quadrature_below = 0.98;

double effective_sample_size(const Eigen::VectorXd& log_weight) {
  const Eigen::ArrayXd weight = (log_weight.array() - log_weight.maxCoeff()).exp();
  return weight.sum() * weight.sum() / (static_cast<double>(weight.size()) * weight.square().sum());
}

/// The decision and, in `remark`, why: the tolerance missed, then what speaks against trust.
void judge(UpdateResult& r, const std::string& reason) {
  const transport::Trust trust =
      transport::judge_trust({r.variance_diagnostic, r.effective_sample_size, r.second_mode_found, ""});
  r.trusted = trust.trusted;
  r.remark = reason + (reason.empty() || trust.reason.empty() ? "" : "; ") + trust.reason;
}

}  // namespace

void SequentialUpdate::average_noise_level() {
  sampling::LogDensityBatch batch;
  batch.resize(posterior_.points.rows(), posterior_.points.cols(), 0);
  target_.evaluate_likelihood(posterior_.points, 0, batch);
  double mean = 0;
  for (Eigen::Index i = 0; i < batch.value.size(); ++i)
    mean += posterior_.weights[i] * target_.noise_level()->expected(batch.value[i]);
  result_.noise_level = mean;
}

void SequentialUpdate::by_grid() {
  const auto start = monotonic_now();
  using Axes = QuadratureOptions::Axes;
  const QuadraturePosterior grid =
      tensor_quadrature(target_, {transform_->dimension() < 3 ? Axes::parameters : Axes::modes});
  take(grid);
  result_.map_mean = result_.mean;
  result_.map_covariance = result_.covariance;
  result_.log_evidence_lower_bound = grid.log_evidence;
  result_.trusted = result_.tolerance_reached = grid.resolved();
  if (!grid.resolved())
    result_.remark = "the posterior is too narrow for the grid: use method.kind = \"transport\"";
  result_.elapsed_us.map = microseconds_since(start);
}

void SequentialUpdate::by_collapsed_map() {
  const auto start = monotonic_now();
  solver_.solve(target_, map_);
  result_.elapsed_us.map = microseconds_since(start);
  const auto correction_start = monotonic_now();
  const double ess = effective_sample_size(map_.verification.log_weight);
  if (ess < k_quadrature_below && transform_->dimension() <= k_most_quadrature_parameters) {
    take(map_);
    result_.effective_sample_size = ess;
    result_.log_evidence_lower_bound = map_.map_log_evidence();
    integrate();
  } else {
    solver_.correct(target_, map_, correction_);
    take(map_);
    result_.effective_sample_size = correction_.ess;
    result_.log_evidence = correction_.log_evidence;
    result_.log_evidence_lower_bound = correction_.map_log_evidence;
    set_moments(correction_.points, correction_.weights);
    set_quantiles(correction_.quantiles);
    judge(result_, map_.reason);
  }
  result_.elapsed_us.correction = microseconds_since(correction_start);
}

void SequentialUpdate::by_composed_maps(std::size_t step) {
  const auto start = monotonic_now();
  MapComposition& composition = *composition_;
  const Datum& datum = data_.at(step);
  composition.density.set(composition.map, datum.corrected_form ? *datum.corrected_form : datum.form);
  solver_.solve(composition.density, map_);
  composition.map.append(map_.pre_map);
  composition.map.append(map_.map);
  const bool last_reached = map_.tolerance_reached;
  const std::string last_reason = map_.reason;
  const int last_order = map_.order;

  // The composition as a whole is judged, and corrected, against the whole posterior.
  const auto correction_start = monotonic_now();
  composition.batch.resize(map_.verification.reference.rows(), transform_->dimension(), 0);
  composition.map.evaluate(map_.verification.reference, 0, composition.batch);
  const PushedPoints pushed = push_forward(target_, map_.verification.reference, composition.batch);
  if (pushed.effective_sample_size < 0.9) {
    // Errors of a hundred maps add up: begin anew with one map of the whole posterior, which is at hand.
    by_collapsed_map();
    composition.map = transport::ComposedMap(transform_->dimension());
    composition.map.append(map_.pre_map);
    composition.map.append(map_.map);
    result_.remark +=
        fmt::format("{}the composition was begun anew: its effective sample size had come to {:.0f} %",
                    result_.remark.empty() ? "" : "; ", 100 * pushed.effective_sample_size);
    return;
  }
  result_.map_order = last_order;
  result_.tolerance_reached = last_reached;
  result_.second_mode_found = map_.second_mode_found;
  result_.variance_diagnostic = pushed.variance_diagnostic;
  result_.effective_sample_size = pushed.effective_sample_size;
  result_.log_evidence = pushed.log_evidence;
  result_.log_evidence_lower_bound = pushed.log_evidence_lower_bound;
  set_moments(composition.batch.value, pushed.weights);
  set_map_moments(posterior_.points);
  set_quantiles(weighted_quantiles(composition.batch.value, pushed.weights));
  judge(result_, last_reason);
  result_.elapsed_us.correction = microseconds_since(correction_start);
  result_.elapsed_us.map = microseconds_since(start) - result_.elapsed_us.correction;
}

void SequentialUpdate::integrate() {
  const QuadraturePosterior quadrature = tensor_quadrature(target_);
  take(quadrature);
  judge(result_, map_.reason);
  result_.remark += fmt::format("; moments, quantiles and evidence are by quadrature at {} points",
                                quadrature.weights.size());
}

void SequentialUpdate::take(const QuadraturePosterior& quadrature) {
  const QuadraturePosterior::Nodes& nodes = quadrature.nodes;
  if (nodes.runs.empty()) {
    posterior_.points.resize(quadrature.points.rows(), quadrature.points.cols());
    transform_->evaluate(quadrature.points, 0, posterior_.points, no_derivatives_, no_derivatives_);
  } else {  // p(z) goes axis by axis
    Eigen::MatrixXd axes(nodes.axes.rows(), nodes.axes.cols());
    transform_->evaluate(nodes.axes, 0, axes, no_derivatives_, no_derivatives_);
    posterior_.points = reduction::nodes_of(axes, nodes.runs)(nodes.kept, Eigen::all);
  }
  set_moments(quadrature.weights);
  set_quantiles(quadrature.quantiles);
  if (target_.component_count() > 1 && !nodes.runs.empty())
    shares_ = target_.component_shares(nodes.axes, nodes.runs, nodes.weights);
  result_.log_evidence = quadrature.log_evidence;
}

void SequentialUpdate::take(const transport::MapResult& map) {
  map_points_.resize(map.verification.points.rows(), transform_->dimension());
  transform_->evaluate(map.verification.points, 0, map_points_, no_derivatives_, no_derivatives_);
  set_map_moments(map_points_);
  result_.map_order = map.order;
  result_.variance_diagnostic = map.verified_diagnostic;
  result_.tolerance_reached = map.tolerance_reached;
  result_.second_mode_found = map.second_mode_found;
}

void SequentialUpdate::set_map_moments(const Eigen::MatrixXd& p) {
  result_.map_mean = p.colwise().mean();
  const Eigen::MatrixXd centred = p.rowwise() - result_.map_mean.transpose();
  result_.map_covariance.noalias() = centred.transpose() * centred / static_cast<double>(p.rows());
}

void SequentialUpdate::set_moments(const Eigen::MatrixXd& z, const Eigen::VectorXd& weights) {
  posterior_.points.resize(z.rows(), z.cols());
  transform_->evaluate(z, 0, posterior_.points, no_derivatives_, no_derivatives_);
  set_moments(weights);
}

/// Of the points of `posterior_`.
void SequentialUpdate::set_moments(const Eigen::VectorXd& weights) {
  posterior_.weights = weights;
  const Eigen::MatrixXd& p = posterior_.points;
  result_.mean.noalias() = p.transpose() * weights;
  const Eigen::MatrixXd centred = p.rowwise() - result_.mean.transpose();
  const Eigen::MatrixXd weighted = weights.asDiagonal() * centred;
  const Eigen::MatrixXd covariance = centred.transpose() * weighted;
  result_.covariance = 0.5 * (covariance + covariance.transpose());  // symmetric to the bit
}

void SequentialUpdate::set_quantiles(const Eigen::MatrixXd& z_quantiles) {
  // p(z) is monotone, coordinate by coordinate: quantiles go through it.
  result_.quantiles.resize(z_quantiles.rows(), z_quantiles.cols());
  for (Eigen::Index k = 0; k < z_quantiles.rows(); ++k) {
    for (Eigen::Index j = 0; j < z_quantiles.cols(); ++j) {
      result_.quantiles(k, j) = transform_->prior(k).from_standard_normal(z_quantiles(k, j)).value;
    }
  }
}

}  // namespace knothe::assimilation
