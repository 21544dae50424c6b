#include "knothe/likelihood/noise/shared_error.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <numbers>
#include <numeric>

#include "knothe/base/error.hpp"

namespace knothe::likelihood {
namespace {

const double k_log_2_pi = std::log(2 * std::numbers::pi);

Eigen::MatrixXd symmetric(const Eigen::MatrixXd& m) {
  return 0.5 * (m + m.transpose());
}

/// The form whose residual is column 0 of those that `product` is made of, and whose unknowns are `unknowns`.
StepForm form_of(const Eigen::MatrixXd& product, const std::vector<Eigen::Index>& unknowns, Eigen::Index used,
                 double log_determinant) {
  StepForm form;
  form.quadratic = symmetric(product(unknowns, unknowns));
  form.linear = product(unknowns, 0);
  form.constant = product(0, 0);
  form.used = used;
  form.log_normaliser = used * k_log_2_pi + log_determinant;
  return form;
}

}  // namespace

void NoiseGroup::project(const Eigen::MatrixXd& core, const Eigen::VectorXd& residual, double factor,
                         const Eigen::MatrixXd& extra, StepForm& form) const {
  form.quadratic.noalias() = factor * (core.transpose() * (gram * core));
  form.quadratic = symmetric(form.quadratic);
  form.linear.noalias() = factor * (core.transpose() * (weighted_space.transpose() * residual));
  Eigen::VectorXd weighted(residual.size());
  noise.apply(residual, weighted);
  form.constant = factor * residual.dot(weighted);
  form.used = residual.size();
  form.log_normaliser = form.used * (k_log_2_pi - std::log(factor)) + noise.log_determinant();
  const Eigen::Index r = core.cols(), m = extra.cols();
  if (m == 0) return;
  form.quadratic.conservativeResize(r + m, r + m);
  form.quadratic.topRightCorner(r, m) = factor * (core.transpose() * (weighted_space.transpose() * extra));
  form.quadratic.bottomLeftCorner(m, r) = form.quadratic.topRightCorner(r, m).transpose();
  form.quadratic.bottomRightCorner(m, m) = symmetric(factor * (extra.transpose() * noise.apply(extra)));
  form.linear.conservativeResize(r + m);
  form.linear.tail(m) = factor * (extra.transpose() * weighted);
}

SharedError::SharedError(std::shared_ptr<const model::ObservedModel> model, const NoiseModel& noise)
    : model_(std::move(model)), noise_(noise), pictures_(noise.shared_reference()) {
  assert(is_in(noise));
  const Eigen::Index n = noise_.size(), scalars = noise_.scalar_count();
  own_.setOnes(n);
  if (pictures_ > 0) own_.head(n - scalars).setConstant((pictures_ + 1) / pictures_);
  if (noise_.measurement().is_independent()) {
    // Both are errors of a sensor that stay: their variances add up. Scalars have none.
    Eigen::ArrayXd variance = Eigen::ArrayXd::Constant(n, noise_.offset_std() * noise_.offset_std());
    if (pictures_ > 0)
      variance += ((pictures_ + 1) * noise_.measurement().inverse_variance()).array().inverse();
    variance.tail(scalars) = 0;
    prior_precision_ = variance.inverse().matrix();
  }
  restart();
}

void SharedError::restart() {
  kinds_.clear();
  const bool pictures_alone = noise_.offset_std() == 0 && noise_.scalar_count() == 0;
  path_ = noise_.measurement().is_independent() ? Path::diagonal
          : pictures_alone                      ? Path::uniform
                                                : Path::sparse;
  mean_.setZero(noise_.size(), 1 + model_->functions->count());
  precision_ = prior_precision_;
  if (path_ == Path::sparse) information_ = prior_information();
}

SharedError::Kind& SharedError::kind_of(const NoiseGroup& group) {
  for (Kind& kind : kinds_) {
    if (kind.of_one_step == group.of_one_step && kind.step == group.step && kind.kept == group.kept)
      return kind;
  }
  return kinds_.emplace_back(Kind{group.step, group.of_one_step, group.kept, group.noise});
}

StepForm SharedError::condition(const ProjectedDatum& datum, MovedForm* moved) {
  const NoiseGroup& group = datum.group;
  const Eigen::Index r = datum.core.cols(), used = datum.residual.size();
  std::erase_if(kinds_, [](const Kind& kind) { return kind.count == 0; });  // of a datum that was refused
  if (path_ == Path::uniform && !group.of_one_step && (kinds_.empty() || kinds_[0].kept == group.kept)) {
    StepForm form = project_uniform(datum, moved);
    if (std::isfinite(form.constant) && form.linear.allFinite()) add_uniform(datum);
    return form;
  }
  StepForm own;
  group.project(datum.core, datum.residual, 1, {}, own);
  if (!std::isfinite(own.constant) || !own.linear.allFinite()) return own;  // it leaves no trace
  const bool diagonal = path_ == Path::diagonal && group.noise.is_independent();
  if (path_ == Path::uniform) leave_uniform();
  if (path_ == Path::diagonal && !diagonal) {
    path_ = Path::sparse;
    information_ = prior_information();
  }
  mean_.conservativeResizeLike(Eigen::MatrixXd::Zero(mean_.rows(), 1 + r + datum.extra.cols()));
  Kind& kind = kind_of(group);
  std::vector<const Kind*> standing;
  if (moved != nullptr) choose_moved(kind, *moved, standing);

  const Eigen::MatrixXd columns = innovation(datum, moved != nullptr, standing);
  Conditional given = diagonal ? condition_diagonal(group, columns) : condition_sparse(kind, columns);

  std::vector<Eigen::Index> all(columns.cols() - 1);
  std::iota(all.begin(), all.end(), 1);
  if (moved != nullptr) moved->form = form_of(given.product, all, used, given.log_determinant);
  all.erase(all.begin() + r, all.end() - datum.extra.cols());
  StepForm form = form_of(given.product, all, used, given.log_determinant);
  ++kind.count;
  all.insert(all.begin(), 0);
  mean_ += given.shift(Eigen::all, all);
  if (diagonal) {
    precision_(group.kept) += own_(group.kept).cwiseProduct(group.noise.inverse_variance());
  } else {
    information_ = std::move(given.information);
  }
  return form;
}

/// [r | (OU) C, of v | (OU), of u | of each z | of x], less what the mean of s says of each; u and z where
/// the model has a discrepancy.
Eigen::MatrixXd SharedError::innovation(const ProjectedDatum& datum, bool moved,
                                        const std::vector<const Kind*>& standing) const {
  const NoiseGroup& group = datum.group;
  const Eigen::Index r = datum.core.cols(), s = datum.core.rows(), m = datum.extra.cols();
  const Eigen::Index of_moved = moved ? s * (1 + std::ssize(standing)) : 0;
  Eigen::MatrixXd columns(datum.residual.size(), 1 + r + of_moved + m);
  columns.col(0) = datum.residual;
  columns.middleCols(1, r) = group.space * datum.core;
  columns.rightCols(m) = datum.extra;
  columns.leftCols(1 + r) -= mean_(group.kept, Eigen::seqN(0, 1 + r));
  columns.rightCols(m) -= mean_(group.kept, Eigen::seqN(1 + r, m));
  if (moved) columns.middleCols(1 + r, s) = group.space;
  for (Eigen::Index i = 0; i < std::ssize(standing); ++i) {
    columns.middleCols(1 + r + s * (1 + i), s) = -effect_of_kind(*standing[i])(group.kept, Eigen::all);
  }
  return columns;
}

/// Of which kinds the sums of moves z of the data before are, and to which the datum joins. Of the kinds
/// that share the last z, the one with most data stands for all.
void SharedError::choose_moved(const Kind& mine, MovedForm& moved, std::vector<const Kind*>& standing) const {
  const bool is_new = mine.count == 0;
  const std::size_t before = kinds_.size() - (is_new ? 1 : 0), last = k_max_moved_groups - 1;
  for (std::size_t i = 0; i < before; ++i) {
    if (i <= last) {
      standing.push_back(&kinds_[i]);
    } else if (kinds_[i].count > standing[last]->count) {
      standing[last] = &kinds_[i];
    }
  }
  moved.groups = std::ssize(standing);
  moved.group = std::min((&mine - kinds_.data()), k_max_moved_groups - 1);
}

// ------------------------------------------------------------------------------------------------ uniform

StepForm SharedError::project_uniform(const ProjectedDatum& datum, MovedForm* moved) const {
  const Eigen::Index r = datum.core.cols(), s = datum.core.rows();
  const double k = pictures_, before = kinds_.empty() ? 0.0 : kinds_[0].count;
  const double factor = (k + 1) * (k + before) / (k * (k + before + 1));
  const auto project = [&](const Eigen::MatrixXd& core, StepForm& form) {
    if (before == 0) {
      datum.group.project(core, datum.residual, factor, datum.extra, form);
      return;
    }
    Eigen::MatrixXd extra = datum.extra;
    extra.leftCols(sum_extra_.cols()) -= sum_extra_ / (k + before);
    datum.group.project(core, datum.residual - sum_residual_ / (k + before), factor, extra, form);
  };
  const Eigen::MatrixXd core =
      before == 0 ? datum.core : Eigen::MatrixXd(datum.core - sum_core_ / (k + before));
  StepForm form;
  project(core, form);
  if (moved == nullptr) return form;
  moved->groups = before == 0 ? 0 : 1;
  moved->group = 0;
  Eigen::MatrixXd wide = Eigen::MatrixXd::Zero(s, r + s + s * moved->groups);
  wide.leftCols(r) = core;
  wide.middleCols(r, s).setIdentity();
  if (moved->groups == 1) wide.rightCols(s).diagonal().setConstant(-1 / (k + before));
  project(wide, moved->form);
  return form;
}

void SharedError::add_uniform(const ProjectedDatum& datum) {
  if (kinds_.empty()) {
    sum_residual_.setZero(datum.residual.size());
    sum_core_.setZero(datum.core.rows(), datum.core.cols());
    sum_extra_.resize(datum.residual.size(), 0);
  }
  ++kind_of(datum.group).count;
  sum_residual_ += datum.residual;
  sum_core_ += datum.core;
  sum_extra_.conservativeResizeLike(Eigen::MatrixXd::Zero(sum_extra_.rows(), datum.extra.cols()));
  sum_extra_ += datum.extra;
}

/// The mean and the information matrix of s for all dofs, from the sums.
void SharedError::leave_uniform() {
  path_ = Path::sparse;
  information_ = prior_information();
  if (kinds_.empty()) return;
  Kind& kind = kinds_[0];
  information_ = with(std::move(information_), kind, kind.count);
  Eigen::MatrixXd sums(sum_residual_.size(), 1 + sum_core_.cols() + sum_extra_.cols());
  sums << sum_residual_, model_->space(kind.kept, Eigen::all) * sum_core_, sum_extra_;
  const Eigen::MatrixXd weighted = own_(kind.kept).asDiagonal() * kind.noise.apply(sums);
  mean_ = spread(information_.factor->solve(gathered(kind, weighted)));
}

// ----------------------------------------------------------------------------------------------- diagonal

/// Precision of a datum given those before it: 1/(1/own + 1/A), where no large numbers cancel.
SharedError::Conditional SharedError::condition_diagonal(const NoiseGroup& group,
                                                         const Eigen::MatrixXd& columns) const {
  const Eigen::ArrayXd own = own_(group.kept).cwiseProduct(group.noise.inverse_variance()).array();
  const Eigen::ArrayXd before = precision_(group.kept).array();
  const Eigen::ArrayXd precision = 1 / (1 / own + 1 / before);
  const Eigen::MatrixXd scaled = precision.sqrt().matrix().asDiagonal() * columns;
  Conditional given;
  given.product = scaled.transpose() * scaled;
  given.log_determinant = -precision.log().sum();
  given.shift.setZero(noise_.size(), columns.cols());
  given.shift(group.kept, Eigen::all) = (precision / before).matrix().asDiagonal() * columns;
  return given;
}

// ------------------------------------------------------------------------------------------------- sparse

/// K of the parts of s that there are. The diagonal path may have data already.
SharedError::Information SharedError::prior_information() {
  const Eigen::Index n = noise_.size(), sensors = n - noise_.scalar_count();
  std::vector<Sparse> priors;
  if (noise_.measurement().is_independent()) {
    Sparse diagonal(n, n);
    for (Eigen::Index i = 0; i < sensors; ++i) diagonal.insert(i, i) = precision_[i];
    priors.push_back(std::move(diagonal));
  } else {
    if (pictures_ > 0) priors.push_back((pictures_ + 1) * noise_.measurement().precision());
    if (noise_.offset_std() > 0) {
      Sparse offsets(n, n);
      for (Eigen::Index i = 0; i < sensors; ++i)
        offsets.insert(i, i) = 1 / (noise_.offset_std() * noise_.offset_std());
      priors.push_back(std::move(offsets));
    }
  }
  std::vector<Eigen::Triplet<double>> places, entries;
  int size = 0;
  for (const Sparse& prior : priors) {
    std::vector<int> place(n, -1);
    for (int i = 0; i < sensors; ++i) {
      if (prior.coeff(i, i) == 0) continue;  // not measured
      places.emplace_back(size, i, 1.0);
      place[i] = size++;
    }
    for (int j = 0; j < sensors; ++j) {
      for (Sparse::InnerIterator it(prior, j); it; ++it) {
        const int row = place[it.row()], column = place[j];
        if (row >= 0 && column >= 0) entries.emplace_back(row, column, it.value());
      }
    }
  }
  parts_.resize(size, n);
  parts_.setFromTriplets(places.begin(), places.end());
  Information information;
  information.matrix.resize(size, size);
  information.matrix.setFromTriplets(entries.begin(), entries.end());
  factorise(information);
  return information;
}

void SharedError::factorise(Information& information) const {
  auto factor = std::make_shared<Eigen::SimplicialLDLT<Sparse>>(information.matrix);
  if (factor->info() != Eigen::Success || !(factor->vectorD().minCoeff() > 0))
    throw NumericalError("the precision of the error that steps share is not positive definite");
  information.log_determinant = factor->vectorD().array().log().sum() - information.log_border;
  information.factor = std::move(factor);
}

/// `count` more data of a kind: A += count Sᵀ Q_s S, Q_s the Schur complement of the dofs u that are missing
/// there. It is that of the same sum with the full matrix, bordered by count [Q_uu] with the coupling
/// count Q_{:,u}: the own errors of missing dofs as variables beside s.
SharedError::Information SharedError::with(Information information, Kind& kind, Eigen::Index count) const {
  const GaussianNoise& whole = kind.of_one_step ? noise_.at_step(kind.step) : noise_.measurement();
  const Eigen::Index n = noise_.size();
  std::vector<bool> is_kept(n, false);
  for (const Eigen::Index i : kind.kept) is_kept[i] = true;
  const bool is_coupled = !whole.is_independent();
  std::vector<Eigen::Triplet<double>> entries;
  for (int i = 0; i < n; ++i) {
    if (!is_coupled && !is_kept[i]) continue;
    for (Sparse::InnerIterator it(parts_, i); it; ++it) entries.emplace_back(it.row(), i, 1.0);
  }
  Eigen::Index size = information.matrix.rows();
  const Eigen::Index first = kind.border >= 0 ? kind.border : size;
  Eigen::Index missing = 0;
  double log_own = 0;
  for (Eigen::Index i = 0; is_coupled && i < n; ++i) {
    if (is_kept[i] || !whole.is_measured(i)) continue;
    entries.emplace_back(first + missing++, i, 1.0);
    log_own += std::log(own_[i]);
  }
  if (missing > 0 && kind.border < 0) {
    kind.border = first;
    size += missing;
    // det Q_uu = det Q / det Q_s.
    information.log_border +=
        log_own - whole.log_determinant() + kind.noise.log_determinant() + missing * std::log(count);
    information.matrix.conservativeResize(size, size);
  } else if (missing > 0) {
    information.log_border += missing * std::log(1.0 * (kind.count + count) / kind.count);
  }
  Sparse selection(size, n);
  selection.setFromTriplets(entries.begin(), entries.end());
  const Sparse own = (count * own_).asDiagonal() * whole.precision();
  information.matrix += selection * own * Sparse(selection.transpose());
  factorise(information);
  return information;
}

/// Rows of the dofs that a kind keeps, as right-hand sides for the information matrix.
Eigen::MatrixXd SharedError::gathered(const Kind& kind, const Eigen::MatrixXd& weighted) const {
  Eigen::MatrixXd right = Eigen::MatrixXd::Zero(information_.matrix.rows(), weighted.cols());
  for (std::size_t j = 0; j < kind.kept.size(); ++j) {
    bool has_part = kind.kept[j] >= noise_.size() - noise_.scalar_count();
    for (Sparse::InnerIterator it(parts_, kind.kept[j]); it; ++it) {
      right.row(it.row()) = weighted.row(j);
      has_part = true;
    }
    if (!has_part) {
      throw DataError(
          "a dof is measured at one step but its row of noise/precision is zero: give NaN for its values");
    }
  }
  return right;
}

/// s from its parts, n rows.
Eigen::MatrixXd SharedError::spread(const Eigen::MatrixXd& parts) const {
  return parts_.transpose() * parts.topRows(parts_.rows());
}

SharedError::Conditional SharedError::condition_sparse(Kind& kind, const Eigen::MatrixXd& columns) const {
  Conditional given;
  const Eigen::MatrixXd weighted = own_(kind.kept).asDiagonal() * kind.noise.apply(columns);
  Eigen::MatrixXd right = gathered(kind, weighted);
  given.information = with(information_, kind, 1);
  right.conservativeResizeLike(Eigen::MatrixXd::Zero(given.information.matrix.rows(), right.cols()));
  const Eigen::MatrixXd solved = given.information.factor->solve(right);
  given.product = columns.transpose() * weighted - right.transpose() * solved;
  given.shift = spread(solved);
  given.log_determinant = kind.noise.log_determinant() - own_(kind.kept).array().log().sum() +
                          given.information.log_determinant - information_.log_determinant;
  return given;
}

/// What the mean of s is moved by, where the data of a kind were moved by terms whose sum is z: n × l.
Eigen::MatrixXd SharedError::effect_of_kind(const Kind& kind) const {
  const Eigen::MatrixXd space = model_->space(kind.kept, Eigen::all);
  const Eigen::MatrixXd weighted = own_(kind.kept).asDiagonal() * kind.noise.apply(space);
  if (path_ == Path::sparse) return spread(information_.factor->solve(gathered(kind, weighted)));
  Eigen::MatrixXd effect = Eigen::MatrixXd::Zero(noise_.size(), space.cols());
  effect(kind.kept, Eigen::all) = precision_(kind.kept).cwiseInverse().asDiagonal() * weighted;
  return effect;
}

}  // namespace knothe::likelihood
