#include "knothe/project/truncation_noise.hpp"

#include <Eigen/Cholesky>

namespace knothe::project {

assimilation::NoiseModel with_truncation(const assimilation::NoiseModel& noise,
                                         std::span<const Eigen::MatrixXd> added) {
  assimilation::NoiseModel result = noise;
  const Eigen::MatrixXd identity = Eigen::MatrixXd::Identity(noise.size(), noise.size());
  for (std::size_t i = 0; i < added.size(); ++i) {
    const Eigen::MatrixXd precision = noise.at_step(i).precision();
    const Eigen::MatrixXd covariance = precision.llt().solve(identity) + added[i];
    const Eigen::MatrixXd sum = covariance.llt().solve(identity);
    const Eigen::MatrixXd symmetric = 0.5 * (sum + sum.transpose());
    result = result.with_step(i, assimilation::NoiseModel::correlated(symmetric.sparseView(0.0, 0.0)));
  }
  return result;
}

}  // namespace knothe::project
