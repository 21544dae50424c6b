#include "knothe/assimilation/select/sensitivity.hpp"

#include <algorithm>
#include <numeric>

namespace knothe::assimilation {
namespace {

model::FunctionBatch slopes_at(const model::ObservedModel& model, const Eigen::VectorXd& p) {
  const auto& functions = *model.functions;
  model::FunctionBatch batch;
  batch.resize(1, functions.dimension(), functions.count(), 1);
  functions.evaluate(p.transpose(), 1, batch);
  return batch;
}

}  // namespace

Eigen::MatrixXd sensitivity_fields(const model::ObservedModel& model, const Eigen::VectorXd& p,
                                   std::size_t step) {
  const model::FunctionBatch batch = slopes_at(model, p);
  Eigen::MatrixXd coefficients(model.space.cols(), p.size());
  for (Eigen::Index j = 0; j < p.size(); ++j)
    coefficients.col(j) = model.core[step] * batch.first[j].row(0).transpose();
  return model.space * coefficients;
}

Eigen::MatrixXd sensitivity_over_time(const model::ObservedModel& model, const Eigen::VectorXd& p) {
  Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(model.observations(), p.size());
  for (std::size_t t = 0; t < model.time.size(); ++t) sum += sensitivity_fields(model, p, t).cwiseAbs2();
  return sum.cwiseSqrt();
}

Eigen::VectorXd sensitivity_score(const Eigen::MatrixXd& weighted, SensitivityCriterion criterion) {
  switch (criterion) {
    case SensitivityCriterion::product:
      return weighted.cwiseAbs().rowwise().prod();
    case SensitivityCriterion::minimum:
      return weighted.cwiseAbs().rowwise().minCoeff();
    case SensitivityCriterion::maximum:
      break;
  }
  return weighted.cwiseAbs().rowwise().maxCoeff();
}

std::vector<Eigen::Index> highest(const Eigen::VectorXd& score, std::size_t count,
                                  const Eigen::Ref<const Eigen::Matrix<double, Eigen::Dynamic, 3>>& points,
                                  double min_distance) {
  std::vector<Eigen::Index> order(score.size()), chosen;
  std::iota(order.begin(), order.end(), Eigen::Index{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](Eigen::Index a, Eigen::Index b) { return score[a] > score[b]; });
  for (const Eigen::Index k : order) {
    if (chosen.size() == count) break;
    const bool free = std::all_of(chosen.begin(), chosen.end(), [&](Eigen::Index c) {
      return min_distance <= 0 || (points.row(k) - points.row(c)).norm() >= min_distance * (1 - 1e-9);
    });
    if (free) chosen.push_back(k);
  }
  return chosen;
}

}  // namespace knothe::assimilation
