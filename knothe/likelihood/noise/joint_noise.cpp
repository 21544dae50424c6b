#include "knothe/likelihood/noise/joint_noise.hpp"

#include <cassert>
#include <cmath>
#include <utility>

namespace knothe::likelihood {
namespace {

using Eigen::Index;
using Sparse = Eigen::SparseMatrix<double>;
using Entries = std::vector<Eigen::Triplet<double>>;
using Factorisation = Eigen::SimplicialLDLT<Sparse>;

double log_determinant(const Factorisation& factor) {
  return factor.vectorD().array().log().sum();
}

/// F and K, state after state.
struct States {
  Entries factor, precision;
  Index count = 0;

  /// The first of `more` states of precision `each`.
  Index append(Index more, double each) {
    for (Index k = count; k < count + more; ++k) precision.emplace_back(k, k, each);
    return std::exchange(count, count + more);
  }
};

/// The noise of a datum without what the reference pictures, k of them, share with the others.
GaussianNoise without_reference(const GaussianNoise& noise, Index displacements, double k) {
  if (k == 0) return noise;
  const double more = (k + 1) / k;
  if (noise.is_independent()) {
    Eigen::VectorXd std = noise.standard_deviations();
    std.head(displacements) /= std::sqrt(more);
    return GaussianNoise::independent(std);
  }
  Sparse precision = noise.precision();
  for (Index i = 0; i < displacements; ++i) precision.col(i) *= more;
  return GaussianNoise::correlated(precision);
}

/// s ~ N(0, R / (k + 1)) of displacements; a state of its own where nothing is measured.
void append_reference(const NoiseModel& noise, Index displacements, States& states) {
  const Sparse precision = noise.measurement().precision();
  for (Index i = 0; i < displacements; ++i) {
    if (!noise.measurement().is_measured(i))
      states.precision.emplace_back(states.count + i, states.count + i, 1);
    for (Sparse::InnerIterator it(precision, i); it; ++it)
      states.precision.emplace_back(states.count + it.row(), states.count + i,
                                    (noise.shared_reference() + 1) * it.value());
  }
  states.count += displacements;
}

}  // namespace

JointNoise::JointNoise(GaussianNoise noise) : size_(noise.size()), log_determinant_(noise.log_determinant()) {
  parts_.push_back(std::move(noise));
}

JointNoise::JointNoise(std::vector<GaussianNoise> parts,
                       const Eigen::SparseMatrix<double, Eigen::RowMajor>& factor, const Sparse& precision)
    : parts_(std::move(parts)) {
  Entries weighted;
  for (const GaussianNoise& part : parts_) {
    log_determinant_ += part.log_determinant();
    const Eigen::MatrixXd block = part.apply(Eigen::MatrixXd(factor.middleRows(size_, part.size())));
    for (Index k = 0; k < block.cols(); ++k)
      for (Index i = 0; i < block.rows(); ++i)
        if (block(i, k) != 0) weighted.emplace_back(size_ + i, k, block(i, k));
    size_ += part.size();
  }
  assert(factor.rows() == size_ && factor.cols() == precision.rows());
  if (factor.cols() == 0) return;
  weighted_.resize(size_, factor.cols());
  weighted_.setFromTriplets(weighted.begin(), weighted.end());
  const Sparse information = precision + Sparse(Sparse(factor.transpose()) * weighted_);
  auto factorised = std::make_shared<Factorisation>(information);
  log_determinant_ +=
      likelihood::log_determinant(*factorised) - likelihood::log_determinant(Factorisation(precision));
  information_ = std::move(factorised);
}

Eigen::VectorXd JointNoise::measurement_std() const {
  Eigen::VectorXd std(size_);
  Index begin = 0;
  for (const GaussianNoise& part : parts_) {
    std.segment(begin, part.size()) = part.standard_deviations();
    begin += part.size();
  }
  return std;
}

Eigen::MatrixXd JointNoise::apply_parts(const Eigen::Ref<const Eigen::MatrixXd>& x) const {
  if (parts_.size() == 1) return parts_.front().apply(x);
  Eigen::MatrixXd out(x.rows(), x.cols());
  Index first = 0;
  for (const GaussianNoise& part : parts_) {
    out.middleRows(first, part.size()) = part.apply(x.middleRows(first, part.size()));
    first += part.size();
  }
  return out;
}

Eigen::MatrixXd JointNoise::apply(const Eigen::Ref<const Eigen::MatrixXd>& x) const {
  Eigen::MatrixXd out = apply_parts(x);
  if (information_) out -= weighted_ * information_->solve(Eigen::MatrixXd(weighted_.transpose() * x));
  return out;
}

JointNoise joint_noise(const NoiseModel& noise, const Eigen::MatrixXd& values,
                       const Eigen::MatrixXd& predicted) {
  const Index displacements = noise.size() - noise.scalar_count();
  States states;
  const Index lasting = states.append(lasting_count(noise), 1);
  const Index scale = states.append(noise.scale_std() > 0 ? 1 : 0, std::pow(noise.scale_std(), -2));
  const Index offsets =
      states.append(noise.offset_std() > 0 ? displacements : 0, std::pow(noise.offset_std(), -2));
  const Index reference = states.count;
  if (noise.shared_reference() > 0) append_reference(noise, displacements, states);
  std::vector<GaussianNoise> parts;
  Index row = 0;
  for (Index t = 0; t < values.cols(); ++t) {
    const GaussianNoise& all = noise.at_step(t);
    std::vector<Index> kept;
    for (Index i = 0; i < values.rows(); ++i)
      if (!std::isnan(values(i, t)) && all.is_measured(i)) kept.push_back(i);
    if (kept.empty()) continue;
    parts.push_back(without_reference(all, displacements, noise.shared_reference()).restricted(kept));
    const Eigen::MatrixXd *b = noise.lasting().factor(t), *f = noise.step_error(t);
    const Index of_step = f == nullptr ? 0 : states.append(f->cols(), 1);
    for (const Index i : kept) {
      for (Index k = 0; b != nullptr && k < b->cols(); ++k)
        states.factor.emplace_back(row, lasting + k, (*b)(i, k));
      for (Index k = 0; f != nullptr && k < f->cols(); ++k)
        states.factor.emplace_back(row, of_step + k, (*f)(i, k));
      if (i < displacements) {
        if (noise.scale_std() > 0) states.factor.emplace_back(row, scale, predicted(i, t));
        if (noise.offset_std() > 0) states.factor.emplace_back(row, offsets + i, 1);
        if (noise.shared_reference() > 0) states.factor.emplace_back(row, reference + i, 1);
      }
      ++row;
    }
  }
  Eigen::SparseMatrix<double, Eigen::RowMajor> factor(row, states.count);
  factor.setFromTriplets(states.factor.begin(), states.factor.end());
  Sparse precision(states.count, states.count);
  precision.setFromTriplets(states.precision.begin(), states.precision.end());
  return {std::move(parts), factor, precision};
}

}  // namespace knothe::likelihood
