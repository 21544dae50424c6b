#include "knothe/assimilation/verdict/misfit_diagnosis.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "knothe/assimilation/verdict/what_if_causes.hpp"
#include "knothe/numerics/integrate/sobol.hpp"

namespace knothe::assimilation {
namespace {

using Eigen::Index;

constexpr std::size_t k_looked_at = 32;     // data, evenly chosen
constexpr Index k_starts = 14;              // of a fit, beside the posterior's mean
constexpr Index k_min_equal = 4;            // values that are the largest, to the last digit
constexpr Index k_after_a_disturbance = 3;  // data that must fit again

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
    auto noise = other_noise_level(report.scores);
    if (!noise) noise = other_noise_level(causes_.plain().scores);
    if (noise && noise->factor < 1) return *noise;
    if (auto found = saturation()) return *found;
    if (!noise) {
      WhatIf assumption;
      assumption.robust = true;
      const Eigen::MatrixXd z = all_.fit(assumption).scores;
      if (auto found = few_sensors(z)) return *found;
      if (auto found = few_steps(z)) return *found;
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

  /// Many values of a group are its largest, to the last digit: the range of the sensors ends there. One
  /// sensor alone is named by `few_sensors`.
  [[nodiscard]] std::optional<Diagnosis> saturation() const {
    const auto groups = std::max<Index>(1, std::ssize(tests_.group_names()));
    Eigen::MatrixXd values = all_.values();
    double end = 0;
    Index equal = 0;
    for (Index g = 0; g < groups; ++g) {
      double largest = 0;
      const auto each = [&](auto&& use) {
        for (Index i = 0; i < values.rows(); ++i)
          for (Index k = 0; tests_.groups()[i] == g && k < values.cols(); ++k) use(values(i, k));
      };
      each([&](double v) { largest = std::max(largest, std::abs(v)); });
      Index here = 0;
      each([&](double v) { here += std::abs(v) == largest ? 1 : 0; });
      if (largest == 0 || here < k_min_equal) continue;
      each([&](double& v) { v = std::abs(v) == largest ? std::nan("") : v; });
      equal += here, end = largest;
    }
    const Index sensors = (values.array().isNaN() && !all_.values().array().isNaN()).rowwise().any().count();
    if (sensors < 2 || !fits(all_.with(values))) return {};
    return Diagnosis{MisfitCause::saturation,
                     fmt::format("{} values are {:.6g} to the last digit, all others fit: the range of the "
                                 "sensors ends there; give these as missing",
                                 equal, end),
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

  /// All is well without some steps in succession, and after them again.
  [[nodiscard]] std::optional<Diagnosis> few_steps(const Eigen::MatrixXd& z) const {
    const Index m = z.cols();
    Index first = m, last = -1;
    for (Index k = 0; k < m; ++k) {
      const double present = (z.col(k).array() != 0).count();
      if (z.col(k).squaredNorm() < present + 6 * std::sqrt(2 * present)) continue;
      first = std::min(first, k), last = k;
    }
    if (last < 0 || last - first + 1 > m / 3 || first < 1 || m - 1 - last < k_after_a_disturbance) return {};
    Eigen::MatrixXd values = all_.values();
    values.middleCols(first, last - first + 1).setConstant(std::nan(""));
    if (!fits(all_.with(values))) return {};
    return Diagnosis{MisfitCause::few_steps,
                     fmt::format("the data of steps {} to {} do not fit, those before and after do: an "
                                 "unloading, or a disturbance; withdraw them",
                                 data_[first]->step, data_[last]->step),
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
