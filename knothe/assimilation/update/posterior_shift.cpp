#include "knothe/assimilation/update/posterior_shift.hpp"

#include <algorithm>
#include <cassert>

namespace knothe::assimilation {

std::vector<PosteriorShift> posterior_shift(std::shared_ptr<const reduction::ObservedModel> model,
                                            std::shared_ptr<const reduction::ObservedModel> judge,
                                            const Eigen::MatrixXd& data, const NoiseModel& noise,
                                            const std::vector<Prior>& priors, Method kind) {
  assert(model->time.size() == judge->time.size() &&
         data.cols() == static_cast<Eigen::Index>(model->time.size()));
  UpdateOptions options;
  options.kind = kind;
  SequentialUpdate by_model(std::move(model), noise, priors, options);
  SequentialUpdate by_judge(std::move(judge), noise, priors, options);
  std::vector<PosteriorShift> shifts;
  for (Eigen::Index t = 0; t < data.cols(); ++t) {
    const auto step = static_cast<std::size_t>(t);
    const UpdateResult& ours = by_model.update(step, step, data.col(t));
    const UpdateResult& theirs = by_judge.update(step, step, data.col(t));
    const Eigen::ArrayXd std = theirs.covariance.diagonal().array().sqrt();
    shifts.push_back({step, ((ours.mean - theirs.mean).array().abs() / std).maxCoeff(),
                      (ours.covariance.diagonal().array().sqrt() / std - 1).abs().maxCoeff()});
  }
  return shifts;
}

ShiftSummary summarise(const std::vector<PosteriorShift>& shifts) {
  assert(!shifts.empty());
  const auto by_mean = [](const PosteriorShift& a, const PosteriorShift& b) { return a.mean < b.mean; };
  const auto by_std = [](const PosteriorShift& a, const PosteriorShift& b) { return a.std < b.std; };
  return {*std::max_element(shifts.begin(), shifts.end(), by_mean),
          *std::max_element(shifts.begin(), shifts.end(), by_std), shifts.back()};
}

}  // namespace knothe::assimilation
