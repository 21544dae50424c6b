#pragma once
/// @file Densities of known moments and evidence, by values alone, for importance sampling.
#include <cmath>
#include <utility>
#include <vector>

#include "knothe/posterior/draws/mixture.hpp"
#include "knothe/posterior/log_density.hpp"

namespace knothe::posterior::targets {

/// exp(log_evidence) times a mixture whose moments are known.
class KnownMixture final : public LogDensity {
 public:
  KnownMixture(std::vector<MixtureComponent> parts, double log_evidence)
      : mixture(std::move(parts)), log_evidence_(log_evidence) {}
  [[nodiscard]] Eigen::Index dimension() const override { return mixture.dimension(); }
  [[nodiscard]] int available_derivatives() const override { return 0; }
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int /*derivatives*/,
                LogDensityBatch& out) override {
    mixture.log_density(points, out.value);
    out.value.array() += log_evidence_;
  }
  [[nodiscard]] Eigen::VectorXd mean() const {
    Eigen::VectorXd m = Eigen::VectorXd::Zero(dimension());
    for (const auto& part : mixture.components()) m += part.weight * part.centre;
    return m;
  }
  [[nodiscard]] Eigen::VectorXd variance() const {
    Eigen::VectorXd v = Eigen::VectorXd::Zero(dimension());
    for (const auto& part : mixture.components())
      v += part.weight * (part.lower.rowwise().squaredNorm() + (part.centre - mean()).cwiseAbs2());
    return v;
  }
  posterior::Mixture mixture;

 private:
  double log_evidence_;
};

/// A thin shell in eight dimensions: no mixture of a few components follows it.
class Shell final : public LogDensity {
 public:
  [[nodiscard]] Eigen::Index dimension() const override { return 8; }
  [[nodiscard]] int available_derivatives() const override { return 0; }
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int /*derivatives*/,
                LogDensityBatch& out) override {
    out.value = -0.5 * ((points.rowwise().norm().array() - 2) / 0.01).square().matrix();
  }
};

}  // namespace knothe::posterior::targets
