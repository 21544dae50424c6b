#include "knothe/assimilation/verdict/misfit_diagnosis.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "knothe/assimilation/verdict/what_if_causes.hpp"
#include "knothe/numerics/integrate/sobol.hpp"

namespace knothe::assimilation {
namespace {

using Eigen::Index;

constexpr std::size_t k_looked_at = 32;     // data, evenly chosen
constexpr Index k_starts = 14;              // of a fit, beside the posterior's mean
constexpr Index k_min_equal = 4;            // values that are the largest of a group
constexpr Index k_min_equal_of_one = 2;     // of a sensor
constexpr Index k_min_equal_data = 8;       // of two sensors: fewer rounded values may be equal by chance
constexpr double k_one_end = 0.99;          // of the largest: ends of one range
constexpr double k_noise_at_the_end = 8;    // standard deviations between values at the end of a range
constexpr Index k_after_a_disturbance = 3;  // data that must fit again
constexpr Index k_max_gap = 2;              // steps between two of one disturbance
constexpr double k_of_one_value = 16;       // most that a value adds to the misfit of its step

/// Evenly chosen, the first and the last among them.
std::vector<likelihood::DatumPointer> some_of(std::span<const likelihood::DatumPointer> data) {
  if (data.size() <= k_looked_at) return {data.begin(), data.end()};
  std::vector<likelihood::DatumPointer> chosen;
  for (std::size_t k = 0; k < k_looked_at; ++k)
    chosen.push_back(data[k * (data.size() - 1) / (k_looked_at - 1)]);
  return chosen;
}

Eigen::MatrixXd starts_of(const posterior::PriorTransform& priors, const Eigen::VectorXd& p) {
  Eigen::MatrixXd z = numerics::sobol_normal_points(k_starts, p.size(), 7);
  z.row(0).setZero();
  Eigen::MatrixXd points(z.rows(), z.cols()), none;
  priors.evaluate(z, 0, points, none, none);
  Eigen::MatrixXd starts(z.rows() + 1, z.cols());
  starts << p.transpose(), points;
  return starts;
}

class Diagnostician {
 public:
  Diagnostician(const model::ObservedModel& model, const ResidualTests& tests,
                const posterior::PriorTransform& priors, std::span<const likelihood::DatumPointer> data,
                const Eigen::VectorXd& p, double limit)
      : tests_(tests),
        data_(data),
        few_(some_of(data)),
        fits_(model, tests, few_, starts_of(priors, p)),
        all_(model, tests, data, fits_.starts()),
        causes_(tests, few_, fits_, data, all_, limit),
        limit_(limit),
        parameters_(p.size()) {}

  [[nodiscard]] Diagnosis diagnose(const ResidualReport& report) {
    if (auto found = sensors_twice()) return *found;
    auto noise = other_noise_level(report.scores);
    if (!noise) noise = other_noise_level(causes_.plain().scores);
    if (noise && noise->factor < 1) return *noise;
    if (auto found = saturation()) return *found;
    if (!noise) {
      WhatIf assumption;
      assumption.robust = true;
      const Eigen::MatrixXd z = all_.fit(assumption).scores;
      // Many values may well be those of a few steps.
      const auto found = few_sensors(z);
      if (found && found->cause != MisfitCause::unknown) return *found;
      if (auto steps = few_steps(z)) return *steps;
      if (found) return *found;
    }
    // More noise would explain whatever else is small: it comes last.
    const auto found = causes_.find(!noise);
    if (noise && !(found && found->explains && !causes_.fits_plainly())) return *noise;
    if (found) return {found->cause, found->message, 1};
    return {MisfitCause::unknown,
            "no common data error explains it: check the model's supports, load, stiffness and law "
            "against the specimen, or let bias_correction = \"auto\" allow for it",
            1};
  }

 private:
  [[nodiscard]] bool fits(const WhatIfFits& some) const {
    const double n = some.present();
    return n > 2.0 * parameters_ + 8 && some.fit({}).misfit < n * (1 + 5 * std::sqrt(2 / n));
  }

  /// White residuals, but larger or smaller than stated.
  [[nodiscard]] std::optional<Diagnosis> other_noise_level(const Eigen::MatrixXd& scores) const {
    if (!tests_.noise().measurement().is_independent()) return {};
    const double present = (scores.array() != 0).count();
    if (present < 2.0 * parameters_ + 8) return {};
    const double factor = std::sqrt(scores.squaredNorm() / (present - parameters_));
    if (std::abs(std::log(factor)) < 0.05) return {};
    if (tests_.examine_scores(scores / factor, parameters_).fails(limit_)) return {};
    return Diagnosis{
        MisfitCause::noise_level,
        fmt::format("the residuals look like pure noise, but {:.3g} times the standard deviation "
                    "that is stated: correct it, or let noise_level = \"unknown\" find it",
                    factor),
        factor};
  }

  /// Sensors that have another's values in all data: one measurement that counts twice.
  [[nodiscard]] std::optional<Diagnosis> sensors_twice() const {
    const Eigen::MatrixXd& values = all_.values();
    const Index n = values.rows(), m = values.cols();
    if (m < k_min_equal_data) return {};
    std::vector<Index> order(n);
    std::iota(order.begin(), order.end(), Index{0});
    const auto at = [&](Index i, Index k) { return std::isnan(values(i, k)) ? 0 : values(i, k); };
    const auto differ_at = [&](Index i, Index j) {
      Index k = 0;
      while (k < m && at(i, k) == at(j, k)) ++k;
      return k;
    };
    std::sort(order.begin(), order.end(), [&](Index i, Index j) {
      const Index k = differ_at(i, j);
      return k == m ? i < j : at(i, k) < at(j, k);
    });
    const auto is_constant = [&](Index i) {  // dead, or not there at all
      Index k = 1;
      while (k < m && at(i, k) == at(i, 0)) ++k;
      return k == m;
    };
    Eigen::MatrixXd once = values;
    Index twice = 0, first = 0, second = 0;
    for (Index k = 1; k < n; ++k) {
      const Index i = order[k - 1], j = order[k];
      if (differ_at(i, j) < m || is_constant(j)) continue;
      once.row(j).setConstant(std::nan(""));
      if (twice++ == 0) first = i, second = j;
    }
    if (twice == 0 || !fits(all_.with(once))) return {};
    return Diagnosis{
        MisfitCause::single_sensor,
        fmt::format("{} of {} sensors have the values of another, to the last digit ({} those of {}), and "
                    "count twice: leave them out",
                    twice, n, tests_.name_of(second), tests_.name_of(first)),
        1};
  }

  /// Many values of a group are its largest, to the last digit or, with noise after it, nearly; or many of a
  /// sensor are its own largest: the range of the sensors ends there. One sensor alone is named by
  /// `few_sensors`.
  [[nodiscard]] std::optional<Diagnosis> saturation() const {
    const auto groups = std::max<Index>(1, std::ssize(tests_.group_names()));
    if (const auto end = saturation_of(tests_.groups(), groups, k_min_equal, 0)) return end;
    if (causes_.fits_plainly()) return {};
    if (const auto end = saturation_of(tests_.groups(), groups, k_min_equal, k_noise_at_the_end)) return end;
    std::vector<Index> each(all_.values().rows());
    std::iota(each.begin(), each.end(), Index{0});
    return saturation_of(each, std::ssize(each), k_min_equal_of_one, 0);
  }

  /// All fits without the values less than `width` standard deviations below the largest of their group,
  /// where there are at least `fewest`.
  [[nodiscard]] std::optional<Diagnosis> saturation_of(const std::vector<Index>& group_of, Index groups,
                                                       Index fewest, double width) const {
    const Eigen::MatrixXd size = all_.values().cwiseAbs();
    Eigen::VectorXd largest = Eigen::VectorXd::Zero(groups);
    Eigen::VectorXi at_end = Eigen::VectorXi::Zero(groups);
    const auto each = [&](auto&& use) {
      for (Index i = 0; i < size.rows(); ++i)
        for (Index k = 0; k < size.cols(); ++k) use(i, k, group_of[i]);
    };
    const auto is_at_end = [&](Index i, Index k, Index g) {
      const double inverse_std = tests_.inverse_std()[i];
      return largest[g] > 0 && inverse_std > 0 && (largest[g] - size(i, k)) * inverse_std <= width;
    };
    each([&](Index i, Index k, Index g) { largest[g] = std::max(largest[g], size(i, k)); });
    each([&](Index i, Index k, Index g) { at_end[g] += is_at_end(i, k, g); });
    const auto ends = at_end.array() >= fewest;
    Eigen::MatrixXd values = all_.values();
    each([&](Index i, Index k, Index g) {
      if (ends[g] && is_at_end(i, k, g)) values(i, k) = std::nan("");
    });
    const auto is_missing = values.array().isNaN();
    const Index sensors = (is_missing && !size.array().isNaN()).rowwise().any().count();
    if (sensors < 2 || !fits(all_.with(values))) return {};
    const double end = ends.select(largest.array(), 0.0).maxCoeff();
    const bool is_one = (!ends || largest.array() > k_one_end * end).all();
    return Diagnosis{
        MisfitCause::saturation,
        fmt::format("{} values of {} sensors are {}{}, all others fit: the range of the sensors ends there; "
                    "give these as missing",
                    ends.select(at_end.array(), 0).sum(), sensors,
                    is_one ? fmt::format("{:.{}g}", end, width > 0 ? 2 : 6) : "the largest of their series",
                    width > 0 ? " but for noise" : " to the last digit"),
        1};
  }

  /// All is well without a few of the sensors, or of the values.
  [[nodiscard]] std::optional<Diagnosis> few_sensors(Eigen::MatrixXd z) const {
    std::vector<Index> sensors;
    Index values = 0, at = 0;
    const Index n = z.rows(), m = z.cols();
    for (Index i = 0; i < n; ++i) {
      const Index far = (z.row(i).array().abs() > 4.5).count();
      const auto near = z.row(i).array().abs() <= 4.5;
      const double mean = near.select(z.row(i).array(), 0.0).sum() / std::sqrt(m);
      if (m > 2 && (3 * far > m || std::abs(mean) > 5)) {
        sensors.push_back(i);
        z.row(i).setZero();
      } else if (far > 0) {
        for (Index k = 0; k < m; ++k)
          if (std::abs(z(i, k)) > 4.5) z(i, k) = 0, ++values, at = k * n + i;
      }
    }
    const auto most = std::max<Index>(1, n / 10);
    if (sensors.empty() && values == 0) return {};
    if (std::ssize(sensors) > most || 10 * values > n * m) return {};
    // Values just below the limit are still there: not as strict as elsewhere.
    if (tests_.noise().measurement().is_independent() &&
        tests_.examine_scores(z, parameters_).fails(1e-4 * limit_))
      return {};
    if (!tests_.noise().measurement().is_independent() && z.squaredNorm() > 1.5 * ((z.array() != 0).count()))
      return {};
    if (sensors.size() > 1) {
      std::string names = tests_.name_of(sensors[0]);
      for (std::size_t k = 1; k < std::min<std::size_t>(sensors.size(), 5); ++k)
        names += ", " + tests_.name_of(sensors[k]);
      return Diagnosis{
          MisfitCause::single_sensor,
          fmt::format("{} sensors do not fit, all others do: {}{}: leave them out, or repair them",
                      sensors.size(), names, sensors.size() > 5 ? ", …" : ""),
          1};
    }
    if (sensors.size() == 1)
      if (const auto scaled = causes_.factor_of_sensor(sensors[0]);
          scaled && scaled->is_exact && scaled->explains)
        return Diagnosis{scaled->cause, scaled->message, 1};
    if (sensors.size() == 1 && tests_.is_scalar(sensors[0]) && tests_.sensors().displacement_count() > 0)
      return Diagnosis{
          MisfitCause::single_sensor,
          fmt::format("{} does not fit, the displacements do: check its calibration, and what the "
                      "model takes for it (Young's modulus, thickness)",
                      tests_.name_of(sensors[0])),
          1};
    if (sensors.size() == 1)
      return Diagnosis{MisfitCause::single_sensor,
                       fmt::format("{} does not fit, all others do: leave it out, or repair it",
                                   tests_.name_of(sensors[0])),
                       1};
    if (values == 1)
      return Diagnosis{MisfitCause::single_sensor,
                       fmt::format("one value of {}, at step {}, does not fit, all others do: withdraw or "
                                   "correct it, or let method.gate reject such values",
                                   tests_.name_of(at % n), data_[at / n]->step),
                       1};
    return Diagnosis{MisfitCause::unknown,
                     fmt::format("{} single values of {} do not fit, all others do: let method.gate reject "
                                 "such values, or use likelihood = \"student-t\"",
                                 values, n * m),
                     1};
  }

  /// All is well without some steps, and after them again.
  [[nodiscard]] std::optional<Diagnosis> few_steps(const Eigen::MatrixXd& z) const {
    const Index m = z.cols();
    std::vector<std::pair<Index, Index>> runs;  // first and last of steps that do not fit
    for (Index k = 0; k < m; ++k) {
      // A few values that stand out do not make it a step.
      const double misfit = z.col(k).array().square().min(k_of_one_value).sum();
      const double present = (z.col(k).array() != 0).count();
      if (misfit < present + 6 * std::sqrt(2 * present)) continue;
      if (runs.empty() || k - runs.back().second > k_max_gap) runs.emplace_back(k, k);
      runs.back().second = k;
    }
    if (runs.empty() || runs.front().first < 1 || m - 1 - runs.back().second < k_after_a_disturbance)
      return {};
    Eigen::MatrixXd values = all_.values();
    Index left_out = 0;
    std::vector<std::string> steps;
    for (const auto& [first, last] : runs) {
      values.middleCols(first, last - first + 1).setConstant(std::nan(""));
      left_out += last - first + 1;
      steps.push_back(first == last ? fmt::format("{}", data_[first]->step)
                                    : fmt::format("{} to {}", data_[first]->step, data_[last]->step));
    }
    if (left_out > m / 3 || !fits(all_.with(values))) return {};
    return Diagnosis{
        MisfitCause::few_steps,
        fmt::format("the data of step{} {} do not fit, those before and after do: an unloading, or a "
                    "disturbance; withdraw them",
                    left_out > 1 ? "s" : "", fmt::join(steps, ", ")),
        1};
  }

  const ResidualTests& tests_;
  std::span<const likelihood::DatumPointer> data_;
  std::vector<likelihood::DatumPointer> few_;
  WhatIfFits fits_, all_;
  WhatIfCauses causes_;
  double limit_;
  Index parameters_;
};

}  // namespace

Diagnosis diagnose(const model::ObservedModel& model, const ResidualTests& tests,
                   const posterior::PriorTransform& priors, std::span<const likelihood::DatumPointer> data,
                   const Eigen::VectorXd& p, const ResidualReport& report, double limit) {
  return Diagnostician(model, tests, priors, data, p, limit).diagnose(report);
}

}  // namespace knothe::assimilation
