// Judged by the textbook's formulas (Gelman et al., Bayesian Data Analysis, 3rd ed., 5.4) on dense grids, and
// by a Gibbs sampler.
#include "knothe/assimilation/population/population.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <cmath>
#include <functional>
#include <random>

#include "knothe/assimilation/population/population_density.hpp"
#include "knothe/base/error.hpp"
#include "knothe/posterior/prior/prior_values.hpp"

namespace knothe::assimilation {
namespace {

using Eigen::Index;
using posterior::Prior;

/// Rubin 1981: effects of coaching in eight schools, and their standard errors.
const std::vector<double> k_effects = {28, 8, -3, 7, -1, 1, 18, 12};
const std::vector<double> k_errors = {15, 10, 16, 11, 9, 11, 10, 18};

double log_normal(double x, double mean, double variance) {
  return -0.5 * ((x - mean) * (x - mean) / variance + std::log(2 * M_PI * variance));
}

/// The parameter of one specimen, observed with an error, under a normal prior.
Specimen observed(double y, double error, double prior_mean, double prior_std,
                  const SharedParameter& shared) {
  const double precision = 1 / (error * error) + 1 / (prior_std * prior_std);
  const double mean = (y / (error * error) + prior_mean / (prior_std * prior_std)) / precision;
  const auto one = [](double value) { return Eigen::VectorXd::Constant(1, value); };
  const double variance = 1 / precision / (shared.std * shared.std);
  return {
      "",
      SpecimenLikelihood(one((mean - shared.mean) / shared.std), Eigen::MatrixXd::Constant(1, 1, variance),
                         {one((prior_mean - shared.mean) / shared.std), one(prior_std / shared.std)}),
      one(mean), one(1 / std::sqrt(precision)), one(prior_std)};
}

/// By the trapezoidal rule over mean and spread, of normal and half-normal prior.
struct Quadrature {
  double mean = 0, mean_std = 0, spread = 0, spread_std = 0, log_evidence = 0;
  std::vector<double> effect, effect_std;

  Quadrature(const std::vector<double>& y, const std::vector<double>& error, double prior_mean,
             double prior_std, double scale)
      : effect(y.size()), effect_std(y.size()) {
    constexpr Index k_nodes = 601;
    double sum = 0;
    for (std::size_t k = 0; k < y.size(); ++k)
      log_offset += log_normal(y[k], prior_mean, error[k] * error[k] + 9);
    for (Index i = 0; i < k_nodes; ++i)
      for (Index j = 0; j < k_nodes; ++j) {
        const double mu = prior_mean + prior_std * (12.0 * i / (k_nodes - 1) - 6);
        const double tau = scale * 7.0 * j / (k_nodes - 1);
        double log_density = log_normal(mu, prior_mean, prior_std * prior_std) +
                             log_normal(tau, 0, scale * scale) + std::log(2);
        for (std::size_t k = 0; k < y.size(); ++k)
          log_density += log_normal(y[k], mu, error[k] * error[k] + tau * tau);
        const double weight = std::exp(log_density - log_offset) * (j == 0 ? 0.5 : 1);
        add(weight, mu, tau, y, error);
        sum += weight;
      }
    log_evidence =
        log_offset + std::log(sum * prior_std * 12.0 / (k_nodes - 1) * scale * 7.0 / (k_nodes - 1));
    for (double* first : {&mean, &spread}) {
      double& second = first == &mean ? mean_std : spread_std;
      *first /= sum;
      second = std::sqrt(second / sum - *first * *first);
    }
    for (std::size_t k = 0; k < y.size(); ++k) {
      effect[k] /= sum;
      effect_std[k] = std::sqrt(effect_std[k] / sum - effect[k] * effect[k]);
    }
  }

 private:
  double log_offset = 0;
  void add(double weight, double mu, double tau, const std::vector<double>& y,
           const std::vector<double>& error) {
    mean += weight * mu, mean_std += weight * mu * mu;
    spread += weight * tau, spread_std += weight * tau * tau;
    for (std::size_t k = 0; k < y.size(); ++k) {
      const double s = error[k] * error[k], t = tau * tau, m = (y[k] * t + mu * s) / (s + t);
      effect[k] += weight * m, effect_std[k] += weight * (m * m + s * t / (s + t));
    }
  }
};

TEST(Population, GaussianSpecimensAreTheTextbooks) {
  std::vector<double> y, error;
  for (int k = 0; k < 60; ++k) y.push_back(4 + 3 * std::sin(1.7 * k)), error.push_back(0.5 + k % 4);
  const SharedParameter shared{"effect", Coordinate::own, 5, 8};
  std::vector<Specimen> specimens;
  double own_evidence = 0;
  for (std::size_t k = 0; k < y.size(); ++k) {
    specimens.push_back(observed(y[k], error[k], 5, 8, shared));
    own_evidence += log_normal(y[k], 5, error[k] * error[k] + 64);
  }
  const PopulationResult found = solve_population(specimens, std::span(&shared, 1));
  const Quadrature exact(y, error, 5, 8, 8);
  EXPECT_TRUE(found.population.trusted);
  EXPECT_NEAR(found.population.mean[0], exact.mean, 1e-6 * exact.mean_std);
  EXPECT_NEAR(std::sqrt(found.population.covariance(0, 0)), exact.mean_std, 1e-6 * exact.mean_std);
  EXPECT_NEAR(found.population.mean[1], exact.spread, 1e-6 * exact.spread_std);
  EXPECT_NEAR(std::sqrt(found.population.covariance(1, 1)), exact.spread_std, 1e-6 * exact.spread_std);
  EXPECT_NEAR(found.log_bayes_factor, exact.log_evidence - own_evidence, 1e-6);
  EXPECT_NEAR(found.predictive_mean[0], exact.mean, 1e-6 * exact.mean_std);
  EXPECT_NEAR(
      found.predictive_covariance(0, 0),
      exact.mean_std * exact.mean_std + exact.spread * exact.spread + exact.spread_std * exact.spread_std,
      1e-5);
  for (std::size_t k = 0; k < y.size(); ++k) {
    EXPECT_NEAR(found.specimens[k].updated_mean[0], exact.effect[k], 1e-6 * exact.effect_std[k]);
    EXPECT_NEAR(found.specimens[k].updated_std[0], exact.effect_std[k], 1e-6 * exact.effect_std[k]);
    EXPECT_TRUE(found.specimens[k].belongs);
  }
}

/// Draws of a posterior, with the values of their priors.
NamedPosterior named(const std::string& name, std::vector<std::string> parameters,
                     const std::vector<Prior>& priors, const Eigen::MatrixXd& points) {
  NamedPosterior result{name, {std::move(parameters), points, {}, {}}};
  result.posterior.weights = Eigen::VectorXd::Constant(points.rows(), 1.0 / points.rows());
  result.posterior.prior = posterior::prior_values(priors, points);
  return result;
}

Eigen::MatrixXd normal_draws(const Eigen::VectorXd& mean, const Eigen::MatrixXd& covariance, Index n,
                             std::mt19937& random) {
  std::normal_distribution<double> normal;
  const Eigen::MatrixXd lower = covariance.llt().matrixL();
  Eigen::MatrixXd draws(n, mean.size());
  for (Index i = 0; i < n; ++i)
    draws.row(i) = (mean +
                    lower * Eigen::VectorXd::NullaryExpr(mean.size(), [&] {
                      return normal(random);
                    })).transpose();
  return draws;
}

std::vector<Specimen> specimens_of(const std::vector<NamedPosterior>& posteriors,
                                   const std::vector<SharedParameter>& shared) {
  std::vector<Specimen> specimens;
  for (const NamedPosterior& posterior : posteriors) specimens.push_back(specimen_of(posterior, shared));
  return specimens;
}

TEST(Population, EightSchoolsFromDrawsOfPosteriorsUnderDifferentPriors) {
  std::mt19937 random(1);
  std::vector<NamedPosterior> posteriors;
  for (std::size_t k = 0; k < k_effects.size(); ++k) {
    const double error = k_errors[k], y = k_effects[k], width = k % 2 == 0 ? 20 : 15;
    const double variance = 1 / (1 / (error * error) + 1 / (width * width));
    const double mean = variance * (y / (error * error) + 5 / (width * width));
    posteriors.push_back(named(std::to_string(k), {"effect"}, {Prior::normal(5, width)},
                               normal_draws(Eigen::VectorXd::Constant(1, mean),
                                            Eigen::MatrixXd::Constant(1, 1, variance), 20'000, random)));
  }
  const std::vector<SharedParameter> shared = shared_parameters(posteriors);
  const PopulationResult found = solve_population(specimens_of(posteriors, shared), shared);
  const Quadrature exact(k_effects, k_errors, 5, 20, 20);
  EXPECT_NEAR(found.population.mean[0], exact.mean, 0.1 * exact.mean_std);
  EXPECT_NEAR(found.population.mean[1], exact.spread, 0.1 * exact.spread_std);
  for (std::size_t k = 0; k < k_effects.size(); ++k) {
    EXPECT_NEAR(found.specimens[k].updated_mean[0], exact.effect[k], 0.1 * exact.effect_std[k]);
    EXPECT_NEAR(found.specimens[k].updated_std[0] / exact.effect_std[k], 1, 0.1);
  }
}

TEST(Population, TheDensityOfTwoParametersIsThatOfTheirSumsOfVariances) {
  const Eigen::Matrix2d error = Eigen::Matrix2d{{0.3, 0.1}, {0.1, 0.2}};
  const Eigen::Vector2d y(0.4, -0.3), prior_std(1.0, 0.8), prior_mean(0.1, 0.0);
  const Eigen::Matrix2d of_prior = prior_std.cwiseAbs2().asDiagonal();
  const Eigen::Matrix2d covariance = (error.inverse() + of_prior.inverse()).inverse();
  const Eigen::Vector2d mean = covariance * (error.inverse() * y + of_prior.inverse() * prior_mean);
  const SpecimenLikelihood likelihood(mean, covariance, {prior_mean, prior_std});
  const auto log_density = [](const Eigen::Vector2d& x, const Eigen::Vector2d& m, const Eigen::Matrix2d& c) {
    return -0.5 * ((x - m).dot(c.inverse() * (x - m)) + std::log(c.determinant())) - std::log(2 * M_PI);
  };
  PopulationDensity density(
      {&likelihood, &likelihood},
      {Prior::normal(0, 1), Prior::normal(0, 1), Prior::normal(0, 1).truncated(0, 1e300, ""),
       Prior::normal(0, 1).truncated(0, 1e300, ""), Prior::normal(0, 0.55)});
  const Eigen::MatrixXd z{{0.2, -0.4, 0.3, -0.6, 0.9}, {-1.2, 0.5, -3, 1.0, -1.5}};
  posterior::LogDensityBatch batch;
  batch.resize(2, 5, 0);
  density.evaluate(z, 0, batch);
  const Eigen::MatrixXd p = density.parameters(z);
  for (Index i = 0; i < 2; ++i) {
    EXPECT_NEAR(p(i, 4), std::tanh(0.55 * z(i, 4)), 1e-12);
    const double off = p(i, 2) * p(i, 3) * p(i, 4);
    const Eigen::Matrix2d spread{{p(i, 2) * p(i, 2), off}, {off, p(i, 3) * p(i, 3)}};
    const double evidence = log_density(y, prior_mean, error + of_prior);
    const double of_one = log_density(y, p.row(i).head(2).transpose(), error + spread) - evidence;
    const double of_z = -0.5 * (z.row(i).squaredNorm() + 5 * std::log(2 * M_PI));
    EXPECT_NEAR(batch.value[i], of_z + 2 * of_one, 1e-9);
    const PopulationNormal population = population_of(p.row(i).transpose(), 2);
    const Eigen::Vector2d from = y - Eigen::Vector2d(p.row(i).head(2).transpose());
    EXPECT_NEAR(likelihood.squared_distance(population), from.dot((error + spread).inverse() * from), 1e-9);
  }
}

TEST(Population, ALikelihoodThatSaysNothingHasIntegralOne) {
  const SpecimenLikelihood nothing(Eigen::Vector2d(0.5, 0), Eigen::Matrix2d{{1.0, 0}, {0, 4.0}},
                                   {Eigen::Vector2d(0.5, 0), Eigen::Vector2d(1, 2)});
  const PopulationNormal population = population_of(Eigen::VectorXd{{3.0, -2, 1.5, 0.5, 0.3}}, 2);
  EXPECT_NEAR(nothing.log_integral(population), 0, 1e-12);
  EXPECT_NEAR(nothing.squared_distance(population), 0, 1e-12);
  // A part that is wider than the prior is taken as wide as that.
  const SpecimenLikelihood wider(Eigen::Vector2d(0.5, 0), Eigen::Matrix2d{{1.1, 0}, {0, 4.0}},
                                 {Eigen::Vector2d(0.5, 0), Eigen::Vector2d(1, 2)});
  EXPECT_NEAR(wider.log_integral(population), 0, 1e-12);
}

/// Twelve specimens of two parameters, one lognormal; `strange`: how far the last one is from the others.
std::vector<NamedPosterior> two_parameters(double strange, std::vector<Eigen::Vector2d>& observations,
                                           Eigen::Matrix2d& error) {
  std::mt19937 random(7);
  const Eigen::Vector2d mean(2.0, 0.5);
  const Eigen::Matrix2d spread{{0.09, 0.021}, {0.021, 0.01}};
  error = Eigen::Matrix2d{{0.04, -0.005}, {-0.005, 0.0025}};
  const Eigen::Vector2d prior_mean(1.5, 0.4), prior_std(1.0, 0.5);
  const Eigen::Matrix2d of_prior = prior_std.cwiseAbs2().asDiagonal();
  std::vector<NamedPosterior> posteriors;
  for (int k = 0; k < 12; ++k) {
    const Eigen::Vector2d truth = normal_draws(mean, spread, 1, random).row(0).transpose();
    Eigen::Vector2d y = normal_draws(truth, error, 1, random).row(0).transpose();
    if (k == 11) y[0] += strange;
    observations.push_back(y);
    const Eigen::Matrix2d covariance = (error.inverse() + of_prior.inverse()).inverse();
    Eigen::MatrixXd draws = normal_draws(covariance * (error.inverse() * y + of_prior.inverse() * prior_mean),
                                         covariance, 10'000, random);
    draws.col(1) = draws.col(1).array().exp();
    posteriors.push_back(named("S" + std::to_string(k), {"a", "b"},
                               {Prior::normal(1.5, 1), Prior::lognormal(0.4, 0.5)}, draws));
  }
  return posteriors;
}

/// Gibbs: μ and each x exactly, spreads and correlation by random steps.
struct Gibbs {
  Eigen::VectorXd mean = Eigen::VectorXd::Zero(5), std;

  Gibbs(const std::vector<Eigen::Vector2d>& y, const Eigen::Matrix2d& error, Index sweeps) {
    Eigen::Vector2d mu(1.5, 0.4);
    std::vector<Eigen::Vector2d> x = y;
    Eigen::VectorXd square = Eigen::VectorXd::Zero(5);
    const Eigen::Matrix2d of_mean{{1, 0}, {0, 4}};
    for (Index sweep = -1000; sweep < sweeps; ++sweep) {
      const Eigen::Matrix2d inverse = covariance(state).inverse();
      Eigen::Vector2d sum = of_mean * Eigen::Vector2d(1.5, 0.4);
      for (std::size_t k = 0; k < y.size(); ++k) {
        x[k] = draw(error.inverse() + inverse, error.inverse() * y[k] + inverse * mu);
        sum += inverse * x[k];
      }
      mu = draw(of_mean + y.size() * inverse, sum);
      for (int step = 0; step < 10; ++step) move(x, mu);
      if (sweep < 0) continue;
      Eigen::VectorXd p(5);
      p << mu, state[0], state[1], std::tanh(state[2]);
      mean += p / sweeps, square += p.cwiseAbs2() / sweeps;
    }
    std = (square - mean.cwiseAbs2()).cwiseSqrt();
  }

 private:
  static Eigen::Matrix2d covariance(const Eigen::Vector3d& s) {
    const double off = s[0] * s[1] * std::tanh(s[2]);
    return Eigen::Matrix2d{{s[0] * s[0], off}, {off, s[1] * s[1]}};
  }
  Eigen::Vector2d draw(const Eigen::Matrix2d& precision, const Eigen::Vector2d& pull) {
    const Eigen::Matrix2d inverse = precision.inverse();
    return normal_draws(inverse * pull, inverse, 1, random_).row(0).transpose();
  }
  static double log_density(const Eigen::Vector3d& s, const std::vector<Eigen::Vector2d>& x,
                            const Eigen::Vector2d& mu) {
    if (s[0] <= 0 || s[1] <= 0) return -INFINITY;
    const Eigen::Matrix2d c = covariance(s), inverse = c.inverse();
    double sum = log_normal(s[0], 0, 1) + log_normal(s[1], 0, 0.25) + log_normal(s[2], 0, 0.55 * 0.55);
    for (const Eigen::Vector2d& one : x)
      sum -= 0.5 * ((one - mu).dot(inverse * (one - mu)) + std::log(c.determinant()));
    return sum;
  }
  void move(const std::vector<Eigen::Vector2d>& x, const Eigen::Vector2d& mu) {
    std::normal_distribution<double> normal;
    std::uniform_real_distribution<double> uniform;
    const Eigen::Vector3d next =
        state + Eigen::Vector3d(0.06 * normal(random_), 0.03 * normal(random_), 0.3 * normal(random_));
    if (std::log(uniform(random_)) < log_density(next, x, mu) - log_density(state, x, mu)) state = next;
  }

  Eigen::Vector3d state{0.3, 0.1, 0.3};
  std::mt19937 random_{3};
};

TEST(Population, TwoParametersAreThoseOfALongGibbsRun) {
  std::vector<Eigen::Vector2d> y;
  Eigen::Matrix2d error;
  const std::vector<NamedPosterior> posteriors = two_parameters(0, y, error);
  const std::vector<SharedParameter> shared = shared_parameters(posteriors);
  ASSERT_EQ(shared[1].coordinate, Coordinate::logarithm);
  const PopulationResult found = solve_population(specimens_of(posteriors, shared), shared);
  const Gibbs exact(y, error, 20'000);
  EXPECT_TRUE(found.population.trusted) << found.verdict;
  for (Index k = 0; k < 5; ++k) {
    EXPECT_NEAR(found.population.mean[k], exact.mean[k], 0.1 * exact.std[k]) << k;
    EXPECT_NEAR(std::sqrt(found.population.covariance(k, k)) / exact.std[k], 1, 0.1) << k;
  }
  for (const SpecimenInPopulation& specimen : found.specimens) EXPECT_TRUE(specimen.belongs) << specimen.name;
  EXPECT_GT(found.log_bayes_factor, 3);
}

TEST(Population, ASpecimenOfAnotherBatchIsNamed) {
  std::vector<Eigen::Vector2d> y;
  Eigen::Matrix2d error;
  const std::vector<NamedPosterior> posteriors = two_parameters(3, y, error);
  const std::vector<SharedParameter> shared = shared_parameters(posteriors);
  const PopulationResult found = solve_population(specimens_of(posteriors, shared), shared);
  for (const SpecimenInPopulation& specimen : found.specimens)
    EXPECT_EQ(specimen.belongs, specimen.name != "S11") << specimen.name << " " << specimen.probability;
}

TEST(Population, AUniformPriorAndOneOfAnEarlierKindAreDividedOut) {
  std::mt19937 random(2);
  const Eigen::MatrixXd draws =
      normal_draws(Eigen::VectorXd::Constant(1, 0.4), Eigen::MatrixXd::Constant(1, 1, 0.01), 20'000, random);
  const std::vector<NamedPosterior> posteriors = {named("A", {"a"}, {Prior::uniform(-3, 4)}, draws),
                                                  named("B", {"a"}, {Prior::normal(0, 2)}, draws)};
  const std::vector<SharedParameter> shared = shared_parameters(posteriors);
  const Specimen specimen = specimen_of(posteriors[0], shared);
  // ∫ L N(μ, τ²) with L = 7 N(x; 0.4, 0.01), in the coordinates of the specimens.
  const double mu = 0.2, tau = 0.3;
  const PopulationNormal population{SmallVector::Constant(1, (mu - shared[0].mean) / shared[0].std),
                                    SmallMatrix::Constant(1, 1, tau / shared[0].std)};
  EXPECT_NEAR(specimen.likelihood.log_integral(population),
              std::log(7) + log_normal(0.4, mu, 0.01 + tau * tau), 0.01);
}

std::string message_of(const std::function<void()>& function) {
  try {
    function();
  } catch (const Error& error) {
    return error.what();
  }
  return "no error";
}

TEST(Population, WhatIsWrongIsTold) {
  std::mt19937 random(2);
  const Eigen::MatrixXd draws =
      normal_draws(Eigen::VectorXd::Constant(1, 0.4), Eigen::MatrixXd::Constant(1, 1, 1), 2'000, random);
  const NamedPosterior a = named("A", {"a"}, {Prior::normal(0, 2)}, draws);
  const NamedPosterior b = named("B", {"b"}, {Prior::normal(0, 2)}, draws);
  const NamedPosterior c = named("C", {"a"}, {Prior::lognormal(0, 2)}, draws.array().exp());
  const auto share = [](std::vector<NamedPosterior> posteriors) {
    return message_of([&] { (void)shared_parameters(posteriors); });
  };
  EXPECT_EQ(share({a}), "a population needs the results of at least two specimens, not 1");
  EXPECT_EQ(share({a, b}), "A and the others have no parameter in common");
  EXPECT_NE(share({a, c}).find("A: a is lognormal in another specimen, and here has the value -"),
            std::string::npos);
  const std::vector<NamedPosterior> two = {a, a};
  const std::vector<SharedParameter> shared = shared_parameters(two);
  const auto solve = [&](const PopulationPriors& priors) {
    return message_of([&] { (void)solve_population(specimens_of(two, shared), shared, {.priors = priors}); });
  };
  EXPECT_EQ(solve({{}, {{"aa", 1.0}}}),
            "a prior is stated for \"aa\", but the specimens share a (did you mean \"a\"?)");
  EXPECT_EQ(solve({{{"a", {0, 0}}}, {}}), "the prior stated for \"a\" needs a positive number, not 0");
  // The posterior of an earlier test as a prior, much narrower than what it is exchanged for.
  NamedPosterior narrow = a;
  narrow.posterior.prior->log_dependence = -50 * draws.col(0).array().square();
  EXPECT_EQ(
      message_of([&] { (void)specimen_of(narrow, shared); }),
      "A: its prior cannot be divided out: hardly any point of its posterior would keep a weight. Repeat "
      "its inference with a wider prior");
  const Prior prior = Prior::normal(0, 2);
  NamedPosterior further = named("D", {"a", "e"}, {prior, prior}, draws.replicate(1, 2));
  further.posterior.prior->log_dependence = Eigen::VectorXd::Zero(draws.rows());
  EXPECT_EQ(
      message_of([&] { (void)specimen_of(further, shared); }),
      "D: its prior is the posterior of an earlier test, of more parameters than the specimens share: give "
      "results whose priors are independent");
}

}  // namespace
}  // namespace knothe::assimilation
