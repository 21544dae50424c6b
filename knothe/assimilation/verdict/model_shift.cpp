#include "knothe/assimilation/verdict/model_shift.hpp"

#include <Eigen/Cholesky>
#include <Eigen/LU>

namespace knothe::assimilation {
namespace {

using Eigen::Index;

constexpr double k_linear = 0.25;     // posterior standard deviations: so far the linear formula is right
constexpr double k_converged = 0.02;  // a step of so many
constexpr int k_steps = 20, k_halvings = 6;

}  // namespace

ModelShift::ModelShift(const model::ObservedModel& model, const model::ObservedErrors& errors,
                       const posterior::PriorTransform& priors)
    : functions_(model.functions) {
  const Index d = priors.dimension();
  lower_.resize(d);
  upper_.resize(d);
  Eigen::VectorXd slope(d);  // dz/dp
  for (Index a = 0; a < d; ++a) {
    const posterior::Prior& prior = priors.prior(a);
    lower_[a] = prior.lower();
    upper_[a] = prior.upper();
    slope[a] = 2 / (prior.from_standard_normal(1).value - prior.from_standard_normal(-1).value);
  }
  prior_precision_ = slope.asDiagonal() * priors.covariance().inverse() * slope.asDiagonal();
  for (Index j = 0; j < errors.points.rows(); ++j) known_.push_back(at(errors.points.row(j).transpose()));
}

ModelShift::Point ModelShift::at(const Eigen::VectorXd& p) const {
  model::FunctionBatch batch;
  const Index d = p.size(), r = functions_->count();
  batch.resize(1, d, r, 1);
  functions_->evaluate(p.transpose(), 1, batch);
  Point point{p, batch.value.row(0).transpose(), Eigen::MatrixXd(r, d)};
  for (Index a = 0; a < d; ++a) point.slope.col(a) = batch.first[a].row(0).transpose();
  return point;
}

Eigen::MatrixXd ModelShift::of(const Eigen::MatrixXd& quadratic, const Eigen::MatrixXd& projected) const {
  Eigen::MatrixXd shifts(prior_precision_.rows(), projected.cols());
  for (Index j = 0; j < projected.cols(); ++j) shifts.col(j) = shift(known_[j], quadratic, projected.col(j));
  return shifts;
}

Eigen::VectorXd ModelShift::shift(const Point& known, const Eigen::MatrixXd& quadratic,
                                  const Eigen::Ref<const Eigen::VectorXd>& projected) const {
  Point here = known;
  Eigen::VectorXd gv = Eigen::VectorXd::Zero(known.w.size()), std;  // G v at `here`
  double value = 0;
  for (int k = 0; k < k_steps; ++k) {
    const Eigen::VectorXd away = here.p - known.p;
    const Eigen::MatrixXd curved = quadratic.lazyProduct(here.slope);  // few columns: no packing
    Eigen::MatrixXd information = here.slope.transpose().lazyProduct(curved);
    information += prior_precision_;
    const Eigen::LLT<Eigen::MatrixXd> factor(information);
    const Eigen::MatrixXd covariance = factor.solve(Eigen::MatrixXd::Identity(away.size(), away.size()));
    std = covariance.diagonal().cwiseSqrt();
    const Eigen::VectorXd downhill = here.slope.transpose() * (projected - gv) - prior_precision_ * away;
    Eigen::VectorXd step = covariance * downhill;
    if (k == 0 && step.cwiseQuotient(std).cwiseAbs().maxCoeff() < k_linear) return step.cwiseQuotient(std);
    bool down = false;
    for (int halving = 0; halving < k_halvings && !down; ++halving, step *= 0.5) {
      Point next = at((here.p + step).cwiseMax(lower_).cwiseMin(upper_));
      const Eigen::VectorXd next_v = next.w - known.w, next_gv = quadratic * next_v;
      const double next_value = 0.5 * next_v.dot(next_gv) - next_v.dot(projected) +
                                0.5 * (next.p - known.p).dot(prior_precision_ * (next.p - known.p));
      if (!(next_value < value)) continue;
      down = true;
      step = next.p - here.p;
      here = std::move(next);
      gv = next_gv, value = next_value;
      break;
    }
    if (!down || step.cwiseQuotient(std).norm() < k_converged) break;
  }
  return (here.p - known.p).cwiseQuotient(std);
}

}  // namespace knothe::assimilation
