#pragma once
/// @file Forward models with known derivatives, for tests of this room.
#include <cmath>
#include <functional>

#include "knothe/model/forward/forward_model.hpp"

namespace knothe::model::test_models {

/// f(p) = (p₀ e^{p₁}, p₀² + p₁, sin p₁): smooth, with exact derivatives, of which some may be hidden.
struct Smooth : ForwardModel {
  bool gradient_too = false, jacobian_too = false, hessian_too = false;

  [[nodiscard]] Eigen::Index dimension() const override { return 2; }
  [[nodiscard]] Eigen::Index output_count() const override { return 3; }
  [[nodiscard]] std::string where() const override { return "smooth model"; }
  [[nodiscard]] bool has_gradient() const override { return gradient_too; }
  [[nodiscard]] bool has_jacobian() const override { return jacobian_too; }
  [[nodiscard]] bool has_hessian() const override { return hessian_too; }

  static Eigen::Matrix<double, 3, 2> exact_jacobian(const Eigen::Vector2d& p) {
    Eigen::Matrix<double, 3, 2> j;
    j << std::exp(p[1]), p[0] * std::exp(p[1]), 2 * p[0], 1, 0, std::cos(p[1]);
    return j;
  }
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points,
                Eigen::Ref<Eigen::MatrixXd> values) override {
    for (Eigen::Index i = 0; i < points.cols(); ++i) {
      const double a = points(0, i), b = points(1, i);
      values.col(i) << a * std::exp(b), a * a + b, std::sin(b);
    }
    calls_.evaluations += points.cols();
  }
  void gradient(const Eigen::Ref<const Eigen::MatrixXd>& points, const Eigen::Ref<const Eigen::MatrixXd>& s,
                Eigen::Ref<Eigen::MatrixXd> out) override {
    for (Eigen::Index i = 0; i < points.cols(); ++i)
      out.col(i) = exact_jacobian(points.col(i)).transpose() * s.col(i);
    calls_.gradients += points.cols();
  }
  void jacobian(const Eigen::Ref<const Eigen::MatrixXd>& points, Eigen::Ref<Eigen::MatrixXd> out) override {
    for (Eigen::Index i = 0; i < points.cols(); ++i) out.col(i) = exact_jacobian(points.col(i)).reshaped();
    calls_.jacobians += points.size();
  }
  void hessian(const Eigen::Ref<const Eigen::MatrixXd>& points, const Eigen::Ref<const Eigen::MatrixXd>& s,
               Eigen::Ref<Eigen::MatrixXd> out) override {
    for (Eigen::Index i = 0; i < points.cols(); ++i) {
      const double a = points(0, i), b = points(1, i), e = std::exp(b);
      out.col(i) << 2 * s(1, i), s(0, i) * e, s(0, i) * e, s(0, i) * a * e - s(2, i) * std::sin(b);
    }
    calls_.hessians += points.size();
  }
};

/// One output, given as a function of a point.
struct Scalar : ForwardModel {
  Eigen::Index d;
  std::function<double(const Eigen::VectorXd&)> function;
  Scalar(Eigen::Index dimension_in, std::function<double(const Eigen::VectorXd&)> f)
      : d(dimension_in), function(std::move(f)) {}
  [[nodiscard]] Eigen::Index dimension() const override { return d; }
  [[nodiscard]] Eigen::Index output_count() const override { return 1; }
  [[nodiscard]] std::string where() const override { return "scalar model"; }
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points,
                Eigen::Ref<Eigen::MatrixXd> values) override {
    for (Eigen::Index i = 0; i < points.cols(); ++i) values(0, i) = function(points.col(i));
    calls_.evaluations += points.cols();
  }
};

}  // namespace knothe::model::test_models
