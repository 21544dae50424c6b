#include "knothe/likelihood/noise/nuisance_filter.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <functional>
#include <numbers>
#include <numeric>
#include <random>

#include "knothe/assimilation/update/sequential_update.hpp"
#include "knothe/base/error.hpp"
#include "knothe/likelihood/discrepancy/joint_discrepancy.hpp"
#include "knothe/likelihood/noise/joint_noise.hpp"
#include "knothe/likelihood/step/collapsed_posterior.hpp"
#include "knothe/likelihood/step/datum_projector.hpp"
#include "knothe/likelihood/testing/test_models.hpp"

namespace knothe::assimilation {
namespace {

using likelihood::test::CurvedFunctions;
using likelihood::test::random_model;
using likelihood::test::synthetic_data;

constexpr Eigen::Index k_dofs = 9, k_steps = 5;
const double k_nan = std::nan("");

/// A sparse precision: second differences plus a multiple of the identity, times `scale`.
Eigen::SparseMatrix<double> chain(double scale, Eigen::Index n = k_dofs) {
  std::vector<Eigen::Triplet<double>> entries;
  for (int i = 0; i < n; ++i) {
    entries.emplace_back(i, i, scale * (2.5 + 0.1 * i));
    if (i == 0) continue;
    entries.emplace_back(i, i - 1, -scale);
    entries.emplace_back(i - 1, i, -scale);
  }
  Eigen::SparseMatrix<double> m(n, n);
  m.setFromTriplets(entries.begin(), entries.end());
  return m;
}

/// What the noise says, as dense covariances of one step's own error and of the shared one.
struct DenseNoise {
  std::vector<Eigen::MatrixXd> own;      ///< per step
  std::vector<Eigen::MatrixXd> lasting;  ///< B_t of the errors that last, per step
  Eigen::MatrixXd shared;
  double scale_std;
  Eigen::Index displacements;  ///< the first ones
};

DenseNoise dense(const likelihood::NoiseModel& noise) {
  const double k = noise.shared_reference();
  const Eigen::Index n = k_dofs - noise.scalar_count();
  DenseNoise result;
  for (std::size_t t = 0; t < k_steps; ++t) {
    Eigen::MatrixXd own = Eigen::MatrixXd(noise.at_step(t).precision()).inverse();
    if (k > 0) own.topLeftCorner(n, n) *= k / (k + 1);
    if (const Eigen::MatrixXd* factor = noise.step_error(t)) own += *factor * factor->transpose();
    result.own.push_back(own);
    result.lasting.push_back(noise.lasting().factor(t) != nullptr ? *noise.lasting().factor(t)
                                                                  : Eigen::MatrixXd::Zero(k_dofs, 1));
  }
  const Eigen::MatrixXd r = Eigen::MatrixXd(noise.measurement().precision()).inverse();
  result.scale_std = noise.scale_std();
  result.displacements = n;
  result.shared = Eigen::MatrixXd::Zero(k_dofs, k_dofs);
  if (k > 0) result.shared.topLeftCorner(n, n) = r.topLeftCorner(n, n) / (k + 1);
  result.shared.topLeftCorner(n, n).diagonal().array() += std::pow(noise.offset_std(), 2);
  return result;
}

/// log N of all values present, jointly, from the dense covariance of everything.
double dense_log_likelihood(
    const model::ObservedModel& model, const Eigen::MatrixXd& data, const DenseNoise& noise,
    const Eigen::VectorXd& p,
    const std::function<double(Eigen::Index, Eigen::Index, Eigen::Index, Eigen::Index)>& more = {}) {
  std::vector<std::pair<Eigen::Index, Eigen::Index>> present;
  std::vector<double> residual;
  for (Eigen::Index t = 0; t < data.cols(); ++t) {
    const Eigen::VectorXd predicted = model.predict(p, static_cast<std::size_t>(t));
    for (Eigen::Index i = 0; i < k_dofs; ++i) {
      if (std::isnan(data(i, t))) continue;
      present.emplace_back(i, t);
      residual.push_back(data(i, t) - predicted[i]);
    }
  }
  const auto n = static_cast<Eigen::Index>(present.size());
  // About which a scale is linearised.
  Eigen::MatrixXd central = Eigen::MatrixXd::Zero(k_dofs, data.cols());
  for (Eigen::Index t = 0; noise.scale_std > 0 && t < data.cols(); ++t)
    central.col(t).head(noise.displacements) =
        model.predict(Eigen::Vector2d(1, 1), static_cast<std::size_t>(t)).head(noise.displacements);
  Eigen::MatrixXd covariance(n, n);
  for (Eigen::Index a = 0; a < n; ++a) {
    for (Eigen::Index b = 0; b < n; ++b) {
      const auto [i, t] = present[a];
      const auto [j, s] = present[b];
      covariance(a, b) = noise.shared(i, j) + (t == s ? noise.own[t](i, j) : 0.0) +
                         std::pow(noise.scale_std, 2) * central(i, t) * central(j, s) +
                         noise.lasting[t].row(i).dot(noise.lasting[s].row(j));
      if (more) covariance(a, b) += more(i, t, j, s);
    }
  }
  const Eigen::Map<const Eigen::VectorXd> r(residual.data(), n);
  const Eigen::LLT<Eigen::MatrixXd> factor(covariance);
  return -0.5 * r.dot(factor.solve(r)) - Eigen::MatrixXd(factor.matrixL()).diagonal().array().log().sum() -
         0.5 * static_cast<double>(n) * std::log(2 * std::numbers::pi);
}

/// The same from the noise of all values at once, by `JointNoise`.
double log_likelihood_at_once(const model::ObservedModel& model, const Eigen::MatrixXd& data,
                              const likelihood::NoiseModel& noise, const Eigen::VectorXd& p) {
  Eigen::MatrixXd central(k_dofs, data.cols()), residual(k_dofs, data.cols());
  for (Eigen::Index t = 0; t < data.cols(); ++t) {
    central.col(t) = model.predict(Eigen::Vector2d(1, 1), static_cast<std::size_t>(t));
    residual.col(t) = data.col(t) - model.predict(p, static_cast<std::size_t>(t));
  }
  std::vector<double> present;
  for (const double r : residual.reshaped())
    if (!std::isnan(r)) present.push_back(r);
  const Eigen::Map<const Eigen::VectorXd> r(present.data(), std::ssize(present));
  const likelihood::JointNoise joint = likelihood::joint_noise(noise, data, central);
  EXPECT_EQ(joint.size(), r.size());
  return -0.5 * (r.dot(joint.apply(r).col(0)) + joint.log_determinant() +
                 static_cast<double>(r.size()) * std::log(2 * std::numbers::pi));
}

void expect_is_the_joint_gaussian(const likelihood::NoiseModel& noise, const Eigen::MatrixXd& data,
                                  const std::shared_ptr<const model::ObservedModel>& model) {
  const std::vector<posterior::Prior> priors = {posterior::Prior::uniform(0.5, 1.5),
                                                posterior::Prior::uniform(0.5, 1.5)};
  likelihood::DatumProjector projector(model, noise, Eigen::Vector2d(1, 1));
  likelihood::CollapsedLogDensity density(
      model->functions, std::make_shared<posterior::PriorTransform>(priors), projector.central_functions());
  likelihood::StepForm sum = likelihood::StepForm::zero(3), form;
  posterior::LogDensityBatch batch;
  batch.resize(1, 2, 0);
  const DenseNoise matrices = dense(noise);
  for (Eigen::Index t = 0; t < data.cols(); ++t) {
    projector.project(static_cast<std::size_t>(t), static_cast<std::size_t>(t), data.col(t), form);
    EXPECT_EQ(form.missing, data.col(t).array().isNaN().count());
    sum.add(form);
    density.set_form(sum);
    for (const Eigen::Vector2d& p :
         {Eigen::Vector2d(1, 1), Eigen::Vector2d(0.6, 1.4), Eigen::Vector2d(1.3, 0.8)}) {
      density.evaluate_likelihood(p.transpose(), 0, batch);
      const double exact = dense_log_likelihood(*model, data.leftCols(t + 1), matrices, p);
      EXPECT_NEAR(batch.value[0], exact, 1e-10 * std::abs(exact) + 1e-9) << "step " << t;
      EXPECT_NEAR(log_likelihood_at_once(*model, data.leftCols(t + 1), noise, p), exact,
                  1e-10 * std::abs(exact) + 1e-9)
          << "step " << t;
    }
  }
}

class SharedError : public ::testing::TestWithParam<int> {
 protected:
  std::shared_ptr<const model::ObservedModel> model_ = likelihood::test::random_model(
      std::make_shared<likelihood::test::CurvedFunctions>(), k_dofs, 4, k_steps, 3);
  Eigen::MatrixXd data_ = likelihood::test::synthetic_data(*model_, Eigen::Vector2d(1.1, 0.8),
                                                           Eigen::VectorXd::Constant(k_dofs, 0.3), 8);
};

TEST_P(SharedError, CompleteDataAreJointlyGaussian) {
  expect_is_the_joint_gaussian(likelihood::NoiseModel::correlated(chain(4)).with_shared_reference(GetParam()),
                               data_, model_);
}

TEST_P(SharedError, DofsThatNeverReport) {
  for (const Eigen::Index i : {0, 4, 5}) data_.row(i).setConstant(k_nan);
  expect_is_the_joint_gaussian(likelihood::NoiseModel::correlated(chain(4)).with_shared_reference(GetParam()),
                               data_, model_);
}

TEST_P(SharedError, OtherDofsMissingAtEachStep) {
  data_(3, 1) = data_(4, 1) = data_(0, 2) = data_(4, 4) = k_nan;
  data_.col(3).setConstant(k_nan);
  expect_is_the_joint_gaussian(likelihood::NoiseModel::correlated(chain(4)).with_shared_reference(GetParam()),
                               data_, model_);
}

TEST_P(SharedError, OnePictureHasAnotherNoise) {
  data_(6, 2) = data_(2, 3) = k_nan;
  const likelihood::NoiseModel noise = likelihood::NoiseModel::correlated(chain(4)).with_step(
      2, likelihood::GaussianNoise::correlated(chain(1.5)));
  expect_is_the_joint_gaussian(noise.with_shared_reference(GetParam()), data_, model_);
}

TEST_P(SharedError, AScaleThatIsNotKnownExactly) {
  const likelihood::NoiseModel noise =
      likelihood::NoiseModel::correlated(chain(4)).with_shared_reference(GetParam()).with_scale_error(0.3);
  expect_is_the_joint_gaussian(noise, data_, model_);
  data_(6, 2) = data_(2, 3) = k_nan;
  expect_is_the_joint_gaussian(noise.with_step(2, likelihood::GaussianNoise::correlated(chain(1.5))), data_,
                               model_);
}

TEST_P(SharedError, IndependentSensors) {
  data_(3, 1) = data_(4, 1) = data_(0, 2) = k_nan;
  const likelihood::NoiseModel noise =
      likelihood::NoiseModel::independent(Eigen::VectorXd::LinSpaced(k_dofs, 0.2, 0.5));
  expect_is_the_joint_gaussian(noise.with_shared_reference(GetParam()), data_, model_);
}

TEST_P(SharedError, DofsWithoutAnElement) {
  // Rows of zeros: what is measured there does not count, whatever its value.
  Eigen::SparseMatrix<double> precision = chain(4);
  for (const int i : {0, 4}) {
    for (int j = 0; j < k_dofs; ++j) {
      if (precision.coeff(i, j) != 0) precision.coeffRef(i, j) = precision.coeffRef(j, i) = 0;
    }
  }
  const std::vector<Eigen::Index> kept = {1, 2, 3, 5, 6, 7, 8};
  auto reduced = std::make_shared<model::ObservedModel>(*model_);
  reduced->space = model_->space(kept, Eigen::all);
  reduced->lift = model_->lift(kept, Eigen::all);
  const Eigen::SparseMatrix<double> block = Eigen::MatrixXd(precision)(kept, kept).eval().sparseView();
  const likelihood::NoiseModel whole =
      likelihood::NoiseModel::correlated(precision).with_shared_reference(GetParam());
  const likelihood::NoiseModel part =
      likelihood::NoiseModel::correlated(block).with_shared_reference(GetParam());
  likelihood::DatumProjector with(model_, whole, Eigen::Vector2d(1, 1)),
      without(reduced, part, Eigen::Vector2d(1, 1));
  likelihood::StepForm a, b;
  for (std::size_t t = 0; t < k_steps; ++t) {
    const Eigen::VectorXd values = data_.col(static_cast<Eigen::Index>(t));
    with.project(t, t, values, a);
    without.project(t, t, values(kept), b);
    EXPECT_EQ(a.missing, 2);
    EXPECT_NEAR(a.constant, b.constant, 1e-12 * b.constant);
    EXPECT_NEAR(a.log_normaliser, b.log_normaliser, 1e-12);
    EXPECT_TRUE(a.quadratic.isApprox(b.quadratic, 1e-12));
    EXPECT_TRUE(a.linear.isApprox(b.linear, 1e-12));
  }
  EXPECT_EQ(whole.measurement().standard_deviations()[4], 0);
}

/// Errors of the clock at three of the steps.
likelihood::NoiseModel with_clock(likelihood::NoiseModel noise) {
  for (const std::size_t step : {1, 2, 4}) {
    const Eigen::Index columns = step == 2 ? 2 : 1;
    noise = noise.with_step_error(step, Eigen::MatrixXd::Random(k_dofs, columns));
  }
  return noise;
}

/// Each with all values, with some missing now and then, and with another noise at one step.
void expect_it_is_whatever_is_missing(const likelihood::NoiseModel& noise, Eigen::MatrixXd data,
                                      const std::shared_ptr<const model::ObservedModel>& model) {
  expect_is_the_joint_gaussian(noise, data, model);
  const Eigen::Index scalars = noise.scalar_count();
  likelihood::GaussianNoise wider = likelihood::GaussianNoise::correlated(chain(1.5, k_dofs - scalars));
  if (scalars > 0) wider = wider.with_independent(Eigen::VectorXd::Constant(scalars, 0.3));
  expect_is_the_joint_gaussian(noise.with_step(2, wider), data, model);
  data(3, 1) = data(4, 1) = data(0, 2) = data(4, 4) = k_nan;
  expect_is_the_joint_gaussian(noise, data, model);
  expect_is_the_joint_gaussian(noise.with_step(2, wider), data, model);
}

TEST_P(SharedError, OffsetsBesideIt) {
  const likelihood::NoiseModel noise =
      likelihood::NoiseModel::correlated(chain(4)).with_shared_reference(GetParam());
  expect_it_is_whatever_is_missing(noise.with_offsets(0.4), data_, model_);
  const likelihood::NoiseModel sensors =
      likelihood::NoiseModel::independent(Eigen::VectorXd::LinSpaced(k_dofs, 0.2, 0.5));
  expect_it_is_whatever_is_missing(sensors.with_shared_reference(GetParam()).with_offsets(0.4), data_,
                                   model_);
}

TEST_P(SharedError, AClockBesideIt) {
  const likelihood::NoiseModel noise =
      likelihood::NoiseModel::correlated(chain(4)).with_shared_reference(GetParam());
  expect_it_is_whatever_is_missing(with_clock(noise), data_, model_);
  expect_it_is_whatever_is_missing(with_clock(noise.with_offsets(0.4)), data_, model_);
  const likelihood::NoiseModel sensors =
      likelihood::NoiseModel::independent(Eigen::VectorXd::LinSpaced(k_dofs, 0.2, 0.5));
  expect_it_is_whatever_is_missing(with_clock(sensors.with_shared_reference(GetParam())), data_, model_);
  expect_it_is_whatever_is_missing(with_clock(sensors.with_offsets(0.4)), data_, model_);
}

TEST_P(SharedError, ForcesAndGaugesBesideIt) {
  const likelihood::NoiseModel noise = likelihood::NoiseModel::correlated(chain(4, k_dofs - 2))
                                           .with_shared_reference(GetParam())
                                           .with_scalars(Eigen::Vector2d(0.2, 0.6));
  expect_it_is_whatever_is_missing(noise, data_, model_);
  data_(8, 3) = k_nan;
  expect_it_is_whatever_is_missing(noise.with_offsets(0.4), data_, model_);
}

TEST_P(SharedError, AScaleBesideOffsetsClockForcesAndGauges) {
  const Eigen::VectorXd std = Eigen::VectorXd::LinSpaced(k_dofs, 0.2, 0.5);
  const likelihood::NoiseModel sensors =
      likelihood::NoiseModel::independent(std).with_shared_reference(GetParam());
  expect_it_is_whatever_is_missing(sensors.with_scale_error(0.3), data_, model_);
  expect_it_is_whatever_is_missing(sensors.with_offsets(0.4).with_scale_error(0.3), data_, model_);
  expect_it_is_whatever_is_missing(with_clock(sensors.with_scale_error(0.3)), data_, model_);
  const likelihood::NoiseModel pictures =
      likelihood::NoiseModel::correlated(chain(4, k_dofs - 2)).with_scalars(Eigen::Vector2d(0.2, 0.6));
  expect_it_is_whatever_is_missing(pictures.with_scale_error(0.3), data_, model_);
  expect_it_is_whatever_is_missing(
      with_clock(pictures.with_shared_reference(GetParam()).with_offsets(0.4).with_scale_error(0.3)), data_,
      model_);
}

/// A discrepancy beside the shared error: the sum of the forms against the dense covariance of all values.
/// The data before `first` have none.
void expect_discrepancy_is_joint(const likelihood::NoiseModel& noise, const Eigen::MatrixXd& data,
                                 double tolerance, std::size_t first = 0) {
  const auto model = likelihood::test::random_model(std::make_shared<likelihood::test::LinearFunctions>(3),
                                                    k_dofs, 4, k_steps, 3);
  Eigen::VectorXd centre(3);
  centre << 0.1, 0.2, 0.3;
  likelihood::DatumProjector projector(model, noise, centre);
  Eigen::MatrixXd factor(3, 2);
  factor << 0.9, 0.2, -0.4, 0.8, 0.3, 0.5;
  const double kappa = 0.4, memory = 3, rho = std::exp(-1 / memory);
  likelihood::JointDiscrepancy joint(factor, kappa, memory);
  likelihood::StepForm sum = likelihood::StepForm::zero(3), form;
  likelihood::MovedForm moved;
  DenseNoise matrices = dense(noise);
  std::vector<Eigen::MatrixXd> moves;
  for (std::size_t t = 0; t < k_steps; ++t) {
    projector.project(t, t, data.col(static_cast<Eigen::Index>(t)), form, &moved);
    sum.add(t < first ? form : joint.condition(moved, model->core[t]));
    moves.push_back((t < first ? 0 : kappa) * model->space * model->core[t] * factor);
  }
  const auto covariance = [&](Eigen::Index i, Eigen::Index t, Eigen::Index j, Eigen::Index s) {
    return std::pow(rho, static_cast<double>(std::abs(t - s))) * moves[t].row(i).dot(moves[s].row(j));
  };
  for (const double a : {-1.0, 0.5, 2.0}) {
    Eigen::VectorXd p(3);
    p << a, 1 - a, 0.3 * a;
    const Eigen::VectorXd v = p - centre;
    const double exact = dense_log_likelihood(*model, data, matrices, p, covariance);
    const double here =
        -0.5 * (v.dot(sum.quadratic * v) - 2 * sum.linear.dot(v) + sum.constant + sum.log_normaliser);
    EXPECT_NEAR(here, exact, tolerance * std::abs(exact));
  }
}

TEST_P(SharedError, WithADiscrepancyCompleteDataAreJointlyGaussian) {
  for (const Eigen::Index i : {0, 5}) data_.row(i).setConstant(k_nan);
  data_.col(2).setConstant(k_nan);
  if (GetParam() == 0) return;  // nothing is shared
  expect_discrepancy_is_joint(likelihood::NoiseModel::correlated(chain(4)).with_shared_reference(GetParam()),
                              data_, 1e-9);
  const likelihood::NoiseModel sensors =
      likelihood::NoiseModel::independent(Eigen::VectorXd::LinSpaced(k_dofs, 0.2, 0.5));
  expect_discrepancy_is_joint(sensors.with_shared_reference(GetParam()), data_, 1e-9);
}

TEST_P(SharedError, WithADiscrepancyAndValuesMissingNowAndThenTheyAreToo) {
  data_(3, 1) = data_(4, 4) = k_nan;
  if (GetParam() == 0) return;
  const likelihood::NoiseModel noise = likelihood::NoiseModel::correlated(chain(4)).with_step(
      2, likelihood::GaussianNoise::correlated(chain(1.5)));
  expect_discrepancy_is_joint(noise.with_shared_reference(GetParam()), data_, 1e-9);
  const likelihood::NoiseModel sensors =
      likelihood::NoiseModel::independent(Eigen::VectorXd::LinSpaced(k_dofs, 0.2, 0.5));
  expect_discrepancy_is_joint(sensors.with_shared_reference(GetParam()), data_, 1e-9);
}

/// As when the correction is switched on in the midst of a test.
TEST_P(SharedError, ADiscrepancyThatBeginsLaterIsJointToo) {
  data_(4, 1) = k_nan;
  if (GetParam() == 0) return;
  const likelihood::NoiseModel sensors =
      likelihood::NoiseModel::independent(Eigen::VectorXd::LinSpaced(k_dofs, 0.2, 0.5));
  for (const std::size_t first : {1u, 2u, 3u})
    expect_discrepancy_is_joint(sensors.with_shared_reference(GetParam()), data_, 1e-9, first);
}

TEST_P(SharedError, WithADiscrepancyAndOffsetsTheyAreToo) {
  const likelihood::NoiseModel noise =
      likelihood::NoiseModel::correlated(chain(4)).with_shared_reference(GetParam()).with_offsets(0.4);
  expect_discrepancy_is_joint(noise, data_, 1e-9);
  data_(3, 1) = data_(4, 4) = k_nan;
  expect_discrepancy_is_joint(noise.with_step(2, likelihood::GaussianNoise::correlated(chain(1.5))), data_,
                              1e-9);
}

INSTANTIATE_TEST_SUITE_P(ReferencePictures, SharedError, ::testing::Values(0, 1, 4));

/// Ellipsoids of 95 % of v from pictures with a scale that is off by a factor drawn again for each test.
/// Two errors of other sizes at each step and sensor.
std::vector<Eigen::MatrixXd> lasting_errors() {
  std::vector<Eigen::MatrixXd> factors;
  for (Eigen::Index t = 0; t < k_steps; ++t) {
    Eigen::MatrixXd factor(k_dofs, 2);
    for (Eigen::Index i = 0; i < k_dofs; ++i) {
      const double sensor = static_cast<double>(i), step = static_cast<double>(t);
      factor.row(i) << 0.4 * std::sin(1 + sensor + step), 0.1 * step;
    }
    factors.push_back(factor);
  }
  return factors;
}

likelihood::LastingErrors two_errors() {
  return {{{"first", 1}, {"second", 1}}, lasting_errors()};
}

TEST_P(SharedError, ErrorsThatLastBesideIt) {
  const likelihood::NoiseModel noise = likelihood::NoiseModel::correlated(chain(4))
                                           .with_shared_reference(GetParam())
                                           .with_lasting_errors(two_errors());
  expect_is_the_joint_gaussian(noise, data_, model_);
  data_(6, 2) = data_(2, 3) = k_nan;
  expect_is_the_joint_gaussian(noise.with_scale_error(0.3), data_, model_);
}

TEST(LastingError, IndependentNoiseBesideIt) {
  const auto model = likelihood::test::random_model(std::make_shared<likelihood::test::CurvedFunctions>(),
                                                    k_dofs, 4, k_steps, 3);
  Eigen::MatrixXd data = likelihood::test::synthetic_data(*model, Eigen::Vector2d(1.1, 0.8),
                                                          Eigen::VectorXd::Constant(k_dofs, 0.3), 8);
  data(3, 1) = data(4, 1) = data(0, 2) = k_nan;
  const likelihood::NoiseModel noise =
      likelihood::NoiseModel::independent(Eigen::VectorXd::LinSpaced(k_dofs, 0.2, 0.5))
          .with_lasting_errors(two_errors());
  expect_is_the_joint_gaussian(noise, data, model);
  EXPECT_TRUE(likelihood::links_steps(noise));
  EXPECT_EQ(noise.restricted({1, 4}).lasting().factor(2)->row(1), noise.lasting().factor(2)->row(4));
}

/// For w = p and a normal prior all is jointly Gaussian in (p, z): a least-squares problem.
TEST(LastingError, ItsPosteriorIsThatOfTheJointGaussian) {
  constexpr Eigen::Index d = 3, q = 2;
  const auto model = likelihood::test::random_model(std::make_shared<likelihood::test::LinearFunctions>(d),
                                                    k_dofs, 4, k_steps, 3);
  const Eigen::VectorXd std = Eigen::VectorXd::LinSpaced(k_dofs, 0.2, 0.5);
  const Eigen::MatrixXd data =
      likelihood::test::synthetic_data(*model, Eigen::Vector3d(0.3, -0.2, 0.5), std, 8);
  const std::vector<Eigen::MatrixXd> factors = lasting_errors();
  likelihood::DatumProjector projector(
      model, likelihood::NoiseModel::independent(std).with_lasting_errors(two_errors()),
      Eigen::Vector3d(0.1, 0.1, 0.1));
  likelihood::StepForm sum = likelihood::StepForm::zero(d);
  Eigen::MatrixXd information = Eigen::MatrixXd::Identity(d + q, d + q);  // of the priors N(0, I)
  Eigen::VectorXd right = Eigen::VectorXd::Zero(d + q);
  for (Eigen::Index t = 0; t < k_steps; ++t) {
    likelihood::StepForm form;
    projector.project(t, t, data.col(t), form);
    sum.add(form);
    Eigen::MatrixXd rows(k_dofs, d + q);
    rows << model->space * model->core[t], factors[t];
    const Eigen::MatrixXd weighted = std.cwiseAbs2().cwiseInverse().asDiagonal() * rows;
    information += weighted.transpose() * rows;
    right += weighted.transpose() * (data.col(t) - model->lift.col(t));
  }
  const Eigen::MatrixXd covariance = information.inverse();
  const Eigen::VectorXd mean = covariance * right;
  const Eigen::MatrixXd of_p = covariance.topLeftCorner(d, d);
  const Eigen::MatrixX2d found = projector.lasting_errors().moments(
      mean.head(d) - projector.central_functions(), Eigen::LLT<Eigen::MatrixXd>(of_p).matrixL());
  for (Eigen::Index k = 0; k < q; ++k) {
    EXPECT_NEAR(found(k, 0), mean[d + k], 1e-9);
    EXPECT_NEAR(found(k, 1), std::sqrt(covariance(d + k, d + k)), 1e-9);
  }
}

TEST(ScaleError, RegionsCoverOnlyIfItIsRemembered) {
  const auto model = likelihood::test::random_model(std::make_shared<likelihood::test::CurvedFunctions>(),
                                                    k_dofs, 4, k_steps, 3);
  const Eigen::Vector2d centre(1, 1), truth(1.004, 0.998);
  const double scale_std = 0.05;
  const likelihood::NoiseModel plain = likelihood::NoiseModel::correlated(chain(3e3));
  const Eigen::MatrixXd root =  // of R: L⁻ᵀ with L Lᵀ = R⁻¹
      Eigen::LLT<Eigen::MatrixXd>(Eigen::MatrixXd(plain.measurement().precision()))
          .matrixU()
          .solve(Eigen::MatrixXd::Identity(k_dofs, k_dofs));
  model::FunctionBatch batch;
  batch.resize(1, 2, 3, 0);
  model->functions->evaluate(truth.transpose(), 0, batch);
  const Eigen::VectorXd functions = batch.value.row(0);
  std::mt19937_64 random(5);
  std::normal_distribution<double> normal;
  constexpr int k_tests = 400;
  constexpr double k_quantile = 7.814727903251178;  // of χ² with 3 degrees of freedom, 95 %
  int covered = 0, forgotten = 0;
  for (int test = 0; test < k_tests; ++test) {
    const double factor = 1 + scale_std * normal(random);
    Eigen::MatrixXd data(k_dofs, k_steps);
    for (Eigen::Index t = 0; t < k_steps; ++t) {
      Eigen::VectorXd z(k_dofs);
      for (double& value : z) value = normal(random);
      data.col(t) = factor * model->predict(truth, static_cast<std::size_t>(t)) + root * z;
    }
    for (const double std : {scale_std, 0.0}) {
      likelihood::DatumProjector projector(model, plain.with_scale_error(std), centre);
      likelihood::StepForm sum = likelihood::StepForm::zero(3), form;
      for (std::size_t t = 0; t < k_steps; ++t) {
        projector.project(t, t, data.col(static_cast<Eigen::Index>(t)), form);
        sum.add(form);
      }
      const Eigen::VectorXd error = Eigen::LLT<Eigen::MatrixXd>(sum.quadratic).solve(sum.linear) -
                                    (functions - projector.central_functions());
      (std > 0 ? covered : forgotten) += error.dot(sum.quadratic * error) < k_quantile ? 1 : 0;
    }
  }
  RecordProperty("covered", covered);
  RecordProperty("forgotten", forgotten);
  EXPECT_NEAR(covered, 0.95 * k_tests, 3 * std::sqrt(0.95 * 0.05 * k_tests));
  EXPECT_LT(forgotten, 0.7 * k_tests);
}

TEST(ScaleError, DoesNotGoWithACorrection) {
  const auto model = likelihood::test::random_model(std::make_shared<likelihood::test::CurvedFunctions>(),
                                                    k_dofs, 4, k_steps, 3);
  const likelihood::NoiseModel sensors =
      likelihood::NoiseModel::independent(Eigen::VectorXd::Constant(k_dofs, 0.1));
  UpdateOptions corrected;
  corrected.bias_correction = likelihood::BiasCorrectionMode::on;
  try {
    SequentialUpdate(model, sensors.with_scale_error(0.1),
                     {posterior::Prior::uniform(0, 2), posterior::Prior::uniform(0, 2)}, corrected);
    FAIL() << "a correction of data whose scale is unknown was taken";
  } catch (const UsageError& error) {
    EXPECT_STREQ(
        error.what(),
        "bias_correction cannot be combined with noise_level = \"unknown\", a scale that is not known "
        "exactly (relative_scale_std, dic.scale_std) or an error that a series shares (shared_std): "
        "the data cannot tell a bias from these; leave out one of them");
  }
}

TEST(SharedErrorAndTime, AStepTakenOutLeavesNoTrace) {
  const auto model = likelihood::test::random_model(std::make_shared<likelihood::test::CurvedFunctions>(),
                                                    k_dofs, 4, k_steps, 3);
  Eigen::MatrixXd data = likelihood::test::synthetic_data(*model, Eigen::Vector2d(1.1, 0.8),
                                                          Eigen::VectorXd::Constant(k_dofs, 0.3), 8);
  data(2, 3) = k_nan;
  const likelihood::NoiseModel noise = likelihood::NoiseModel::correlated(chain(4)).with_shared_reference(1);
  const std::vector<posterior::Prior> priors = {posterior::Prior::uniform(0, 2),
                                                posterior::Prior::uniform(0, 2)};
  SequentialUpdate all(model, noise, priors), without(model, noise, priors), late(model, noise, priors);
  for (const std::size_t t : {0, 1, 2, 3, 4}) {
    all.update(t, t, data.col(static_cast<Eigen::Index>(t)));
    if (t != 1) without.update(t, t, data.col(static_cast<Eigen::Index>(t)));
  }
  const Eigen::VectorXd mean = all.result().mean;
  const double log_evidence = all.result().log_evidence;
  for (const std::size_t t : {4, 1, 0, 3, 2}) late.update(t, t, data.col(static_cast<Eigen::Index>(t)));
  EXPECT_EQ(late.result().mean, mean);
  EXPECT_EQ(late.result().log_evidence, log_evidence);
  all.remove(1);
  EXPECT_EQ(all.result().mean, without.result().mean);
  EXPECT_EQ(all.result().log_evidence, without.result().log_evidence);
  EXPECT_EQ(all.result().weights, without.result().weights);
}

TEST(SharedErrorAndTime, ARefusedDatumLeavesNoTrace) {
  const auto model = likelihood::test::random_model(std::make_shared<likelihood::test::CurvedFunctions>(),
                                                    k_dofs, 4, k_steps, 3);
  const likelihood::NoiseModel noise = likelihood::NoiseModel::correlated(chain(4)).with_shared_reference(1);
  likelihood::DatumProjector projector(model, noise, Eigen::Vector2d(1, 1)),
      other(model, noise, Eigen::Vector2d(1, 1));
  likelihood::StepForm a, b;
  const Eigen::VectorXd good = Eigen::VectorXd::Constant(k_dofs, 0.2);
  Eigen::VectorXd bad = good;
  bad[3] = 1e200;
  projector.project(0, 0, good, a);
  EXPECT_THROW(projector.project(1, 1, bad, a), DataError);
  projector.project(1, 1, good, a);
  other.project(0, 0, good, b);
  other.project(1, 1, good, b);
  EXPECT_EQ(a.quadratic, b.quadratic);
  EXPECT_EQ(a.linear, b.linear);
  EXPECT_EQ(a.constant, b.constant);
}

}  // namespace
}  // namespace knothe::assimilation
