#include "knothe/assimilation/verdict/misfit_diagnosis.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "knothe/assimilation/verdict/what_if_fit.hpp"
#include "knothe/numerics/integrate/sobol.hpp"

namespace knothe::assimilation {
namespace {

using Eigen::Index;

constexpr std::size_t k_looked_at = 32;   // data, evenly chosen
constexpr Index k_starts = 14;            // of a fit, beside the posterior's mean
constexpr Index k_matched_sensors = 300;  // whose order is looked for: the cost grows with their square

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

/// An assumption that was tried.
struct Tried {
  MisfitCause cause;
  double misfit;
  std::string message;
  bool is_exact = false;  ///< of a factor: a sign or a unit
};

class Diagnostician {
 public:
  Diagnostician(const model::ObservedModel& model, const ResidualTests& tests,
                const posterior::PriorTransform& priors, std::span<const likelihood::DatumPointer> data,
                const Eigen::VectorXd& p, double limit)
      : tests_(tests),
        data_(data),
        few_(some_of(data)),
        fits_(model, tests, few_, starts_of(priors, p)),
        model_(model),
        limit_(limit),
        parameters_(p.size()) {}

  [[nodiscard]] Diagnosis diagnose(const ResidualReport& report) {
    const WhatIfAnswer plain = fits_.fit({});
    base_ = plain.misfit;
    auto noise = other_noise_level(report.scores);
    if (!noise) noise = other_noise_level(plain.scores);
    if (noise && noise->factor < 1) return *noise;
    if (!noise)
      if (auto found = few_sensors()) return *found;
    try_factors();
    try_shift();
    try_swapped_components();
    if (!noise) try_sensor_order(plain);
    // The first that explains the data where the model alone does not, or else what takes most away. More
    // noise would explain whatever else is small: it comes last.
    auto best = tried_.end();
    if (!explains(base_))
      best = std::find_if(tried_.begin(), tried_.end(), [&](const Tried& t) { return explains(t.misfit); });
    if (noise && best == tried_.end()) return *noise;
    if (best == tried_.end())
      best = std::min_element(tried_.begin(), tried_.end(),
                              [](const Tried& a, const Tried& b) { return a.misfit < b.misfit; });
    if (best != tried_.end() && ((explains(best->misfit) && !explains(base_)) || best->misfit < 0.2 * base_))
      return {best->cause, best->message, 1};
    return {MisfitCause::unknown,
            "no common data error explains it: check the model's supports, load, stiffness and law "
            "against the specimen, or let bias_correction = \"auto\" allow for it",
            1};
  }

 private:
  [[nodiscard]] bool explains(double misfit) const {
    const double n = fits_.present();
    return misfit < n * (1 + 5 * std::sqrt(2 / n));
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

  /// All is well without a few of the sensors, or of the values.
  [[nodiscard]] std::optional<Diagnosis> few_sensors() const {
    WhatIfFits all(model_, tests_, data_, fits_.starts());
    Eigen::MatrixXd z = all.fit({.order = {}, .scaled = {}, .shifted = false, .robust = true}).scores;
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
      if (const auto scaled = factor_of_sensor(sensors[0]);
          scaled && scaled->is_exact && explains(scaled->misfit))
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

  [[nodiscard]] std::optional<Tried> factor_of_sensor(Index sensor) const {
    const bool is_scalar = tests_.is_scalar(sensor);
    const std::string name = tests_.name_of(sensor);
    return factor_of(Eigen::VectorXd::Unit(tests_.noise().size(), sensor), "values of " + name,
                     is_scalar ? name : "its axis", !is_scalar);
  }

  [[nodiscard]] std::optional<Tried> factor_of(const Eigen::VectorXd& rows, const std::string& what,
                                               const std::string& axis, bool is_displacement) const {
    const WhatIfAnswer answer = fits_.fit({.order = {}, .scaled = rows, .shifted = false, .robust = false});
    const double f = answer.factor;
    if (std::abs(f - 1) < 1e-3) return {};
    if (std::abs(f + 1) < 0.1)
      return Tried{MisfitCause::sign, answer.misfit,
                   fmt::format("{} look like the model's times −1: check the sign of {}", what, axis), true};
    const double power = std::round(std::log10(std::abs(f)));
    const bool is_unit = power != 0 && std::abs(std::log10(std::abs(f)) - power) < 0.05;
    return Tried{MisfitCause::scale, answer.misfit,
                 is_unit
                     ? fmt::format("{} look like the model's times {}: check their unit{}", what,
                                   f < 0 ? fmt::format("−10^{:.0f}", power) : fmt::format("10^{:.0f}", power),
                                   is_displacement ? " (m is expected)" : "")
                     : fmt::format("{} look like the model's times {:.4g}: check unit, scale and calibration",
                                   what, f),
                 is_unit};
  }

  void try_factor(const Eigen::VectorXd& rows, const std::string& what, const std::string& axis,
                  bool is_displacement) {
    if (auto tried = factor_of(rows, what, axis, is_displacement)) tried_.push_back(std::move(*tried));
  }

  void try_factors() {
    const model::Sensors& sensors = tests_.sensors();
    const Index n = tests_.noise().size();
    const auto displacements = sensors.size() == 0 ? n : static_cast<Index>(sensors.displacement_count());
    if (displacements > 0) {
      Eigen::VectorXd rows = Eigen::VectorXd::Zero(n);
      rows.head(displacements).setOnes();
      try_factor(rows, displacements == n ? "the data" : "the displacements", "the axes", true);
    }
    const auto& names = tests_.group_names();
    if (names.size() < 2) return;
    for (Index g = 0; g < std::ssize(names); ++g) {
      Eigen::VectorXd rows = Eigen::VectorXd::Zero(n);
      for (Index i = 0; i < n; ++i) rows[i] = tests_.groups()[i] == g ? 1 : 0;
      const bool is_component = names[g].size() == 1;
      try_factor(rows, is_component ? "displacements along " + names[g] : "values of \"" + names[g] + "\"",
                 is_component ? "the " + names[g] + " axis" : "\"" + names[g] + "\"", is_component);
      // Series of one unit, a force beside them.
      if (names.size() > 2)
        try_factor(Eigen::VectorXd::Ones(n) - rows, "all values but those of \"" + names[g] + "\"",
                   "all but \"" + names[g] + "\"", false);
    }
  }

  void try_shift() {
    const WhatIfAnswer answer = fits_.fit({.order = {}, .scaled = {}, .shifted = true, .robust = false});
    const double steps = answer.shift;
    if (std::abs(steps) < 0.05) return;
    tried_.push_back({MisfitCause::time_shift, answer.misfit,
                      fmt::format("the data match the model {:.2g} steps {}: check the clock, and where "
                                  "the test begins",
                                  std::abs(steps), steps > 0 ? "later" : "earlier")});
  }

  /// The other component at the same point.
  void try_swapped_components() {
    const model::Sensors& sensors = tests_.sensors();
    const std::size_t n = sensors.displacement_count();
    for (int a = 0; a < 3; ++a) {
      for (int b = a + 1; b < 3; ++b) {
        std::vector<Index> order(sensors.size());
        bool swapped = false;
        for (std::size_t i = 0; i < sensors.size(); ++i) {
          order[i] = i;
          if (i >= n || (sensors.components[i] != a && sensors.components[i] != b)) continue;
          for (std::size_t j = 0; j < n; ++j) {
            if (sensors.components[j] != a + b - sensors.components[i]) continue;
            const auto x = sensors.point(i), y = sensors.point(j);
            if (std::equal(x.begin(), x.end(), y.begin())) order[i] = j, swapped = true;
          }
        }
        if (!swapped) continue;
        const WhatIfAnswer answer =
            fits_.fit({.order = order, .scaled = {}, .shifted = false, .robust = false});
        tried_.push_back({MisfitCause::component, answer.misfit,
                          fmt::format("the components {} and {} look swapped: check the columns of the data",
                                      "xyz"[a], "xyz"[b])});
      }
    }
  }

  /// Each sensor compared with what the model says of every other one.
  void try_sensor_order(const WhatIfAnswer& plain) {
    const Index n = tests_.noise().size();
    if (n > k_matched_sensors || n < 3 || few_.size() < 2) return;
    const Eigen::MatrixXd& values = fits_.values();
    double best_cost = std::numeric_limits<double>::infinity();
    std::vector<Index> best;
    for (Index s = 0; s <= fits_.starts().rows(); ++s) {
      const Eigen::VectorXd p = s == 0 ? plain.p : Eigen::VectorXd(fits_.starts().row(s - 1).transpose());
      const Eigen::MatrixXd y = fits_.predicted(p);
      std::vector<Index> order(n);
      double cost = 0;
      for (Index i = 0; i < n; ++i) {
        const auto there = values.row(i).array() == values.row(i).array();
        double least = std::numeric_limits<double>::infinity();
        for (Index j = 0; j < n; ++j) {
          const double square = there.select((values.row(i) - y.row(j)).array().square(), 0.0).sum();
          if (square < least) least = square, order[i] = j;
        }
        cost += least * tests_.inverse_std()[i] * tests_.inverse_std()[i];
      }
      if (cost < best_cost) best_cost = cost, best = order;
    }
    Index moved = 0;
    for (Index i = 0; i < n; ++i) moved += best[i] != i ? 1 : 0;
    if (moved < 2) return;
    const WhatIfAnswer answer = fits_.fit({.order = best, .scaled = {}, .shifted = false, .robust = false});
    tried_.push_back(
        {MisfitCause::sensor_order, answer.misfit,
         fmt::format("{} of {} sensors fit better at another sensor's position: check the order of the "
                     "columns, and the places of the sensors",
                     moved, n)});
  }

  const ResidualTests& tests_;
  std::span<const likelihood::DatumPointer> data_;
  std::vector<likelihood::DatumPointer> few_;
  WhatIfFits fits_;
  const model::ObservedModel& model_;
  double limit_;
  Index parameters_;
  double base_ = 0;
  std::vector<Tried> tried_;
};

}  // namespace

Diagnosis diagnose(const model::ObservedModel& model, const ResidualTests& tests,
                   const posterior::PriorTransform& priors, std::span<const likelihood::DatumPointer> data,
                   const Eigen::VectorXd& p, const ResidualReport& report, double limit) {
  return Diagnostician(model, tests, priors, data, p, limit).diagnose(report);
}

}  // namespace knothe::assimilation
