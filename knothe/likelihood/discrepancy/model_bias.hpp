#pragma once
/// @file Correction of model bias (Rubio et al. 2019, §4.1-4.2): what the data said beyond the model so far,
/// extrapolated to the next datum.
#include <Eigen/Core>
#include <array>
#include <optional>
#include <vector>

#include "knothe/base/enum_names.hpp"
#include "knothe/likelihood/discrepancy/time_extrapolation.hpp"
#include "knothe/numerics/linear/incremental_svd.hpp"

namespace knothe::likelihood {

/// Whether the model's bias is corrected: never, always, or when the evidence says so.
enum class BiasCorrectionMode { off, on, automatic };

constexpr auto names_of(BiasCorrectionMode /*mode*/) {
  using Mode = BiasCorrectionMode;
  return std::to_array<Named<Mode>>({{Mode::off, "off"}, {Mode::on, "on"}, {Mode::automatic, "auto"}});
}

struct BiasOptions {
  /// How the bias goes on to the next time: unknown together with the parameters, and integrated out
  /// (`JointDiscrepancy`); as the residual of the last posterior, through the time modes of the residuals'
  /// singular value decomposition (Eq. 20), with what the modes were off by lately added to the covariance;
  /// or the same without that addition, Eq. 18-20 to the letter.
  enum class Way { joint, modes, published } way = Way::joint;
  /// Joint: sizes κ of the discrepancy that are weighed against each other and against none, by the evidence.
  std::vector<double> sizes = {0.1, 0.3, 1.0};
  double memory = 20;  ///< joint: steps after which the discrepancy has forgotten itself
  int rank = 2;        ///< modes of mean and of standard deviation that are kept (two in the paper's Fig. 15)
  int order = 1;       ///< of the polynomial that extrapolates them
  int window = 2;      ///< values the polynomial goes through, at least order + 1
};

constexpr auto names_of(BiasOptions::Way /*way*/) {
  using Way = BiasOptions::Way;
  return std::to_array<Named<Way>>(
      {{Way::joint, "joint"}, {Way::modes, "linear"}, {Way::published, "published"}});
}

/// π_B̂ of Eq. 18: what is to be added to the model's prediction of a datum, and its noise, which takes the
/// place of the measurement's. N(mean, S R S + F Fᵀ), R the measurement noise, S = diag(scale).
struct BiasCorrection {
  Eigen::VectorXd mean;    ///< n, m
  Eigen::VectorXd scale;   ///< n, ≥ 1: standard deviation of B̂ over that of the measurement
  Eigen::MatrixXd factor;  ///< n × k, F, m: how uncertain the extrapolated modes are; k = 0 as published
};

/// The residuals B(x, t_i) = d_i − e − M(x, t_i, p) of Eq. 16, as they come: their means and standard
/// deviations (Eq. 19) in two sequential Karhunen-Loève updates, in units of the measurement noise, so that
/// sensors of different kinds weigh alike. Memory and cost do not grow with the number of data.
class ModelBias {
 public:
  /// `noise_std`: of the measurement, n, positive.
  ModelBias(Eigen::VectorXd noise_std, BiasOptions options);

  /// Learns from the datum at `time` (model time, increasing). `mean`: d − E[M(p)], n, NaN where nothing was
  /// measured (filled with what was expected there); `prediction_std`: of M(p) under the posterior, n; that
  /// of the measurement is added here.
  void add(double time, Eigen::VectorXd mean, const Eigen::VectorXd& prediction_std);

  /// How many data were learnt from.
  [[nodiscard]] Eigen::Index steps() const { return mean_.columns(); }
  /// Eq. 17-18 for a datum at `time`, after the last. Without a datum so far: nothing to correct.
  [[nodiscard]] std::optional<BiasCorrection> extrapolate(double time) const;
  /// The mean of B at the last datum, as its modes have it, m. Nothing before the first.
  [[nodiscard]] std::optional<Eigen::VectorXd> latest() const;

 private:
  struct Ahead {
    Eigen::VectorXd coefficients;  ///< of the mean's space modes
    Eigen::VectorXd mean, std;     ///< in units of the noise
  };
  [[nodiscard]] Ahead ahead(double time) const;
  [[nodiscard]] Eigen::VectorXd coefficients(const numerics::IncrementalSvd& svd, double time) const;
  [[nodiscard]] Eigen::Index used(const numerics::IncrementalSvd& svd) const;

  Eigen::VectorXd noise_std_;
  BiasOptions options_;
  numerics::IncrementalSvd mean_, std_;
  std::vector<double> times_;  ///< of the rows of the time modes
  Eigen::MatrixXd error_;      ///< running mean of squares of one-step errors, in the mean's space modes
  double error_weight_ = 0;
};

}  // namespace knothe::likelihood
