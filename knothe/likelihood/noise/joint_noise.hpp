#pragma once
/// @file The noise of all values of a series of data at once.
#include <Eigen/Core>
#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>
#include <memory>
#include <vector>

#include "knothe/likelihood/noise/noise_model.hpp"

namespace knothe::likelihood {

/// N(0, D + F K⁻¹ Fᵀ) on m values: D the noise of each datum alone, F the m × q factor of what the nuisances
/// ν ~ N(0, K⁻¹) add to the values (docs/explanation/nuisances.md). Immutable; copies share what is large.
class JointNoise {
 public:
  JointNoise(GaussianNoise noise);  ///< of a single datum, without nuisances
  /// `parts`: D, block after block. `factor`: F. `precision`: K, q × q, positive definite.
  JointNoise(std::vector<GaussianNoise> parts, const Eigen::SparseMatrix<double, Eigen::RowMajor>& factor,
             const Eigen::SparseMatrix<double>& precision);

  [[nodiscard]] Eigen::Index size() const { return size_; }
  [[nodiscard]] double log_determinant() const { return log_determinant_; }
  [[nodiscard]] Eigen::VectorXd measurement_std() const;  ///< of D: without the nuisances, m
  /// (D + F K⁻¹ Fᵀ)⁻¹ X by Woodbury's identity, m × anything.
  [[nodiscard]] Eigen::MatrixXd apply(const Eigen::Ref<const Eigen::MatrixXd>& x) const;

 private:
  [[nodiscard]] Eigen::MatrixXd apply_parts(const Eigen::Ref<const Eigen::MatrixXd>& x) const;

  std::vector<GaussianNoise> parts_;
  Eigen::SparseMatrix<double> weighted_;                                                   ///< D⁻¹ F
  std::shared_ptr<const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>>> information_;  ///< K + Fᵀ D⁻¹ F
  Eigen::Index size_ = 0;
  double log_determinant_ = 0;
};

/// Of the values that are there (NaN: missing) of data `values`, n × n_t, step t in column t: all parts and
/// nuisances of `noise`. `predicted`: the same of the model at the centre, about which a scale is linearised.
[[nodiscard]] JointNoise joint_noise(const NoiseModel& noise, const Eigen::MatrixXd& values,
                                     const Eigen::MatrixXd& predicted);

}  // namespace knothe::likelihood
