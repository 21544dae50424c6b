#include "knothe/assimilation/engine/input_errors.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>

#include "knothe/assimilation/engine/method.hpp"
#include "knothe/base/cancellation.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/progress.hpp"

namespace knothe::assimilation {
namespace {

/// The model's values at a time between or beyond its own, by straight lines.
Eigen::VectorXd predict_at(const model::ObservedModel& model, const Eigen::VectorXd& p, double time) {
  if (model.time.size() == 1) return model.predict(p, 0);
  const auto above = std::upper_bound(model.time.begin() + 1, model.time.end() - 1, time);
  const std::size_t k = above - model.time.begin();
  const double share = (time - model.time[k - 1]) / (model.time[k] - model.time[k - 1]);
  return (1 - share) * model.predict(p, k - 1) + share * model.predict(p, k);
}

/// What a datum would be if the error were in it and nowhere else: where the model is to blame, its change is
/// taken from the readings.
likelihood::Datum altered(const likelihood::Datum& datum, const InputError& error,
                          const model::ObservedModel& model, const Eigen::VectorXd& mean) {
  likelihood::Datum other = datum;
  const double f = 1 + error.relative, time = model.time[datum.time_index];
  if (error.readings.size() > 0) other.values.array() *= (std::log(f) * error.readings.array()).exp();
  Eigen::VectorXd p = mean;
  if (error.parameters.size() > 0) p.array() *= (std::log(f) * error.parameters.array()).exp();
  p = p.cwiseMax(model.functions->lower()).cwiseMin(model.functions->upper());
  if (error.clock != 0 || error.parameters.size() > 0)
    other.values -= predict_at(model, p, time * std::pow(f, error.clock)) - predict_at(model, mean, time);
  return other;
}

struct Answer {
  Eigen::VectorXd mean, std;
  double log_evidence = 0;
};

/// Nothing where the data have no posterior in the model's box, or overflow.
template <class Alter>
std::optional<Answer> posterior_of(const Problem& problem, std::span<const likelihood::DatumPointer> data,
                                   const Alter& alter) {
  try {
    const auto method = make_method(problem);
    for (const likelihood::DatumPointer& datum : data) method->add(alter(datum), datum->time_index);
    const UpdateResult& update = method->preview(data.back()->step);
    return Answer{update.mean, update.standard_deviations(), update.log_evidence};
  } catch (const NumericalError&) {
  } catch (const DataError&) {
  }
  return std::nullopt;
}

constexpr double k_hidden = 20;  // by which the log-evidence may fall: χ² rises by twice as much
constexpr int k_tries = 12;

InputShift shift_by(InputError error, const Answer& measured, const Problem& problem,
                    std::span<const likelihood::DatumPointer> data, const Eigen::VectorXd& mean) {
  InputShift shift{error.name, error.relative, false, {}, {}};
  for (int k = 0; k < k_tries; ++k) {
    const auto answer = posterior_of(problem, data, [&](const likelihood::DatumPointer& datum) {
      return std::make_shared<const likelihood::Datum>(altered(*datum, error, *problem.model, mean));
    });
    const double fall = answer ? measured.log_evidence - answer->log_evidence : 1e300;
    if (fall <= k_hidden) {
      shift.relative = error.relative;
      shift.shift = answer->mean - measured.mean;
      shift.in_std = shift.shift.cwiseQuotient(measured.std);
      break;
    }
    shift.is_limited = true;
    error.relative *= std::clamp(0.95 * std::sqrt(k_hidden / fall), 0.01, 0.95);  // it falls as a square
  }
  return shift;
}

}  // namespace

std::vector<InputShift> shifts_by(std::span<const InputError> errors, const Problem& asked,
                                  std::span<const likelihood::DatumPointer> data,
                                  const Eigen::VectorXd& mean) {
  Problem problem = asked;
  problem.update.kind = posterior::Method::automatic;
  problem.update.form = UpdateOptions::Form::collapsed;
  const auto measured =
      posterior_of(problem, data, [](const likelihood::DatumPointer& datum) { return datum; });
  std::vector<InputShift> shifts;
  if (!measured) return shifts;
  Progress progress("errors of inputs", std::ssize(errors));
  for (const InputError& error : errors) {
    if (cancellation_requested()) break;
    shifts.push_back(shift_by(error, *measured, problem, data, mean));
    progress.advance_to(shifts.size());
  }
  std::erase_if(shifts, [](const InputShift& shift) { return shift.shift.size() == 0; });
  return shifts;
}

}  // namespace knothe::assimilation
