#include "knothe/assimilation/noise/shared_error.hpp"

#include <Eigen/SparseCholesky>
#include <algorithm>
#include <cassert>
#include <cmath>
#include <numbers>

#include "knothe/base/error.hpp"

namespace knothe::assimilation {
namespace {

using Sparse = Eigen::SparseMatrix<double>;
const double k_log_2_pi = std::log(2 * std::numbers::pi);

void make_symmetric(Eigen::MatrixXd& m) {
  m = 0.5 * (m + m.transpose().eval());
}

/// Adds factor · rows/columns of `matrix` selected by the index maps (−1: not there).
void add_block(const Sparse& matrix, const std::vector<int>& row, const std::vector<int>& column,
               double factor, std::vector<Eigen::Triplet<double>>& out) {
  for (int j = 0; j < matrix.outerSize(); ++j) {
    if (column[j] < 0) continue;
    for (Sparse::InnerIterator it(matrix, j); it; ++it) {
      if (row[it.row()] >= 0) out.emplace_back(row[it.row()], column[j], factor * it.value());
    }
  }
}

double log_determinant(const Eigen::SimplicialLDLT<Sparse>& factor) {
  return factor.vectorD().array().log().sum();
}

}  // namespace

StepForm StepForm::zero(Eigen::Index r) {
  StepForm form;
  form.quadratic.setZero(r, r);
  form.linear.setZero(r);
  return form;
}

void StepForm::add(const StepForm& other) {
  quadratic += other.quadratic;
  linear += other.linear;
  constant += other.constant;
  log_normaliser += other.log_normaliser;
  used += other.used;
  missing += other.missing;
}

void StepForm::subtract(const StepForm& other) {
  quadratic -= other.quadratic;
  linear -= other.linear;
  constant -= other.constant;
  log_normaliser -= other.log_normaliser;
  used -= other.used;
  missing -= other.missing;
}

void StepForm::raise(double power) {
  quadratic *= power;
  linear *= power;
  constant *= power;
  log_normaliser *= power;
}

void NoiseGroup::project(const Eigen::MatrixXd& core, const Eigen::VectorXd& residual, double factor,
                         StepForm& form, const Eigen::VectorXd* extra) const {
  form.quadratic.noalias() = factor * (core.transpose() * (gram * core));
  make_symmetric(form.quadratic);
  form.linear.noalias() = factor * (core.transpose() * (weighted_space.transpose() * residual));
  Eigen::VectorXd weighted(residual.size());
  noise.apply(residual, weighted);
  form.constant = factor * residual.dot(weighted);
  form.used = residual.size();
  form.log_normaliser =
      static_cast<double>(form.used) * (k_log_2_pi - std::log(factor)) + noise.log_determinant();
  if (extra == nullptr) return;
  const Eigen::Index r = core.cols();
  noise.apply(*extra, weighted);
  form.quadratic.conservativeResize(r + 1, r + 1);
  form.quadratic.col(r).head(r) = factor * (core.transpose() * (weighted_space.transpose() * *extra));
  form.quadratic.row(r).head(r) = form.quadratic.col(r).head(r).transpose();
  form.quadratic(r, r) = factor * extra->dot(weighted);
  form.linear.conservativeResize(r + 1);
  form.linear[r] = factor * residual.dot(weighted);
}

SharedReferenceError::SharedReferenceError(const NoiseModel& noise, Eigen::Index functions)
    : noise_(noise), pictures_(noise.shared_reference()), functions_(functions) {
  assert(pictures_ >= 1 && !noise.is_independent());
}

void SharedReferenceError::restart() {
  groups_.clear();
}

bool SharedReferenceError::is_uniform(const NoiseGroup& group) const {
  if (group.of_one_step) return false;
  return groups_.empty() || (groups_.size() == 1 && !groups_[0].of_one_step && groups_[0].kept == group.kept);
}

StepForm SharedReferenceError::condition(const NoiseGroup& group, const Eigen::MatrixXd& core,
                                         const Eigen::VectorXd& residual,
                                         const Eigen::VectorXd* extra) const {
  const double k = pictures_;
  StepForm form;
  if (is_uniform(group)) {
    const double before = groups_.empty() ? 0 : static_cast<double>(groups_[0].count);
    const double factor = (k + 1) * (k + before) / (k * (k + before + 1));
    if (before == 0) {
      group.project(core, residual, factor, form, extra);
    } else {
      const NoiseGroup& past = groups_[0];
      Eigen::VectorXd column;
      if (extra != nullptr) column = *extra - past.sum_extra / (k + before);
      group.project(core - past.sum_core / (k + before), residual - past.sum_residual / (k + before), factor,
                    form, extra == nullptr ? nullptr : &column);
    }
    return form;
  }
  group.project(core, residual, (k + 1) / k, form, extra);  // own errors alone
  std::vector<NoiseGroup> groups = groups_;
  if (!groups.empty()) form.subtract(integrated(groups));
  SharedReferenceError with = *this;
  with.take(group, core, residual, extra);
  form.add(integrated(with.groups_));
  return form;
}

MovedForm SharedReferenceError::condition_moved(const NoiseGroup& group, const Eigen::MatrixXd& core,
                                                const Eigen::VectorXd& residual) const {
  const Eigen::Index r = core.cols(), s = core.rows(), groups = static_cast<Eigen::Index>(groups_.size());
  MovedForm result;
  result.groups = std::min(groups, k_most_moved_groups);
  SharedReferenceError moved = *this;
  moved.functions_ = r + s + s * result.groups;
  // Of the groups that share the last z, the one with most data stands for all.
  Eigen::Index largest = k_most_moved_groups - 1, mine = groups;
  for (Eigen::Index i = 0; i < groups; ++i) {
    const NoiseGroup& g = groups_[static_cast<std::size_t>(i)];
    if (i > largest && g.count > groups_[static_cast<std::size_t>(largest)].count) largest = i;
    if (g.of_one_step == group.of_one_step && g.step == group.step && g.kept == group.kept) mine = i;
  }
  result.group = std::min(mine, k_most_moved_groups - 1);
  for (Eigen::Index i = 0; i < groups; ++i) {
    Eigen::MatrixXd& core_sum = moved.groups_[static_cast<std::size_t>(i)].sum_core;
    Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(s, moved.functions_);
    sum.leftCols(r) = core_sum;
    const Eigen::Index place = i < k_most_moved_groups - 1 ? i : k_most_moved_groups - 1;
    if (i < k_most_moved_groups - 1 || i == largest) sum.middleCols(r + s + s * place, s).setIdentity();
    core_sum = std::move(sum);
  }
  Eigen::MatrixXd wide = Eigen::MatrixXd::Zero(s, moved.functions_);
  wide.leftCols(r) = core;
  wide.middleCols(r, s).setIdentity();
  result.form = moved.condition(group, wide, residual);
  return result;
}

void SharedReferenceError::take(const NoiseGroup& group, const Eigen::MatrixXd& core,
                                const Eigen::VectorXd& residual, const Eigen::VectorXd* extra) {
  NoiseGroup* mine = nullptr;
  for (NoiseGroup& g : groups_) {
    if (g.of_one_step == group.of_one_step && g.step == group.step && g.kept == group.kept) mine = &g;
  }
  if (mine == nullptr) {
    mine = &groups_.emplace_back(group);
    mine->count = 0;
    mine->sum_residual.setZero(residual.size());
    mine->sum_core.setZero(core.rows(), core.cols());
    mine->sum_extra.setZero(extra == nullptr ? 0 : residual.size());
  }
  ++mine->count;
  mine->sum_residual += residual;
  mine->sum_core += core;
  if (extra != nullptr) mine->sum_extra += *extra;
}

// A = K + Σ_g n_g S_gᵀ Q_g S_g, Q_g the Schur complement of the dofs u missing in group g. It is the Schur
// complement of the same sum with full matrices, bordered by n_g [Q_uu] with coupling n_g Q_{:,u}: the own
// errors of missing dofs as variables beside s.
StepForm SharedReferenceError::integrated(const std::vector<NoiseGroup>& groups) const {
  const Eigen::Index n = noise_.size();
  const double own = (pictures_ + 1) / pictures_;
  std::vector<int> place(n, -1);
  int size = 0;
  for (Eigen::Index i = 0; i < n; ++i) {
    if (noise_.is_measured(i)) place[i] = size++;
  }
  const int shared_size = size;
  std::vector<Eigen::Triplet<double>> entries;
  add_block(noise_.precision(), place, place, pictures_ + 1, entries);
  double log_border = 0;
  Eigen::MatrixXd right = Eigen::MatrixXd::Zero(shared_size, functions_ + 1);  // [b, B]
  for (const NoiseGroup& g : groups) {
    const NoiseModel& whole = g.of_one_step ? noise_.at_step(g.step) : noise_;
    const Sparse q = whole.precision();
    const double scale = own * static_cast<double>(g.count);
    std::vector<int> border(n, -1), inner = place;
    std::vector<Eigen::Index> left_out;
    for (Eigen::Index i = 0; i < n; ++i) {
      if (!whole.is_measured(i)) inner[i] = -1;
    }
    std::vector<bool> is_kept(n, false);
    for (const Eigen::Index i : g.kept) is_kept[i] = true;
    for (Eigen::Index i = 0; i < n; ++i) {
      if (whole.is_measured(i) && !is_kept[i]) border[i] = size++;
    }
    add_block(q, inner, inner, scale, entries);
    add_block(q, border, inner, scale, entries);
    add_block(q, inner, border, scale, entries);
    add_block(q, border, border, scale, entries);
    // log det of the border: n_g Q_uu; det Q_uu = det Q / det Q_s.
    const auto n_border = static_cast<double>(std::count(border.begin(), border.end(), -1));
    const double missing = static_cast<double>(n) - n_border;
    log_border += missing * std::log(scale) - whole.log_determinant() + g.noise.log_determinant();
    const Eigen::VectorXd weighted = g.noise.apply(g.sum_residual);
    Eigen::MatrixXd weighted_design = g.weighted_space * g.sum_core;
    if (g.sum_extra.size() > 0) {
      weighted_design.conservativeResize(Eigen::NoChange, functions_);
      weighted_design.col(functions_ - 1) = g.noise.apply(g.sum_extra);
    }
    for (std::size_t j = 0; j < g.kept.size(); ++j) {
      const int row = place[g.kept[j]];
      if (row < 0) {
        throw DataError(
            "a dof is measured at one step but its row of noise/precision is zero: give NaN for its values");
      }
      right(row, 0) += own * weighted[static_cast<Eigen::Index>(j)];
      right.row(row).tail(functions_) += own * weighted_design.row(static_cast<Eigen::Index>(j));
    }
  }
  Sparse a(size, size);
  a.setFromTriplets(entries.begin(), entries.end());
  const Eigen::SimplicialLDLT<Sparse> factor(a);
  if (factor.info() != Eigen::Success)
    throw NumericalError("shared reference: the precision of the shared error is not positive definite");
  Eigen::MatrixXd padded = Eigen::MatrixXd::Zero(size, functions_ + 1);
  padded.topRows(shared_size) = right;
  const Eigen::MatrixXd solved = factor.solve(padded).topRows(shared_size);
  const Eigen::MatrixXd product = right.transpose() * solved;
  StepForm form;
  form.constant = -product(0, 0);
  form.linear = -product.col(0).tail(functions_);
  form.quadratic = -product.bottomRightCorner(functions_, functions_);
  make_symmetric(form.quadratic);
  // log det A − log det K; det K = (k + 1)ⁿ / det R.
  form.log_normaliser = log_determinant(factor) - log_border -
                        (shared_size * std::log(pictures_ + 1) - noise_.log_determinant());
  return form;
}

ConstantSensorError::ConstantSensorError(Eigen::VectorXd precision, Eigen::Index functions)
    : initial_(std::move(precision)) {
  weighted_design_.resize(initial_.size(), functions);
  restart();
}

void ConstantSensorError::restart() {
  precision_ = initial_;
  weighted_residual_.setZero(initial_.size());
  weighted_design_.setZero();
  kinds_.clear();
}

StepForm ConstantSensorError::condition(const Eigen::VectorXd& own, const Eigen::MatrixXd& design,
                                        const Eigen::VectorXd& residual) const {
  const Eigen::Index n = own.size(), r = design.cols();
  Eigen::MatrixXd rows = Eigen::MatrixXd::Zero(n, r + 1);  // √precision · [design − mean | residual − mean]
  StepForm form = StepForm::zero(r);
  for (Eigen::Index j = 0; j < n; ++j) {
    if (!(own[j] > 0)) continue;
    const double precision = 1 / (1 / own[j] + 1 / precision_[j]), root = std::sqrt(precision);
    rows.row(j).head(r) = root * (design.row(j) - weighted_design_.row(j) / precision_[j]);
    rows(j, r) = root * (residual[j] - weighted_residual_[j] / precision_[j]);
    form.log_normaliser += k_log_2_pi - std::log(precision);
    ++form.used;
  }
  form.quadratic.noalias() = rows.leftCols(r).transpose() * rows.leftCols(r);
  make_symmetric(form.quadratic);
  form.linear.noalias() = rows.leftCols(r).transpose() * rows.col(r);
  form.constant = rows.col(r).squaredNorm();
  return form;
}

MovedForm ConstantSensorError::condition_moved(const Eigen::VectorXd& own, const Eigen::MatrixXd& space,
                                               const Eigen::MatrixXd& core,
                                               const Eigen::VectorXd& residual) const {
  const Eigen::Index n = own.size(), r = core.cols(), s = space.cols();
  const auto kinds = static_cast<Eigen::Index>(kinds_.size());
  const auto mine = static_cast<Eigen::Index>(std::find(kinds_.begin(), kinds_.end(), own) - kinds_.begin());
  MovedForm result;
  result.groups = std::min(kinds, k_most_moved_groups);
  result.group = std::min(mine, k_most_moved_groups - 1);
  const Eigen::Index columns = r + s + s * result.groups;
  Eigen::MatrixXd design = Eigen::MatrixXd::Zero(n, columns);
  design.leftCols(r) = space * core;
  design.middleCols(r, s) = space;
  ConstantSensorError moved = *this;
  moved.weighted_design_ = Eigen::MatrixXd::Zero(n, columns);
  moved.weighted_design_.leftCols(r) = weighted_design_;
  for (Eigen::Index i = 0; i < result.groups; ++i) {
    moved.weighted_design_.middleCols(r + s + s * i, s) =
        kinds_[static_cast<std::size_t>(i)].asDiagonal() * space;
  }
  result.form = moved.condition(own, design, residual);
  return result;
}

void ConstantSensorError::take(const Eigen::VectorXd& own, const Eigen::MatrixXd& design,
                               const Eigen::VectorXd& residual) {
  if (std::find(kinds_.begin(), kinds_.end(), own) == kinds_.end()) kinds_.push_back(own);
  for (Eigen::Index j = 0; j < own.size(); ++j) {
    if (!(own[j] > 0)) continue;
    precision_[j] += own[j];
    weighted_residual_[j] += own[j] * residual[j];
    weighted_design_.row(j) += own[j] * design.row(j);
  }
}

}  // namespace knothe::assimilation
