#include "knothe/assimilation/select/selection_study.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <numeric>
#include <random>

#include "knothe/numerics/statistics/normal_distribution.hpp"
#include "knothe/numerics/statistics/order_statistics.hpp"

namespace knothe::assimilation {
namespace {

using Criterion = SelectionProblem::Criterion;
using Indices = std::vector<Eigen::Index>;

constexpr int k_random_choices = 5;

Eigen::VectorXd posterior_std(const Eigen::MatrixXd& information, const Eigen::VectorXd& prior_std) {
  const auto d = prior_std.size();
  const Eigen::MatrixXd covariance =
      (information + Eigen::MatrixXd::Identity(d, d)).llt().solve(Eigen::MatrixXd::Identity(d, d));
  return prior_std.cwiseProduct(covariance.diagonal().cwiseSqrt());
}

SelectionCurve curve_of(const std::string& name, const Selection& selection,
                        const Eigen::VectorXd& prior_std) {
  SelectionCurve curve{name, Eigen::MatrixXd(selection.information.size(), prior_std.size())};
  for (std::size_t i = 0; i < selection.information.size(); ++i)
    curve.posterior_std.row(i) = posterior_std(selection.information[i], prior_std).transpose();
  return curve;
}

Indices random_order(Eigen::Index n, std::size_t count, std::uint64_t seed) {
  Indices order(n);
  std::iota(order.begin(), order.end(), Eigen::Index{0});
  std::mt19937_64 random(seed);
  for (std::size_t i = 0; i < count; ++i) std::swap(order[i], order[i + random() % (order.size() - i)]);
  order.resize(count);
  return order;
}

/// Entry by entry the median of the curves of several random choices.
SelectionCurve random_curve(const SensorDesign& design, Eigen::Index n, std::size_t count,
                            const Eigen::VectorXd& prior_std, std::uint64_t seed) {
  std::vector<SelectionCurve> curves;
  for (int i = 0; i < k_random_choices; ++i)
    curves.push_back(curve_of(
        "random", design.along(random_order(n, count, seed + static_cast<std::uint64_t>(i))), prior_std));
  SelectionCurve median = curves[0];
  for (Eigen::Index k = 0; k < median.posterior_std.size(); ++k) {
    std::vector<double> values;
    for (const SelectionCurve& c : curves) values.push_back(c.posterior_std.data()[k]);
    median.posterior_std.data()[k] = numerics::upper_median(std::move(values));
  }
  median.name = "random (median of 5)";
  return median;
}

SensitivityCriterion paper_criterion(Criterion criterion) {
  return criterion == Criterion::minimum   ? SensitivityCriterion::minimum
         : criterion == Criterion::maximum ? SensitivityCriterion::maximum
                                           : SensitivityCriterion::product;
}

const char* name_of(Criterion criterion) {
  switch (criterion) {
    case Criterion::product:
      return "product of sensitivities";
    case Criterion::minimum:
      return "least sensitivity";
    case Criterion::maximum:
      return "largest sensitivity";
    case Criterion::d_optimal:
      return "D-optimal";
    case Criterion::information_gain:
      break;
  }
  return "information gain";
}

RankedDof describe(const model::ObservedModel& model, const Eigen::VectorXd& at,
                   const Eigen::VectorXd& prior_std, double noise_std, Eigen::Index dof) {
  model::ObservedModel one = model;
  one.space = model.space.row(dof);
  one.lift = model.lift.row(dof);
  RankedDof ranked;
  ranked.dof = dof;
  ranked.sensitivity.setZero(at.size());
  ranked.when.assign(at.size(), 0);
  for (std::size_t t = 0; t < model.time.size(); ++t) {
    const Eigen::RowVectorXd s = sensitivity_fields(one, at, t).row(0).cwiseProduct(prior_std.transpose());
    for (Eigen::Index j = 0; j < at.size(); ++j) {
      if (std::abs(s[j]) <= ranked.sensitivity[j]) continue;
      ranked.sensitivity[j] = std::abs(s[j]);
      ranked.when[j] = t;
    }
  }
  ranked.signal_to_noise = ranked.sensitivity / noise_std;
  return ranked;
}

}  // namespace

double standard_deviation(const posterior::Prior& prior) {
  // Midpoints of equal mass: the integrand is smooth in u = Φ(z) and bounded where the prior is truncated.
  constexpr int k_points = 4096;
  double mean = 0, square = 0;
  for (int i = 0; i < k_points; ++i) {
    const double p = prior.from_standard_normal(numerics::normal_quantile((i + 0.5) / k_points)).value;
    mean += p / k_points;
    square += p * p / k_points;
  }
  return std::sqrt(std::max(0.0, square - mean * mean));
}

SelectionStudy study_selection(const model::ObservedModel& model, const model::ObservedModel& whole,
                               const likelihood::NoiseModel& noise, const SelectionProblem& problem) {
  using Clock = std::chrono::steady_clock;
  const Eigen::Index d = problem.at.size(), n = model.observations();
  const std::size_t count = std::min<std::size_t>(problem.count, n);
  SelectionStudy study;
  study.prior_std.resize(d);
  for (Eigen::Index k = 0; k < d; ++k) study.prior_std[k] = standard_deviation(problem.priors[k]);

  const auto start = Clock::now();
  study.sensitivity = sensitivity_fields(whole, problem.at, problem.step) * study.prior_std.asDiagonal();
  study.score =
      sensitivity_score(noise.measurement().apply(study.sensitivity), paper_criterion(problem.criterion));
  const SensorDesign design(model, noise, study.prior_std, problem.at.transpose(), problem.positions);
  Selection chosen;
  if (problem.criterion == Criterion::d_optimal) {
    chosen = design.choose(count, problem.min_distance);
  } else if (problem.criterion == Criterion::information_gain) {
    const Eigen::MatrixXd points = prior_points(problem.priors, problem.gain_points);
    const SensorDesign average(model, noise, study.prior_std, points, problem.positions);
    const Selection best = average.choose(count, problem.min_distance);
    chosen = design.along(best.dofs);
    chosen.gain = best.gain;
  } else {
    chosen = design.along(highest(study.score, count, problem.positions, problem.min_distance));
    for (std::size_t i = 0; i < chosen.dofs.size(); ++i) chosen.gain[i] = study.score[chosen.dofs[i]];
  }
  study.choice_seconds = std::chrono::duration<double>(Clock::now() - start).count();

  for (std::size_t i = 0; i < chosen.dofs.size(); ++i) {
    const Eigen::Index k = chosen.dofs[i];
    RankedDof ranked = describe(model, problem.at, study.prior_std, design.noise_std()[k], k);
    ranked.score = chosen.gain[i];
    ranked.posterior_std = posterior_std(chosen.information[i], study.prior_std);
    study.ranked.push_back(std::move(ranked));
  }
  study.posterior_std_of_all = posterior_std(design.information_of_all(), study.prior_std);
  study.curves.push_back(curve_of(name_of(problem.criterion), chosen, study.prior_std));
  if (problem.criterion != Criterion::d_optimal) {
    study.curves.push_back(
        curve_of("D-optimal", design.choose(count, problem.min_distance), study.prior_std));
  }
  if (problem.criterion != Criterion::product) {
    const Eigen::VectorXd score =
        sensitivity_score(noise.measurement().apply(study.sensitivity), SensitivityCriterion::product);
    study.curves.push_back(curve_of("product of sensitivities (paper)",
                                    design.along(highest(score, count, problem.positions, 0)),
                                    study.prior_std));
  }
  study.curves.push_back(random_curve(design, n, count, study.prior_std, problem.seed));
  return study;
}

std::string explain(const SelectionStudy& study, std::size_t rank, const std::vector<std::string>& names) {
  const RankedDof& r = study.ranked[rank];
  const Eigen::VectorXd before = rank == 0 ? study.prior_std : study.ranked[rank - 1].posterior_std;
  std::string moved, gained;
  Eigen::Index most = 0;
  double largest = -1;
  for (Eigen::Index j = 0; j < before.size(); ++j) {
    const auto name = names[j];
    moved += fmt::format("{}{}: {:.2g} σ_noise per prior σ (step {})", moved.empty() ? "" : ", ", name,
                         r.signal_to_noise[j], r.when[j]);
    const double fall = 1 - r.posterior_std[j] / before[j];
    if (fall > largest) largest = fall, most = j;
    gained +=
        fmt::format("{}{} {:.3g} to {:.3g}", gained.empty() ? "" : ", ", name, before[j], r.posterior_std[j]);
  }
  return fmt::format("most informative about {}; {}; posterior σ of {}", names[most], moved, gained);
}

}  // namespace knothe::assimilation
