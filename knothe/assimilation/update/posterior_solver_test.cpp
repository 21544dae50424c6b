/// @file Quadrature (`method.kind = "grid"`, `"auto"`) against a dense tensor-product quadrature of the
/// likelihood written out.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>

#include "knothe/assimilation/testing/dense_quadrature.hpp"
#include "knothe/assimilation/update/sequential_update.hpp"
#include "knothe/base/error.hpp"
#include "knothe/likelihood/testing/test_models.hpp"

namespace knothe::assimilation {
namespace {

using numerics::k_quantile_levels;

/// Four smooth functions of d parameters on [0.5, 1.5]^d: products, so that posteriors are bent.
class SmoothFunctions final : public model::ParameterFunctions {
 public:
  explicit SmoothFunctions(Eigen::Index d) : d_(d) {}
  [[nodiscard]] Eigen::Index dimension() const override { return d_; }
  [[nodiscard]] Eigen::Index count() const override { return 4; }
  [[nodiscard]] Eigen::VectorXd lower() const override { return Eigen::VectorXd::Constant(d_, 0.5); }
  [[nodiscard]] Eigen::VectorXd upper() const override { return Eigen::VectorXd::Constant(d_, 1.5); }
  /// w_k = sin(c_k·p), with c_k = (1 + k/2, …).
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives,
                model::FunctionBatch& out) const override {
    for (Eigen::Index k = 0; k < 4; ++k) {
      const Eigen::VectorXd c = Eigen::VectorXd::NullaryExpr(
          d_, [&](Eigen::Index a) { return 1 + 0.5 * static_cast<double>((k + 2 * a) % 4); });
      const Eigen::ArrayXd phase = (points * c).array();
      out.value.col(k) = phase.sin();
      for (Eigen::Index a = 0; derivatives >= 1 && a < d_; ++a) {
        out.first[static_cast<std::size_t>(a)].col(k) = c[a] * phase.cos();
        for (Eigen::Index b = 0; derivatives >= 2 && b <= a; ++b)
          out.second[static_cast<std::size_t>(posterior::packed_index(a, b))].col(k) =
              -c[a] * c[b] * phase.sin();
      }
    }
  }

 private:
  Eigen::Index d_;
};

/// log p(d₀ … d_{steps − 1} | p(z)) + log N(z; 0, I), term by term.
class WrittenOut final : public posterior::LogDensity {
 public:
  WrittenOut(const model::ObservedModel& model, const Eigen::MatrixXd& data, double std,
             const std::vector<posterior::Prior>& priors, Eigen::Index steps)
      : model_(model), data_(data), std_(std), priors_(priors), steps_(steps) {}
  [[nodiscard]] Eigen::Index dimension() const override { return static_cast<Eigen::Index>(priors_.size()); }
  [[nodiscard]] int available_derivatives() const override { return 0; }
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& z, int, posterior::LogDensityBatch& out) override {
    const Eigen::Index n = z.rows(), d = dimension();
    Eigen::MatrixXd p(n, d);
    for (Eigen::Index k = 0; k < d; ++k)
      for (Eigen::Index i = 0; i < n; ++i) p(i, k) = from(k, z(i, k));
    model::FunctionBatch w;
    w.resize(n, d, 4, 0);
    model_.functions->evaluate(p, 0, w);
    out.value = -0.5 * z.rowwise().squaredNorm();
    out.value.array() -= 0.5 * static_cast<double>(d) * std::log(2 * M_PI);
    for (Eigen::Index t = 0; t < steps_; ++t) {
      const Eigen::MatrixXd e =
          ((model_.space * model_.core[static_cast<std::size_t>(t)] * w.value.transpose()).colwise() +
           (model_.lift.col(t) - data_.col(t))) /
          std_;
      out.value -= 0.5 * e.colwise().squaredNorm().transpose();
      out.value.array() -= static_cast<double>(e.rows()) * (std::log(std_) + 0.5 * std::log(2 * M_PI));
    }
  }
  /// p(z), interpolated nowhere: but a truncated prior's inverse is slow, so the last answer is kept.
  double from(Eigen::Index k, double z) {
    auto& last = last_[static_cast<std::size_t>(k)];
    if (!(last.first == z)) last = {z, priors_[static_cast<std::size_t>(k)].from_standard_normal(z).value};
    return last.second;
  }

 private:
  const model::ObservedModel& model_;
  const Eigen::MatrixXd& data_;
  double std_;
  std::vector<posterior::Prior> priors_;
  Eigen::Index steps_;
  std::array<std::pair<double, double>, 3> last_{{{NAN, 0}, {NAN, 0}, {NAN, 0}}};
};

/// What is made from the weighted points: mean and standard deviation of a function of p.
std::array<double, 2> forecast(const posterior::Posterior& posterior, const Eigen::VectorXd& direction) {
  const Eigen::ArrayXd q = (posterior.points * direction).array().exp();
  const double mean = (posterior.weights.array() * q).sum();
  return {mean, std::sqrt((posterior.weights.array() * (q - mean).square()).sum())};
}

struct ByQuadrature {
  Eigen::Index dimension;
  posterior::Method kind;
  double moments, quantiles;  ///< tolerances, in standard deviations
};

void PrintTo(const ByQuadrature& way, std::ostream* out) {
  *out << to_text(way.kind) << " of " << way.dimension;
}

class Quadrature : public ::testing::TestWithParam<ByQuadrature> {};

TEST_P(Quadrature, AgreesWithADenseQuadratureFromThePriorOn) {
  const auto [d, kind, of_moments, of_quantiles] = GetParam();
  const Eigen::Index n = 6;
  const double std = 0.7;
  const auto model = likelihood::test::random_model(std::make_shared<SmoothFunctions>(d), n, 4, 4, 21);
  Eigen::MatrixXd data = likelihood::test::synthetic_data(*model, Eigen::VectorXd::LinSpaced(d, 1.3, 0.8),
                                                          Eigen::VectorXd::Constant(n, std), 17);
  data.col(0).setConstant(std::nan(""));  // step 0: the prior only
  std::vector<posterior::Prior> priors;
  for (Eigen::Index k = 0; k < d; ++k)
    priors.push_back(posterior::Prior::normal(0.9 + 0.1 * static_cast<double>(k), std::sqrt(0.2)));
  UpdateOptions options;
  options.kind = kind;
  SequentialUpdate update(model, likelihood::NoiseModel::independent(Eigen::VectorXd::Constant(n, std)),
                          priors, options);
  priors = update.transform().priors();
  const Eigen::VectorXd direction = Eigen::VectorXd::LinSpaced(d, 1.0, -0.5);
  Eigen::MatrixXd measured = data.rightCols(3);
  auto later = std::make_shared<model::ObservedModel>(*model);
  later->core.erase(later->core.begin());
  later->lift = model->lift.rightCols(3).eval();
  for (std::size_t t = 0; t < 4; ++t) {
    const UpdateResult& r = update.update(t, t, data.col(static_cast<Eigen::Index>(t)));
    WrittenOut density(*later, measured, std, priors, static_cast<Eigen::Index>(t));
    const auto p_of_z = [&](Eigen::Index k, double z) { return density.from(k, z); };
    const test::DenseQuadrature exact(density, p_of_z, d == 3 ? 101 : 201);
    SCOPED_TRACE(t);
    EXPECT_TRUE(r.trusted) << r.remark;
    EXPECT_EQ(r.remark, "");
    EXPECT_EQ(r.method, posterior::Method::grid);
    EXPECT_NEAR(r.log_evidence, exact.log_evidence, of_moments);
    for (Eigen::Index k = 0; k < d; ++k) {
      const double s = std::sqrt(exact.covariance(k, k));
      EXPECT_NEAR(r.mean[k], exact.mean[k], of_moments * s);
      EXPECT_NEAR(std::sqrt(r.covariance(k, k)) / s, 1, of_moments);
      for (std::size_t j = 0; j < k_quantile_levels.size(); ++j)
        EXPECT_NEAR(r.quantiles(k, static_cast<Eigen::Index>(j)),
                    p_of_z(k, exact.quantile(k, k_quantile_levels[j])), of_quantiles * s)
            << "parameter " << k << ", level " << k_quantile_levels[j];
    }
    const auto q = [&](const Eigen::VectorXd& z) {
      double sum = 0;
      for (Eigen::Index k = 0; k < d; ++k) sum += direction[k] * p_of_z(k, z[k]);
      return std::exp(sum);
    };
    const double mean = exact.expectation(q);
    const double deviation =
        std::sqrt(exact.expectation([&](const Eigen::VectorXd& z) { return std::pow(q(z) - mean, 2); }));
    const auto [found_mean, found_deviation] = forecast(update.result(), direction);
    EXPECT_NEAR(found_mean, mean, of_quantiles * deviation);
    EXPECT_NEAR(found_deviation / deviation, 1, of_quantiles);
    if (r.few.weights.size() == 0) continue;
    // The coarser rule, cut off where it carries little.
    posterior::Posterior few;
    few.points = r.few.points;
    few.weights = r.few.weights;
    const auto [few_mean, few_deviation] = forecast(few, direction);
    EXPECT_NEAR(few_mean, mean, 0.02 * deviation);
    EXPECT_NEAR(few_deviation / deviation, 1, 0.04);
    EXPECT_LE(few.weights.size(), 256);
  }
}

INSTANTIATE_TEST_SUITE_P(OneToThreeParameters, Quadrature,
                         ::testing::Values(ByQuadrature{1, posterior::Method::grid, 1e-4, 1e-3},
                                           ByQuadrature{2, posterior::Method::grid, 1e-4, 1e-3},
                                           ByQuadrature{3, posterior::Method::grid, 1e-4, 1e-3},
                                           ByQuadrature{1, posterior::Method::automatic, 1e-3, 5e-3},
                                           ByQuadrature{2, posterior::Method::automatic, 1e-3, 5e-3},
                                           ByQuadrature{3, posterior::Method::automatic, 1e-3, 5e-2}));

TEST(QuadratureOfAMixture, PartByPartIsThatOfTheWhole) {
  // Four sizes of a discrepancy make a mixture of narrow and wide posteriors of three parameters.
  const Eigen::Index n = 6;
  const double std = 0.5;  // with less no grid resolves the whole mixture
  const auto model = likelihood::test::random_model(std::make_shared<SmoothFunctions>(3), n, 4, 4, 21);
  Eigen::MatrixXd data = likelihood::test::synthetic_data(*model, Eigen::Vector3d(1.3, 1.05, 0.8),
                                                          Eigen::VectorXd::Constant(n, std), 17);
  data.row(2).array() += 1;  // what the model cannot say
  UpdateOptions options;
  options.bias_correction = likelihood::BiasCorrectionMode::on;
  options.bias.way = likelihood::BiasOptions::Way::joint;
  const auto noise = likelihood::NoiseModel::independent(Eigen::VectorXd::Constant(n, std));
  const std::vector<posterior::Prior> priors(3, posterior::Prior::normal(1, std::sqrt(0.1)));
  SequentialUpdate by_parts(model, noise, priors, options);
  options.kind = posterior::Method::grid;
  SequentialUpdate whole(model, noise, priors, options);
  for (std::size_t t = 0; t < 2; ++t) {
    SCOPED_TRACE(t);
    const UpdateResult& r = by_parts.update(t, t, data.col(static_cast<Eigen::Index>(t)));
    const UpdateResult& exact = whole.update(t, t, data.col(static_cast<Eigen::Index>(t)));
    EXPECT_EQ(r.method, posterior::Method::grid);
    EXPECT_TRUE(r.by_quadrature) << r.remark;
    EXPECT_TRUE(exact.trusted) << exact.remark;
    EXPECT_NEAR(r.log_evidence, exact.log_evidence, 2e-3);
    const Eigen::VectorXd s = exact.standard_deviations();
    EXPECT_LT((r.mean - exact.mean).cwiseQuotient(s).cwiseAbs().maxCoeff(), 3e-3);
    EXPECT_LT((r.standard_deviations().cwiseQuotient(s).array() - 1).abs().maxCoeff(), 3e-3);
    for (Eigen::Index k = 0; k < 3; ++k)
      EXPECT_LT(((r.quantiles - exact.quantiles).row(k) / s[k]).cwiseAbs().maxCoeff(), 0.02) << k;
  }
}

TEST(GridUpdate, QuantilesOfAStandardNormalPriorAreRightToAThousandth) {
  const Eigen::Index d = 3;
  const auto model =
      likelihood::test::random_model(std::make_shared<likelihood::test::LinearFunctions>(d), 4, 4, 1, 3);
  UpdateOptions options;
  options.kind = posterior::Method::grid;
  SequentialUpdate update(model, likelihood::NoiseModel::independent(Eigen::Vector4d::Ones()),
                          std::vector<posterior::Prior>(3, posterior::Prior::normal(0, 1)), options);
  const UpdateResult& r = update.update(0, 0, Eigen::Vector4d::Constant(std::nan("")));
  EXPECT_NEAR(r.log_evidence, 0, 1e-6);
  for (Eigen::Index k = 0; k < d; ++k) {
    EXPECT_NEAR(r.mean[k], 0, 1e-6);
    EXPECT_NEAR(r.quantiles(k, 0), -1.959963984540054, 1e-3);
    EXPECT_NEAR(r.quantiles(k, 1), -0.6744897501960817, 1e-3);
    EXPECT_NEAR(r.quantiles(k, 4), 1.959963984540054, 1e-3);
  }
}

TEST(GridUpdate, RefusesFourParameters) {
  const auto model =
      likelihood::test::random_model(std::make_shared<likelihood::test::LinearFunctions>(4), 4, 4, 1, 3);
  UpdateOptions options;
  options.kind = posterior::Method::grid;
  try {
    SequentialUpdate(model, likelihood::NoiseModel::independent(Eigen::Vector4d::Ones()),
                     std::vector<posterior::Prior>(4, posterior::Prior::normal(0, 1)), options);
    FAIL();
  } catch (const ProjectError& error) {
    EXPECT_STREQ(error.what(), "method.kind = \"grid\" takes 1 to 3 parameters; use \"transport\" for more");
  }
}

}  // namespace
}  // namespace knothe::assimilation
