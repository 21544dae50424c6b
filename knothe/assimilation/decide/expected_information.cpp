#include "knothe/assimilation/decide/expected_information.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <cmath>
#include <utility>

#include "knothe/base/error.hpp"

namespace knothe::assimilation {
namespace {

double half_log_determinant(const Eigen::MatrixXd& positive) {
  const Eigen::LLT<Eigen::MatrixXd> factor(positive);
  if (factor.info() != Eigen::Success)
    throw NumericalError("the covariance of what is to be learnt is not positive definite");
  return factor.matrixLLT().diagonal().array().log().sum();
}

}  // namespace

ExpectedInformation::ExpectedInformation(std::shared_ptr<const model::ObservedModel> model,
                                         const likelihood::GaussianNoise& noise)
    : model_(std::move(model)) {
  // Semidefinite where there are fewer sensors than modes.
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> precision(model_->space.transpose() *
                                                                 noise.apply(model_->space));
  factor_ = precision.eigenvalues().cwiseMax(0).cwiseSqrt().asDiagonal() *
            precision.eigenvectors().transpose();
}

void ExpectedInformation::set(const Eigen::Ref<const Eigen::MatrixXd>& points,
                              const Eigen::MatrixXd& covariance, const Eigen::MatrixXd& about) {
  const Index n = points.rows(), d = points.cols();
  const Eigen::LLT<Eigen::MatrixXd> factor(covariance);
  if (factor.info() != Eigen::Success) throw NumericalError("the covariance is not positive definite");
  const Eigen::MatrixXd spread = factor.matrixL();
  model::FunctionBatch functions;
  functions.resize(n, d, model_->functions->count(), 1);
  model_->functions->evaluate(points, 1, functions);
  tangents_.resize(model_->functions->count(), n * d);
  for (Index i = 0; i < n; ++i) {
    auto tangent = tangents_.middleCols(i * d, d);
    tangent.setZero();
    for (Index a = 0; a < d; ++a)
      tangent += functions.first[a].row(i).transpose() * spread.row(a);
  }
  about_ = about * spread;
  before_ = half_log_determinant(about_ * about_.transpose());
}

double ExpectedInformation::at(std::size_t step) const {
  const Index d = about_.cols(), n = tangents_.cols() / d;
  const Eigen::MatrixXd seen = factor_ * (model_->core[step] * tangents_);
  double sum = 0;
  for (Index i = 0; i < n; ++i) {
    const auto rows = seen.middleCols(i * d, d);
    const Eigen::LLT<Eigen::MatrixXd> after(Eigen::MatrixXd::Identity(d, d) + rows.transpose() * rows);
    sum += before_ - half_log_determinant(about_ * after.solve(about_.transpose()));
  }
  return sum / n;
}

}  // namespace knothe::assimilation
