#include "knothe/assimilation/update/student_update.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "knothe/assimilation/update/compatibility.hpp"
#include "knothe/assimilation/update/maximum_a_posteriori.hpp"
#include "knothe/base/monotonic_time.hpp"
#include "knothe/likelihood/step/prior_of_model.hpp"
#include "knothe/numerics/linear/symmetric_eigen.hpp"
#include "knothe/numerics/statistics/normal_distribution.hpp"
#include "knothe/posterior/trust.hpp"

namespace knothe::assimilation {
namespace {

constexpr int k_max_rounds = 8;
/// In standard deviations: a form made so near to the posterior is as good as one made at it, for its error
/// is of the third order, and weighted out.
constexpr double k_moved = 0.05;
/// Standard deviation of what a form leaves out that is left alone: it moves no mean by more than so many
/// standard deviations (Cauchy-Schwarz), no standard deviation by more than that share of it.
constexpr double k_negligible = 0.01;
/// Effective sample size (fraction) below which quadrature takes over: with few values the exact posterior
/// has tails that the points do not reach, which a weight of theirs does not show.
constexpr double k_quadrature_below = 0.99;

Eigen::VectorXd functions_at_medians(const model::ObservedModel& model,
                                     const posterior::PriorTransform& transform) {
  model::FunctionBatch batch;
  batch.resize(1, transform.dimension(), model.functions->count(), 0);
  model.functions->evaluate(likelihood::medians(transform).transpose(), 0, batch);
  return batch.value.row(0);
}

UpdateOptions of_all_data(UpdateOptions options) {
  options.form = UpdateOptions::Form::collapsed;
  if (options.kind != posterior::Method::grid) options.kind = posterior::Method::transport;
  return options;
}

/// An orthonormal basis of the directions in which w varies, r × q.
Eigen::MatrixXd basis_of(const Eigen::MatrixXd& factor) {
  const numerics::SymmetricEigen eigen(factor.transpose() * factor);
  const Eigen::VectorXd& size = eigen.eigenvalues();
  const Eigen::Index kept = size.size() == 0 ? 0 : (size.array() > 1e-12 * size.maxCoeff()).count();
  return factor * eigen.eigenvectors().rightCols(kept) *
         size.tail(kept).cwiseSqrt().cwiseInverse().asDiagonal();
}

/// −½ (vᵀGv − 2 gᵀv + c + log normaliser) of each column.
Eigen::ArrayXd log_likelihood(const likelihood::StepForm& form, const Eigen::MatrixXd& v) {
  const Eigen::ArrayXd quadratic = v.cwiseProduct(form.quadratic * v).colwise().sum().transpose();
  const Eigen::ArrayXd linear = v.transpose() * form.linear;
  return -0.5 * (quadratic - 2 * linear + form.constant + form.log_normaliser);
}

double standard_deviation(const Eigen::VectorXd& values) {
  return std::sqrt((values.array() - values.mean()).square().mean());
}

/// Quantiles of a coordinate whose points' weights have become `after`: of each quantile before, the share of
/// the mass below (or above) it now, as a normal score; between these, in which x is all but linear, the
/// scores wanted. Points on a lattice, of which many share a coordinate, have no sharper ones of their own.
void carry_quantiles(const Eigen::Ref<const Eigen::VectorXd>& x, const Eigen::VectorXd& before,
                     const Eigen::VectorXd& after, Eigen::MatrixXd::RowXpr quantiles) {
  constexpr std::size_t n = numerics::k_quantile_levels.size();
  const Eigen::RowVectorXd old = quantiles;
  std::array<double, n> score{}, wanted{};
  for (std::size_t j = 0; j < n; ++j) {
    const double level = numerics::k_quantile_levels[j], tail = std::min(level, 1 - level);
    const double sign = level < 0.5 ? 1 : -1;
    const auto in_tail = (sign * (x.array() - old[j]) <= 0).cast<double>();
    const double mass = (in_tail * before.array()).sum(), now = (in_tail * after.array()).sum();
    wanted[j] = numerics::normal_quantile(level);
    score[j] =
        mass > 0 && now > 0 ? sign * numerics::normal_quantile(std::min(tail * now / mass, 1.0)) : wanted[j];
  }
  for (std::size_t j = 0; j < n; ++j) {
    std::size_t right = 1;
    while (right + 1 < n && score[right] < wanted[j]) ++right;
    const double width = score[right] - score[right - 1];
    const Eigen::Index at = right;
    const double share = width > 0 ? (wanted[j] - score[right - 1]) / width : 0.5;
    quantiles[j] = old[at - 1] + share * (old[at] - old[at - 1]);
  }
  quantiles = quantiles.cwiseMax(x.minCoeff()).cwiseMin(x.maxCoeff());
}

/// The exact posterior, in z.
class ExactDensity final : public posterior::LogDensity {
 public:
  ExactDensity(const likelihood::StudentLikelihood& likelihood, const model::ParameterFunctions& functions,
               const posterior::PriorTransform& transform, const Eigen::VectorXd& central)
      : likelihood_(likelihood), functions_(functions), transform_(transform), central_(central) {}
  [[nodiscard]] Eigen::Index dimension() const override { return transform_.dimension(); }
  [[nodiscard]] int available_derivatives() const override { return 0; }
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& z, int derivatives,
                posterior::LogDensityBatch& out) override {
    Eigen::MatrixXd p(z.rows(), z.cols()), none;
    transform_.evaluate(z, 0, p, none, none);
    batch_.resize(z.rows(), z.cols(), central_.size(), 0);
    functions_.evaluate(p, 0, batch_);
    out.value = likelihood_.evaluate(-central_, Eigen::MatrixXd::Identity(central_.size(), central_.size()),
                                     batch_.value.transpose());
    transform_.add_dependence(p, 0, out);
    likelihood::add_standard_normal(z, derivatives, out);
  }

 private:
  const likelihood::StudentLikelihood& likelihood_;
  const model::ParameterFunctions& functions_;
  const posterior::PriorTransform& transform_;
  const Eigen::VectorXd& central_;
  model::FunctionBatch batch_;
};

}  // namespace

StudentUpdate::StudentUpdate(std::shared_ptr<const model::ObservedModel> model,
                             const likelihood::NoiseModel& noise, std::vector<posterior::Prior> priors,
                             UpdateOptions options, double degrees)
    : model_(std::move(model)),
      transform_(likelihood::truncated_to_box(*model_, std::move(priors))),
      central_(functions_at_medians(*model_, *transform_)),
      likelihood_(model_, central_, degrees),
      kind_(options.kind),
      solver_(*model_, transform_, central_, of_all_data(options)),
      supervision_(model_, noise, transform_, options),
      functions_(supervision_.functions()),
      changes_(options),
      restarts_on_alarm_(options.restart_on_alarm) {
  require_compatible(features_of(options) | features_of(noise) | features_of(0, degrees));
}

const std::vector<posterior::Prior>& StudentUpdate::priors() const {
  return transform_->priors();
}

const UpdateResult& StudentUpdate::update(std::size_t step, std::size_t time_index,
                                          const Eigen::Ref<const Eigen::VectorXd>& values,
                                          const Eigen::Ref<const Eigen::VectorXd>& scale) {
  if (!restarts_on_alarm_) entries_.clear();
  entries_.push_back({step, time_index, values, scale});
  const std::size_t count = entries_.size();
  std::optional<ModelSupervision::DriftAlarm> rung;
  for (std::size_t k = count - 1; k < count;) {
    const auto alarm = assimilate(entries_[k]);
    if (k + 1 == count && alarm) rung = alarm;
    k = alarm && restarts_on_alarm_ && find_change(k, *alarm) ? 0 : k + 1;
  }
  if (!rung || changes_.found().empty()) return result_;
  result_.monitor.alarm = true;
  result_.monitor.cumulative_sum = rung->report.cumulative_sum;
  result_.monitor.threshold = rung->report.threshold;
  result_.notice = changes_.notice(rung->notice, changes_.found().back(), result_.notice);
  return result_;
}

/// Takes the alarm at the entry `last` for a change where the drift began, and begins again. False where that
/// is known already, or where there is nothing before it to be forgotten.
bool StudentUpdate::find_change(std::size_t last, const ModelSupervision::DriftAlarm& alarm) {
  const std::size_t back = alarm.steps - 1;
  if (back >= last || changes_.before(entries_[last - back].step)) return false;
  std::vector<std::size_t> found = changes_.found();
  found.push_back(entries_[last - back].step);
  restart();
  changes_.set_found(std::move(found));
  return true;
}

std::optional<ModelSupervision::DriftAlarm> StudentUpdate::assimilate(const Entry& entry) {
  const bool same = !first_ && result_.step == entry.step;
  const Eigen::Index used = same ? result_.used : 0, missing = same ? result_.missing : 0;
  if (!same) before_ = result_.log_evidence;
  if (!same && changes_.possible()) forget(entry.step);
  likelihood_.add(entry.time_index, entry.values, entry.scale);
  compute();
  result_.step = entry.step;
  result_.time = model_->time[entry.time_index];
  result_.used = used + likelihood_.last_used();
  result_.missing = missing + entry.values.size() - likelihood_.last_used();
  const auto start = monotonic_now();
  set_most_probable();
  result_.log_evidence += forgotten_;
  result_.log_evidence_lower_bound += forgotten_;
  result_.log_evidence_increment = result_.log_evidence - before_;
  result_.elapsed_us.correction += microseconds_since(start);
  first_ = false;
  return watch(entry.step);
}

/// The posterior of the values as they count now.
void StudentUpdate::compute() {
  UpdateResult fresh;
  fresh.mean = result_.mean, fresh.covariance = result_.covariance;  // the first form is made about these
  result_ = std::move(fresh);
  approach();
  const auto start = monotonic_now();
  correct();
  result_.elapsed_us.correction += microseconds_since(start);
}

/// The data before `step` grow old.
void StudentUpdate::forget(std::size_t step) {
  const double power = changes_.power_before(step);
  if (changes_.before(step)) supervision_.restart_sums();
  if (first_ || power == 1) return;
  likelihood_.raise(power);
  forgotten_ = result_.log_evidence;
  if (power == 0) {
    first_ = true;
    supervision_.forget_posterior();
    functions_ = supervision_.functions();
    return;
  }
  compute();
  forgotten_ -= result_.log_evidence;
  supervision_.set_posterior(result_);
}

void StudentUpdate::restart() {
  likelihood_.raise(0);
  supervision_.restart();
  functions_ = supervision_.functions();
  changes_.restart();
  result_ = {};
  forgotten_ = 0;
  first_ = true;
}

/// The form of all values about that posterior, in v.
likelihood::StepForm StudentUpdate::linearised(const likelihood::PosteriorFunctions& about) const {
  const Eigen::VectorXd mean = about.mean - central_;
  const Eigen::Index r = mean.size();
  likelihood::StepForm form = likelihood_.linearise(mean, about.factor, Eigen::MatrixXd::Identity(r, r));
  const Eigen::VectorXd moved = form.quadratic * mean;
  form.constant += mean.dot(moved + 2 * form.linear);
  form.linear += moved;
  return form;
}

/// The posterior of that form, and what the form leaves out there.
void StudentUpdate::solve(likelihood::StepForm form) {
  form_ = std::move(form);
  UpdateTimes times;
  solver_.set({form_, {}, {}, 0}, {});
  solver_.solve_collapsed(result_, times);
  result_.elapsed_us.map += times.map;
  result_.elapsed_us.correction += times.correction;
  const auto start = monotonic_now();
  functions_ = likelihood::posterior_functions(*model_->functions, result_.points, result_.weights);
  left_out_ = left_out(functions_.deviation);
  result_.elapsed_us.projection += microseconds_since(start);
}

/// ℓ − form where w is off by these columns (r × K) from its mean over the posterior.
Eigen::VectorXd StudentUpdate::left_out(const Eigen::MatrixXd& deviation) const {
  const Eigen::VectorXd mean = functions_.mean - central_;
  const Eigen::MatrixXd basis = basis_of(functions_.factor), coordinates = basis.transpose() * deviation;
  return likelihood_.evaluate(mean, basis, coordinates) -
         log_likelihood(form_, (basis * coordinates).colwise() + mean).matrix();
}

void StudentUpdate::approach() {
  // The prior may be much wider than the noise: no place for an expansion. Noise of the precisions that its
  // prediction gives the values pulls at all of them.
  if (first_) {
    const Eigen::VectorXd mean = functions_.mean - central_;
    solve(likelihood_.gaussian_form(likelihood_.precision_factors(mean, functions_.factor)));
  }
  for (int round = 0; round < k_max_rounds; ++round) {
    const auto start = monotonic_now();
    const Eigen::VectorXd mean = result_.mean, std = result_.standard_deviations();
    likelihood::StepForm form = linearised(functions_);
    result_.elapsed_us.projection += microseconds_since(start);
    solve(std::move(form));
    const Eigen::ArrayXd now = result_.standard_deviations();
    const bool stays = ((result_.mean - mean).array().abs() <= k_moved * now).all() &&
                       ((now - std.array()).abs() <= k_moved * now).all();
    if (stays || standard_deviation(left_out_) <= k_negligible) return;
  }
}

/// From the posterior of the form to that of the values.
void StudentUpdate::correct() {
  if (kind_ == posterior::Method::sequential_monte_carlo || kind_ == posterior::Method::markov_chain) {
    ExactDensity exact(likelihood_, *model_->functions, *transform_, central_);
    solver_.draw(exact, kind_, result_);
    functions_ = likelihood::posterior_functions(*model_->functions, result_.points, result_.weights);
    return;
  }
  if (standard_deviation(left_out_) <= k_negligible) {
    result_.log_evidence += left_out_.mean();
    result_.log_evidence_lower_bound += left_out_.mean();
    return;
  }
  model::FunctionBatch batch;
  batch.resize(result_.points.rows(), result_.points.cols(), central_.size(), 0);
  model_->functions->evaluate(result_.points, 0, batch);
  const double share = weigh(left_out(batch.value.transpose().colwise() - functions_.mean));
  const bool few = result_.points.cols() <= posterior::k_max_quadrature_parameters;
  if (share < (few ? k_quadrature_below : posterior::k_trusted_effective_sample_size)) replace(few, share);
  functions_ = likelihood::posterior_functions(*model_->functions, result_.points, result_.weights);
}

/// By importance weights exp(left out). The effective sample size of these alone.
double StudentUpdate::weigh(const Eigen::VectorXd& left_out) {
  UpdateResult& r = result_;
  const double largest = left_out.maxCoeff();
  const Eigen::VectorXd before = r.weights;
  r.weights = before.array() * (left_out.array() - largest).exp();
  const double sum = r.weights.sum();
  const double share = sum * sum / (r.weights.array().square() / before.array().max(1e-300)).sum();
  r.weights /= sum;
  r.log_evidence += largest + std::log(sum);
  r.log_evidence_lower_bound += before.dot(left_out);
  r.effective_sample_size *= share;
  r.summarise();
  for (Eigen::Index k = 0; k < r.points.cols(); ++k)
    carry_quantiles(r.points.col(k), before, r.weights, r.quantiles.row(k));
  return share;
}

/// By the exact density itself.
void StudentUpdate::replace(bool by_quadrature, double share) {
  ExactDensity exact(likelihood_, *model_->functions, *transform_, central_);
  if (by_quadrature) {
    solver_.integrate(exact, result_);
  } else {
    solver_.draw(exact, posterior::Method::sequential_monte_carlo, result_);
  }
  result_.log_evidence_lower_bound = std::min(result_.log_evidence_lower_bound, result_.log_evidence);
  result_.remark = fmt::format(
      "{}no quadratic form stands for the Student-t values yet ({:.0f} % effective sample size); moments, "
      "quantiles and evidence are by {} {} points",
      result_.remark.empty() || by_quadrature ? "" : result_.remark + "; ", 100 * share,
      by_quadrature ? "quadrature at" : "weighted draws,", result_.weights.size());
}

void StudentUpdate::set_most_probable() {
  const Eigen::Index d = transform_->dimension(), r = central_.size();
  const Eigen::MatrixXd none = Eigen::MatrixXd::Zero(r, 1);
  const LogLikelihood log_likelihood = [&](const auto& p, int derivatives, posterior::LogDensityBatch& out) {
    model::FunctionBatch w;
    w.resize(1, d, r, derivatives);
    model_->functions->evaluate(p, derivatives, w);
    const Eigen::VectorXd v = w.value.row(0).transpose() - central_;
    out.value = likelihood_.evaluate(v, none, Eigen::MatrixXd::Zero(1, 1));
    if (derivatives < 2) return;
    // Along first and second derivatives of w at once.
    Eigen::MatrixXd along(r, d + d * (d + 1) / 2);
    for (Eigen::Index a = 0; a < d; ++a) along.col(a) = w.first[a].row(0);
    for (Eigen::Index ab = 0; ab < d * (d + 1) / 2; ++ab) along.col(d + ab) = w.second[ab].row(0);
    const likelihood::StepForm form = likelihood_.linearise(v, none, along);
    out.gradient = form.linear.head(d).transpose();
    for (Eigen::Index a = 0; a < d; ++a) {
      for (Eigen::Index b = 0; b <= a; ++b) {
        const Eigen::Index ab = posterior::packed_index(a, b);
        out.hessian(0, ab) = form.linear[d + ab] - form.quadratic(a, b);
      }
    }
  };
  result_.maximum_a_posteriori = maximum_a_posteriori(log_likelihood, *transform_, result_.mean, 1e-6);
}

/// The monitor judges the datum as one of Gaussian noise of the precisions found.
std::optional<ModelSupervision::DriftAlarm> StudentUpdate::watch(std::size_t step) {
  const auto start = monotonic_now();
  precision_factors_ = likelihood_.precision_factors(functions_.mean - central_, functions_.factor);
  latest_ = {};
  latest_.form = likelihood_.gaussian_form(precision_factors_);
  auto alarm = supervision_.check_prediction(step, latest_, central_);
  supervision_.learn(latest_, {}, result_);
  result_.elapsed_us.watch = microseconds_since(start);
  return alarm;
}

}  // namespace knothe::assimilation
