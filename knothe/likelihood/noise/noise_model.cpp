#include "knothe/likelihood/noise/noise_model.hpp"

#include <cassert>
#include <utility>

namespace knothe::likelihood {

namespace {

bool is_same(const GaussianNoise& a, const GaussianNoise& b) {
  if (a.size() != b.size() || a.is_independent() != b.is_independent() ||
      a.log_determinant() != b.log_determinant())
    return false;
  if (a.is_independent()) return a.inverse_variance() == b.inverse_variance();
  const Eigen::SparseMatrix<double> p = a.precision(), q = b.precision();
  return p.nonZeros() == q.nonZeros() && (p - q).norm() == 0;
}

}  // namespace

NoiseModel NoiseModel::with_step(std::size_t step, GaussianNoise noise) const {
  assert(noise.size() == size());
  NoiseModel result = *this;
  // Back at the measurement's the step is as if it had never had another, to the bit.
  if (is_same(noise, measurement_))
    result.steps_.erase(step);
  else
    result.steps_[step] = std::make_shared<const GaussianNoise>(std::move(noise));
  return result;
}

NoiseModel NoiseModel::with_shared_reference(int pictures) const {
  assert(pictures >= 0);
  NoiseModel result = *this;
  result.shared_reference_ = pictures;
  return result;
}

NoiseModel NoiseModel::with_offsets(double std) const {
  assert(std > 0);
  NoiseModel result = *this;
  result.offset_std_ = std;
  return result;
}

NoiseModel NoiseModel::with_scale_error(double relative_std) const {
  assert(relative_std >= 0);
  NoiseModel result = *this;
  result.scale_std_ = relative_std;
  return result;
}

NoiseModel NoiseModel::with_scalars(const Eigen::VectorXd& std) const {
  if (std.size() == 0) return *this;
  NoiseModel result = *this;
  result.measurement_ = measurement_.with_independent(std);
  result.scalar_count_ += std.size();
  for (auto& [step, noise] : result.steps_)
    noise = std::make_shared<const GaussianNoise>(noise->with_independent(std));
  LastingErrors lasting = *lasting_;
  for (Eigen::MatrixXd& factor : lasting.factors)
    factor.conservativeResizeLike(Eigen::MatrixXd::Zero(result.size(), factor.cols()));
  result.lasting_ = std::make_shared<const LastingErrors>(std::move(lasting));
  return result;
}

NoiseModel NoiseModel::restricted(const std::vector<Eigen::Index>& kept) const {
  NoiseModel result = measurement_.restricted(kept);
  result.shared_reference_ = shared_reference_;
  result.scale_std_ = scale_std_;
  if (lasting_count(*this) > 0) {
    LastingErrors lasting{lasting_->errors, {}};
    for (const Eigen::MatrixXd& factor : lasting_->factors)
      lasting.factors.emplace_back(factor(kept, Eigen::all));
    result = result.with_lasting_errors(std::move(lasting));
  }
  return result;
}

NoiseModel NoiseModel::with_lasting_errors(LastingErrors lasting) const {
  assert(!lasting.factors.empty() && lasting.factors.front().rows() == size() &&
         lasting.factors.front().cols() == std::ssize(lasting.errors));
  NoiseModel result = *this;
  result.lasting_ = std::make_shared<const LastingErrors>(std::move(lasting));
  return result;
}

NoiseModel NoiseModel::with_step_error(std::size_t step, Eigen::MatrixXd factor) const {
  assert(factor.rows() == size());
  NoiseModel result = *this;
  if (const Eigen::MatrixXd* before = step_error(step)) {
    Eigen::MatrixXd both(size(), before->cols() + factor.cols());
    both << *before, factor;
    factor = std::move(both);
  }
  result.step_errors_[step] = std::make_shared<const Eigen::MatrixXd>(std::move(factor));
  return result;
}

const Eigen::MatrixXd* NoiseModel::step_error(std::size_t step) const {
  const auto found = step_errors_.find(step);
  return found == step_errors_.end() ? nullptr : found->second.get();
}

const GaussianNoise& NoiseModel::at_step(std::size_t step) const {
  const auto found = steps_.find(step);
  return found == steps_.end() ? measurement_ : *found->second;
}

}  // namespace knothe::likelihood
