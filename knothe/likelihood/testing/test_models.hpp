#pragma once
/// @file Small models and checks that this room's tests share.
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <random>
#include <vector>

#include "knothe/likelihood/data/data_set.hpp"
#include "knothe/likelihood/step/composed_density.hpp"
#include "knothe/model/observe/observed_model.hpp"
#include "knothe/posterior/log_density.hpp"

namespace knothe::likelihood::test {

/// The only datum of a step, at the model time of that index.
inline DatumPointer datum(std::size_t step, const Eigen::VectorXd& values) {
  return std::make_shared<const Datum>(Datum{{}, step, step, values, std::nullopt});
}

/// w(p) = p, unbounded: the model of the Kalman filter.
class LinearFunctions : public model::ParameterFunctions {
 public:
  explicit LinearFunctions(Eigen::Index d) : d_(d) {}
  [[nodiscard]] Eigen::Index dimension() const override { return d_; }
  [[nodiscard]] Eigen::Index count() const override { return d_; }
  [[nodiscard]] Eigen::VectorXd lower() const override {
    return Eigen::VectorXd::Constant(d_, -std::numeric_limits<double>::infinity());
  }
  [[nodiscard]] Eigen::VectorXd upper() const override { return -lower(); }
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives,
                model::FunctionBatch& out) const override {
    out.value = points;
    for (Eigen::Index a = 0; derivatives >= 1 && a < d_; ++a) {
      out.first[a].setZero();
      out.first[a].col(a).setOnes();
    }
    for (auto& m : out.second) m.setZero();
  }

 private:
  Eigen::Index d_;
};

/// Three curved functions of two parameters on [0.5, 1.5]²: a banana-shaped dependence with products.
class CurvedFunctions final : public model::ParameterFunctions {
 public:
  [[nodiscard]] Eigen::Index dimension() const override { return 2; }
  [[nodiscard]] Eigen::Index count() const override { return 3; }
  [[nodiscard]] Eigen::VectorXd lower() const override { return Eigen::Vector2d::Constant(0.5); }
  [[nodiscard]] Eigen::VectorXd upper() const override { return Eigen::Vector2d::Constant(1.5); }
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives,
                model::FunctionBatch& out) const override {
    for (Eigen::Index i = 0; i < points.rows(); ++i) {
      const double a = points(i, 0), b = points(i, 1);
      out.value.row(i) << a * b, a * a * std::sin(b), 1 / (a + b * b);
      if (derivatives < 1) continue;
      const double q = a + b * b;
      out.first[0].row(i) << b, 2 * a * std::sin(b), -1 / (q * q);
      out.first[1].row(i) << a, a * a * std::cos(b), -2 * b / (q * q);
      if (derivatives < 2) continue;
      out.second[0].row(i) << 0, 2 * std::sin(b), 2 / (q * q * q);
      out.second[1].row(i) << 1, 2 * a * std::cos(b), 4 * b / (q * q * q);
      out.second[2].row(i) << 0, -a * a * std::sin(b), -2 / (q * q) + 8 * b * b / (q * q * q);
    }
  }
};

/// A model with random lift, space and core of n_obs observations, l space modes and n_t times.
inline std::shared_ptr<const model::ObservedModel> random_model(
    std::shared_ptr<const model::ParameterFunctions> functions, Eigen::Index n_obs, Eigen::Index l,
    Eigen::Index n_t, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  const auto fill = [&](Eigen::MatrixXd& m) { m = m.unaryExpr([&](double) { return normal(random); }); };
  auto model = std::make_shared<model::ObservedModel>();
  model->space.setZero(n_obs, l);
  model->lift.setZero(n_obs, n_t);
  fill(model->space);
  fill(model->lift);
  for (Eigen::Index t = 0; t < n_t; ++t) {
    model->time.push_back(static_cast<double>(t + 1));
    model->core.emplace_back(Eigen::MatrixXd::Zero(l, functions->count()));
    fill(model->core.back());
  }
  model->functions = std::move(functions);
  return model;
}

inline Eigen::MatrixXd synthetic_data(const model::ObservedModel& model, const Eigen::VectorXd& truth,
                                      const Eigen::VectorXd& std, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  Eigen::MatrixXd data(std.size(), static_cast<Eigen::Index>(model.time.size()));
  for (Eigen::Index t = 0; t < data.cols(); ++t) {
    data.col(t) = model.predict(truth, static_cast<std::size_t>(t));
    for (Eigen::Index i = 0; i < data.rows(); ++i) data(i, t) += std[i] * normal(random);
  }
  return data;
}

/// Gradient and Hessian of a two-parameter density against central differences.
inline void expect_exact_derivatives(posterior::LogDensity& density,
                                     const std::vector<std::array<double, 2>>& points) {
  posterior::LogDensityBatch here, plus, minus;
  for (auto* batch : {&here, &plus, &minus}) batch->resize(1, 2, 2);
  const double h = 1e-5;
  for (const auto& point : points) {
    const Eigen::RowVector2d x(point[0], point[1]);
    density.evaluate(x, 2, here);
    for (Eigen::Index a = 0; a < 2; ++a) {
      const Eigen::RowVector2d step = h * Eigen::RowVector2d::Unit(a);
      density.evaluate(x + step, 2, plus);
      density.evaluate(x - step, 2, minus);
      const double scale = 1 + std::abs(here.gradient(0, a));
      EXPECT_NEAR(here.gradient(0, a), (plus.value[0] - minus.value[0]) / (2 * h), 1e-6 * scale);
      for (Eigen::Index b = 0; b < 2; ++b) {
        const double exact = here.hessian(0, posterior::packed_index(a, b));
        EXPECT_NEAR(exact, (plus.gradient(0, b) - minus.gradient(0, b)) / (2 * h),
                    1e-5 * (1 + std::abs(exact)));
      }
    }
  }
}

}  // namespace knothe::likelihood::test
