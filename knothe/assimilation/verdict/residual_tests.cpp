#include "knothe/assimilation/verdict/residual_tests.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "knothe/numerics/linear/symmetric_eigen.hpp"
#include "knothe/numerics/statistics/chi_squared.hpp"
#include "knothe/numerics/statistics/normal_distribution.hpp"

namespace knothe::assimilation {
namespace {

using Eigen::Index;

constexpr Index k_modes = 12;             // of the model's space modes, those the sensors see best
constexpr Index k_parts = 8;              // of the data, in time
constexpr double k_min_products = 50;     // whose sum is taken for normal
constexpr Index k_values_per_error = 50;  // of a step: then its values are nearly independent without it
constexpr double k_equal = 1e-6;          // standard deviations: so near are no two measurements

/// The largest of `count` statistics of χ² distribution, and the probability that chance makes the largest so
/// large. They are compared by the scores of Wilson and Hilferty (1931): one exact probability is enough.
class LargestChiSquare {
 public:
  void see(double x, double degrees, Index at) {
    ++count_;
    if (degrees == degrees_ && x <= x_) return;
    const double variance = 2 / (9 * degrees);
    const double score = (std::cbrt(x / degrees) - (1 - variance)) / std::sqrt(variance);
    if (count_ == 1 || score > score_) score_ = score, x_ = x, degrees_ = degrees, at_ = at;
  }
  void report_worst(ResidualReport& report, ResidualTest test) const {
    if (count_ == 0) return;
    report.set(test, std::min(1.0, numerics::chi_squared_upper(x_, degrees_) * count_), at_);
  }

 private:
  double score_ = 0, x_ = 0, degrees_ = 0;
  Index at_ = 0, count_ = 0;
};

double two_sided(double z) {
  return 2 * numerics::normal_cdf(-std::abs(z));
}

/// rᵀ (R + F Fᵀ)⁻¹ r with F = `error`, of the values that are there; `residual` is 0 at the others.
double misfit_with(const Eigen::MatrixXd& error, const Eigen::VectorXd& values,
                   const likelihood::GaussianNoise& noise, const Eigen::VectorXd& residual) {
  Eigen::MatrixXd seen = error;
  for (Index i = 0; i < values.size(); ++i)
    if (std::isnan(values[i])) seen.row(i).setZero();
  return residual.dot(likelihood::apply_with_error(noise, seen, residual).col(0));
}

/// What is left of a residual (0 where nothing was measured) without the error F z of its step, z ~ N(0, I),
/// as it is known from all values: R (R + F Fᵀ)⁻¹ r, each over its own standard deviation. 0 where the error
/// takes nearly all.
Eigen::VectorXd scores_beside(const Eigen::MatrixXd& error, const Eigen::VectorXd& inverse_variance,
                              const Eigen::VectorXd& residual) {
  constexpr double k_min_left = 0.05;
  Eigen::MatrixXd seen = error;
  for (Index i = 0; i < residual.size(); ++i)
    if (residual[i] == 0) seen.row(i).setZero();
  const Eigen::MatrixXd weighted = inverse_variance.asDiagonal() * seen;
  const Index q = error.cols();
  const Eigen::LDLT<Eigen::MatrixXd> information(Eigen::MatrixXd::Identity(q, q) +
                                                 seen.transpose() * weighted);
  Eigen::VectorXd scores = residual - seen * information.solve(weighted.transpose() * residual);
  const Eigen::MatrixXd taken = information.solve(weighted.transpose());
  for (Index i = 0; i < scores.size(); ++i) {
    const double left = 1 - seen.row(i).dot(taken.col(i));
    scores[i] *= left > k_min_left ? std::sqrt(inverse_variance[i] / left) : 0.0;
  }
  return scores;
}

/// Each sensor with the nearest that measures the same component, the first of several: also one of its
/// place, whose noise is its own unless it is the same measurement.
std::vector<std::array<Index, 2>> nearest_of_same_component(const model::Sensors& sensors) {
  std::set<std::array<Index, 2>> pairs;
  for (int component = 0; component < 3; ++component) {
    std::vector<std::pair<double, Index>> by_x;
    for (Index i = 0; i < std::ssize(sensors.components); ++i)
      if (sensors.components[i] == component) by_x.emplace_back(sensors.point(i)[0], i);
    std::sort(by_x.begin(), by_x.end());
    for (Index at = 0; at < std::ssize(by_x); ++at) {
      const Index i = by_x[at].second;
      std::pair nearest(std::numeric_limits<double>::infinity(), i);  // square of the distance, sensor
      // Away from it in x, until x alone is too far.
      for (const Index way : {-1, 1})
        for (Index k = at + way; k >= 0 && k < std::ssize(by_x); k += way) {
          if (std::pow(by_x[k].first - by_x[at].first, 2) > nearest.first) break;
          const Index j = by_x[k].second;
          double square = 0;
          for (std::size_t a = 0; a < 3; ++a)
            square += std::pow(sensors.point(i)[a] - sensors.point(j)[a], 2);
          nearest = std::min(nearest, std::pair(square, j));
        }
      if (nearest.second != i) pairs.insert({std::min(i, nearest.second), std::max(i, nearest.second)});
    }
  }
  return {pairs.begin(), pairs.end()};
}

}  // namespace

ResidualTest ResidualReport::worst(double limit) const {
  if (of(ResidualTest::repeated) < limit) return ResidualTest::repeated;
  auto worst = ResidualTest::total, of_model = ResidualTest::total;
  for (std::size_t k = 0; k < k_residual_tests; ++k) {
    const auto test = static_cast<ResidualTest>(k);
    if (probability[k] < of(worst)) worst = test;
    if (probability[k] < of(of_model) && !is_about_noise(test)) of_model = test;
  }
  return of(of_model) < limit ? of_model : worst;
}

ResidualTests::ResidualTests(std::shared_ptr<const model::ObservedModel> model, likelihood::NoiseModel noise,
                             model::Sensors sensors)
    : model_(std::move(model)),
      noise_(std::move(noise)),
      sensors_(std::move(sensors)),
      groups_(noise_.size(), 0) {
  const Index n = noise_.size();
  const likelihood::GaussianNoise& measurement = noise_.measurement();
  inverse_std_ = measurement.is_independent() ? Eigen::VectorXd(measurement.inverse_variance())
                                              : Eigen::VectorXd(measurement.precision().diagonal());
  // Errors that steps share are no part of R.
  for (Index i = 0; i < n; ++i) {
    double& precision = inverse_std_[i];
    if (!(precision > 0)) continue;
    precision = 1 / std::sqrt(1 / precision + noise_.offset_std() * noise_.offset_std());
  }
  measured_ = (inverse_std_.array() > 0).count();
  std_ = inverse_std_.unaryExpr([](double s) { return s > 0 ? 1 / s : 0.0; });
  if (std::ssize(sensors_) == n) {
    for (int c = 0; c < 3; ++c) {
      bool there = false;
      for (std::size_t i = 0; i < sensors_.displacement_count(); ++i) {
        if (sensors_.components[i] != c) continue;
        groups_[i] = std::ssize(group_names_);
        there = true;
      }
      if (there) group_names_.emplace_back(1, "xyz"[c]);
    }
    for (std::size_t k = 0; k < sensors_.scalars.size(); ++k) {
      groups_[sensors_.displacement_count() + k] = std::ssize(group_names_);
      group_names_.push_back(sensors_.scalars[k]);
    }
    neighbours_ = nearest_of_same_component(sensors_);
    const auto scalars = std::ssize(sensors_.scalars);
    if (scalars > 0 && n > 1)
      for (const Eigen::MatrixXd& core : model_->core)
        series_rows_.emplace_back(model_->space.bottomRows(scalars) * core);
  } else {
    sensors_ = {};
  }
  const Index l = model_->space.cols(), r = model_->functions->count();
  // Of one step alone space and core together are dear; of all at once the product with space costs a sixth.
  has_rows_ = n * r < l * (n / 6 + r);
  const Eigen::MatrixXd weighted = measurement.apply(model_->space);  // n × l
  const numerics::SymmetricEigen modes(model_->space.transpose() * weighted);
  const double enough = 1e-8 * modes.eigenvalues().tail(1)[0];
  Index k = 0;
  while (k < std::min({k_modes, modes.eigenvalues().size(), n / 2}) &&
         modes.eigenvalues()[modes.eigenvalues().size() - 1 - k] > enough)
    ++k;
  modal_ = modes.eigenvalues().tail(k).cwiseSqrt().cwiseInverse().asDiagonal() *
           (modes.eigenvectors().rightCols(k).transpose() * weighted.transpose());
}

std::string ResidualTests::name_of(Index sensor) const {
  const std::size_t i = sensor;
  if (i >= sensors_.size()) return fmt::format("sensor {}", sensor);
  if (i >= sensors_.displacement_count())
    return fmt::format("\"{}\"", sensors_.scalars[i - sensors_.displacement_count()]);
  const auto at = sensors_.point(i);
  return fmt::format(
      "sensor {} ({} at {:.4g}, {:.4g}, {:.4g} m)",
      sensors_.names.empty() ? std::to_string(sensor) : fmt::format("\"{}\"", sensors_.label(i)),
      "xyz"[sensors_.components[i]], at[0], at[1], at[2]);
}

ResidualReport ResidualTests::examine(std::span<const likelihood::DatumPointer> data,
                                      const Eigen::VectorXd& w, double level, Index parameters,
                                      std::span<const EstimatedError> lasting) {
  const Index n = noise_.size(), m = std::ssize(data);
  Eigen::MatrixXd residuals(n, m);
  if (has_rows_) {
    for (Index k = 0; k < m; ++k) residuals.col(k).noalias() = rows_at(data[k]->time_index) * -w;
  } else {
    Eigen::MatrixXd coefficients(model_->space.cols(), m);
    for (Index k = 0; k < m; ++k) coefficients.col(k).noalias() = model_->core[data[k]->time_index] * w;
    residuals.noalias() = -(model_->space * coefficients);
  }
  ResidualReport report;
  report.probability.fill(1);
  report.scores.setZero(n, m);
  LargestChiSquare steps;
  Index most_errors = 0;  // of a step
  bool own = false, all_in_modes = true;
  const double scale = 1 / std::sqrt(level);
  for (Index k = 0; k < m; ++k) {
    const likelihood::Datum& datum = *data[k];
    auto residual = residuals.col(k);
    residual += datum.values - model_->lift.col(datum.time_index);
    if (!lasting.empty()) residual -= expected_error(noise_.lasting(), datum.step, lasting);
    Index present = measured_;
    if (std::isnan(residual.sum()))
      for (Index i = 0; i < n; ++i)
        if (std::isnan(residual[i])) {
          residual[i] = 0;
          present -= inverse_std_[i] > 0;
        }
    if (present == 0) continue;  // a picture that is gone
    residual *= scale;
    const likelihood::GaussianNoise& noise = datum.noise ? *datum.noise : noise_.at_step(datum.step);
    const bool is_own = datum.noise || likelihood::has_own_noise(noise_, datum.step);
    own = own || is_own;
    double misfit = 0;
    if (noise.is_independent()) {
      report.scores.col(k) = residual.cwiseProduct(inverse_std_);
      if (is_own) report.scores.col(k) = residual.cwiseProduct(noise.inverse_variance().cwiseSqrt());
      misfit = report.scores.col(k).squaredNorm();
    } else if (present == measured_ || !is_own) {
      const Eigen::VectorXd weighted = present == measured_ ? Eigen::VectorXd(noise.apply(residual))
                                                            : weighted_present(datum.values, residual);
      misfit = residual.dot(weighted);
      if (!is_own) report.scores.col(k) = weighted.cwiseProduct(std_);
    } else {
      present = 0;  // a noise of its own and values missing: what is left of it costs too much
    }
    if (const Eigen::MatrixXd* error = noise_.step_error(datum.step); error != nullptr && present > 0) {
      misfit = misfit_with(*error, datum.values, noise, residual);
      if (noise.is_independent())
        report.scores.col(k) = scores_beside(*error, noise.inverse_variance(), residual);
      most_errors = std::max(most_errors, error->cols());
    }
    // Their modes have another distribution.
    const bool in_modes = !is_own && (present == measured_ || noise.is_independent());
    all_in_modes = all_in_modes && in_modes;
    if (!in_modes) residual.setZero();
    report.misfit += misfit;
    report.values += present;
    if (present > 0) steps.see(misfit, present, k);
    if (present > parameters && repeats(data, k)) report.set(ResidualTest::repeated, 0, k);
  }
  const double values = report.values;
  if (report.values == 0) return report;
  report.set(ResidualTest::total, numerics::chi_squared_upper(report.misfit, values));
  if (noise_.has_step_errors()) {
    if (likelihood::links_steps(noise_)) return report;
    steps.report_worst(report, ResidualTest::step);
    if (!noise_.measurement().is_independent()) return report;
    test_extremes(report);
    // The errors of a step that were taken out leave its values dependent, by as many parts in n.
    if (n >= k_values_per_error * most_errors) test_independent(report, parameters);
    return report;
  }
  if (likelihood::links_steps(noise_)) {
    // What is given here is one step's noise: of many steps only single values are what they seem.
    test_extremes(report);
    return report;
  }
  steps.report_worst(report, ResidualTest::step);
  const double degrees = values - parameters;
  if (degrees >= 1 && !own)
    report.set(ResidualTest::too_small, 1 - numerics::chi_squared_upper(report.misfit, degrees));
  test_extremes(report);
  if (noise_.measurement().is_independent()) test_independent(report, parameters);
  if (all_in_modes) test_modes(residuals, report);
  return report;
}

/// Made when they are first asked for: of a model with a million times they are more than all else.
const Eigen::MatrixXd& ResidualTests::rows_at(std::size_t time_index) {
  constexpr std::size_t k_kept = 1024;
  const auto found = rows_.find(time_index);
  if (found != rows_.end()) return found->second;
  if (rows_.size() >= k_kept) rows_.clear();
  return rows_.emplace(time_index, model_->space * model_->core[time_index]).first->second;
}

/// Whether a datum has the values of the one before it, or of one of the same model time: to less than noise
/// would ever leave between two, for a file may have been written twice with other last digits.
bool ResidualTests::repeats(std::span<const likelihood::DatumPointer> data, Index k) const {
  const likelihood::Datum& datum = *data[k];
  for (Index j = k - 1; j >= 0; --j) {
    const likelihood::Datum& before = *data[j];
    if (j < k - 1 && before.time_index != datum.time_index) return false;
    Index equal = 0;
    bool all = true;
    for (Index i = 0; all && i < datum.values.size(); ++i) {
      if (std::isnan(datum.values[i]) && std::isnan(before.values[i])) continue;
      all = std::abs(datum.values[i] - before.values[i]) * inverse_std_[i] <= k_equal;
      equal += inverse_std_[i] > 0;
    }
    if (all && equal > 1) return true;
  }
  return false;
}

/// R⁻¹ of the values that are there, applied to their residual; 0 for the others. Masks tend to stay.
Eigen::VectorXd ResidualTests::weighted_present(const Eigen::VectorXd& values,
                                                const Eigen::VectorXd& residual) {
  std::vector<Index> kept;
  for (Index i = 0; i < values.size(); ++i)
    if (!std::isnan(values[i]) && noise_.measurement().is_measured(i)) kept.push_back(i);
  if (!present_noise_ || kept != present_) {
    present_noise_ = noise_.measurement().restricted(kept);
    present_ = kept;
  }
  Eigen::VectorXd weighted = Eigen::VectorXd::Zero(values.size());
  weighted(kept) = present_noise_->apply(Eigen::MatrixXd(residual(kept))).col(0);
  return weighted;
}

ResidualReport ResidualTests::examine_scores(Eigen::MatrixXd scores, Index parameters) const {
  ResidualReport report;
  report.probability.fill(1);
  report.values = (scores.array() != 0).count();
  report.misfit = scores.squaredNorm();
  report.scores = std::move(scores);
  const double values = report.values;
  if (report.values == 0) return report;
  report.set(ResidualTest::total, numerics::chi_squared_upper(report.misfit, values));
  if (likelihood::links_steps(noise_)) {  // as in `examine`
    test_extremes(report);
    return report;
  }
  if (report.values > parameters)
    report.set(ResidualTest::too_small, 1 - numerics::chi_squared_upper(report.misfit, values - parameters));
  LargestChiSquare steps;
  for (Index k = 0; k < report.scores.cols(); ++k) {
    const auto present = (report.scores.col(k).array() != 0).count();
    if (present > 0) steps.see(report.scores.col(k).squaredNorm(), present, k);
  }
  steps.report_worst(report, ResidualTest::step);
  test_extremes(report);
  test_independent(report, parameters);
  // A score is a residual over its standard deviation, wherever one knows that.
  test_modes(std_.asDiagonal() * report.scores, report);
  return report;
}

/// Of each sensor its mean over time, and the single values: normal each, whatever they share.
void ResidualTests::test_extremes(ResidualReport& report) const {
  const Eigen::MatrixXd& z = report.scores;
  double largest = 0;
  Index step = 0, sensor = 0, at = 0;
  Eigen::VectorXd sums = Eigen::VectorXd::Zero(z.rows());
  for (Index k = 0; k < z.cols(); ++k) {
    sums += z.col(k);
    const double here = z.col(k).lpNorm<Eigen::Infinity>();
    if (here > largest) largest = here, step = k;
  }
  z.col(step).cwiseAbs().maxCoeff(&sensor);
  const auto of_many = [](double score, double count) { return std::min(1.0, two_sided(score) * count); };
  report.set(ResidualTest::value, of_many(largest, report.values), step * z.rows() + sensor);
  if (likelihood::links_steps(noise_)) return;
  const double mean = sums.cwiseAbs().maxCoeff(&at) / std::sqrt(z.cols());
  report.set(ResidualTest::sensor_mean, of_many(mean, z.rows()), at);
}

std::vector<Eigen::MatrixXd> ResidualTests::said_by_series(std::span<const likelihood::DatumPointer> data,
                                                           const ResidualReport& report,
                                                           const Eigen::MatrixXd& tangent) const {
  if (series_rows_.empty() || !noise_.measurement().is_independent() || noise_.has_step_errors() ||
      likelihood::links_steps(noise_))
    return {};
  const Index d = tangent.cols(), count = std::ssize(sensors_.scalars), first = report.scores.rows() - count;
  std::vector<Eigen::MatrixXd> said(count, Eigen::MatrixXd::Zero(d, d + 1));
  for (Index k = 0; k < std::ssize(data); ++k) {
    if (data[k]->noise || likelihood::has_own_noise(noise_, data[k]->step)) continue;
    const Eigen::MatrixXd slope = series_rows_[data[k]->time_index].lazyProduct(tangent);  // s × d
    for (Index s = 0; s < count; ++s) {
      const double z = report.scores(first + s, k);
      if (z == 0) continue;  // missing
      const Eigen::VectorXd row = inverse_std_[first + s] * slope.row(s);
      said[s].leftCols(d) += row * row.transpose();
      said[s].col(d) += z * row;
    }
  }
  return said;
}

/// What takes independent noise.
void ResidualTests::test_independent(ResidualReport& report, Index parameters) const {
  const Eigen::MatrixXd& z = report.scores;
  const Index n = z.rows(), m = z.cols();
  const auto groups = std::ssize(group_names_);
  LargestChiSquare sensors, of_groups;
  Eigen::VectorXd misfit = Eigen::VectorXd::Zero(groups), count = misfit;
  const Eigen::MatrixXd in_time_order = z.transpose();  // a sensor's are contiguous
  for (Index i = 0; i < n; ++i) {
    const auto of_sensor = in_time_order.col(i);
    const double square = of_sensor.squaredNorm();
    const double present = (of_sensor.array() != 0).count();
    if (present == 0) continue;
    sensors.see(square, present, i);
    if (groups == 0) continue;
    misfit[groups_[i]] += square;
    count[groups_[i]] += present;
  }
  sensors.report_worst(report, ResidualTest::sensor);
  for (Index g = 0; g < groups; ++g)
    if (count[g] > 0) of_groups.see(misfit[g], count[g], g);
  of_groups.report_worst(report, ResidualTest::group);
  const auto above = [](double sum, double products) {
    return numerics::normal_cdf(-sum / std::sqrt(products));
  };
  const double following = 1.0 * n * (m - 1);
  if (m > parameters && following >= k_min_products)
    report.set(ResidualTest::time_neighbours,
               above(z.leftCols(m - 1).cwiseProduct(z.rightCols(m - 1)).sum(), following));
  const double in_space = 1.0 * neighbours_.size() * m;
  if (in_space < k_min_products) return;
  double sum = 0;
  for (const auto& [i, j] : neighbours_) sum += in_time_order.col(i).dot(in_time_order.col(j));
  report.set(ResidualTest::space_neighbours, above(sum, in_space));
}

void ResidualTests::test_modes(const Eigen::MatrixXd& residuals, ResidualReport& report) const {
  const Index k = modal_.rows(), m = residuals.cols();
  if (k == 0) return;
  const Eigen::MatrixXd q = modal_ * residuals;
  report.set(ResidualTest::modes, numerics::chi_squared_upper(q.squaredNorm(), 1.0 * k * m));
  report.set(ResidualTest::modes_mean, numerics::chi_squared_upper(q.rowwise().sum().squaredNorm() / m, k));
  if (m < 2 * k_parts) return;
  double slow = 0;
  for (Index part = 0; part < k_parts; ++part) {
    const Index from = part * m / k_parts, to = (part + 1) * m / k_parts;
    slow += q.middleCols(from, to - from).rowwise().sum().squaredNorm() / (to - from);
  }
  report.set(ResidualTest::modes_slow, numerics::chi_squared_upper(slow, k * k_parts));
}

}  // namespace knothe::assimilation
