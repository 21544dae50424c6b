// Is the verdict ever green while the answer is wrong? docs/explanation/verdict.md has the counts of the full
// form.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <string>

#include "knothe/base/testing/long_form.hpp"
#include "knothe/numerics/linear/symmetric_eigen.hpp"
#include "knothe/project/update_setup.hpp"
#include "tests/verdicts/wrong_situations.hpp"

namespace knothe::verdicts {
namespace {

using assimilation::RunVerdict;
using assimilation::Verdict;
using assimilation::VerdictLevel;
using Eigen::Index;
using Eigen::VectorXd;

int count_of(const char* variable, int otherwise) {
  const char* text = std::getenv(variable);
  return text == nullptr ? otherwise : std::atoi(text);
}

struct Answer {
  double verdict_us = 0;  // of the last step
  Verdict verdict;
  VectorXd mean, std;
};

/// What is known of the reduced model's error off its grid, added to the noise: `truncation_error = "on"`
/// without the part of the grid's own points.
likelihood::NoiseModel with_model_error(const likelihood::NoiseModel& noise,
                                        const model::ObservedErrors& errors,
                                        const std::vector<std::size_t>& time_indices) {
  const Index k = errors.count(), n = errors.space.rows();
  std::vector<Eigen::MatrixXd> of_solutions(static_cast<std::size_t>(k), Eigen::MatrixXd(n, k_steps));
  for (std::size_t t = 0; t < k_steps; ++t)
    for (Index j = 0; j < k; ++j)
      of_solutions[static_cast<std::size_t>(j)].col(static_cast<Index>(t)) =
          errors.space * errors.coefficients[t].col(j);
  model::TruncationError known;
  model::set_moments(of_solutions,
                     std::vector<double>(static_cast<std::size_t>(k), 1.0 / static_cast<double>(k)), known);
  const double distance = static_cast<double>(time_indices.back() - time_indices.front()) /
                          static_cast<double>(time_indices.size() - 1);
  model::ObservedTruncation added{{}, Eigen::MatrixXd::Zero(n, std::ssize(time_indices))};
  for (const std::size_t t : time_indices) {
    const numerics::SymmetricEigen moments(
        std::max(1.0, known.persistence / distance) *
        Eigen::Map<const Eigen::MatrixXd>(known.covariance.data() + t * static_cast<std::size_t>(n * n), n,
                                          n));
    added.factors.emplace_back(moments.eigenvectors() *
                               moments.eigenvalues().cwiseMax(0).cwiseSqrt().asDiagonal());
  }
  return project::with_truncation(noise, added);
}

assimilation::EngineSetup setup_of(const BeamBench& bench, const Case& c) {
  assimilation::EngineSetup setup;
  setup.model = c.force ? c.model->with_force : c.model->displacements;
  setup.sensors = bench.sensors();
  VectorXd std = VectorXd::Constant(c.values.rows(), c.noise);
  if (c.force) {
    setup.sensors.scalars = {"reaction_force"};
    std[std.size() - 1] = k_force_noise;
  }
  setup.noise = likelihood::NoiseModel::independent(std);
  setup.priors = c.priors.empty() ? priors() : c.priors;
  setup.robust.degrees_of_freedom = c.degrees_of_freedom;
  setup.watches_sensors = true;
  setup.known_errors = c.model->errors;
  if (c.force) {
    Eigen::MatrixXd& space = setup.known_errors.space;
    space.conservativeResize(space.rows() + 1, Eigen::NoChange);
    space.bottomRows(1).setZero();
  }
  if (count_of("KNOTHE_VERDICT_MODEL_ERROR", 0) != 0) {
    setup.noise = with_model_error(setup.noise, setup.known_errors, c.time_indices);
    setup.watches_sensors = false;  // as with every noise that is not independent
  }
  return setup;
}

Answer answer_of(const BeamBench& bench, const Case& c) {
  assimilation::Engine engine(setup_of(bench, c));
  RunVerdict run;
  assimilation::StepResult last;
  for (Index t = 0; t < c.values.cols(); ++t) {
    likelihood::Datum datum;
    datum.step = static_cast<std::size_t>(t);
    datum.time_index = c.time_indices[static_cast<std::size_t>(t)];
    datum.values = c.values.col(t);
    last = engine.assimilate(datum);
    run.add(last.update.verdict);
  }
  return {last.update.elapsed_us.verdict, run.verdict(), last.update.mean, last.update.standard_deviations()};
}

/// The largest distance of a mean from what it should be, in the answer's standard deviations: from the
/// truth, or from the posterior by a model of the structure that made the data. The limits are 3 and 1.
double distance(BeamBench& bench, const Case& c, const Answer& answer, const Eigen::Vector2d& truth) {
  if (c.structure == nullptr)
    return ((answer.mean - truth).cwiseQuotient(answer.std)).cwiseAbs().maxCoeff() / 3;
  Case right = c;
  right.model = &bench.reduced(*c.structure, 9, 50);
  const Answer judge = answer_of(bench, right);
  return ((answer.mean - judge.mean).cwiseQuotient(answer.std)).cwiseAbs().maxCoeff();
}

std::string first_reason(const Verdict& verdict) {
  if (verdict.reasons.empty()) return "–";
  const auto& r = verdict.reasons.front();
  return fmt::format("{} {:.2g}{}: {}", to_text(r.part), r.value, r.cause ? " " + to_text(*r.cause) : "",
                     r.message);
}

/// One for both tests: its models take full-order runs.
BeamBench& shared_bench() {
  static BeamBench bench;
  return bench;
}

TEST(Verdicts, OfWrongSituations) {
  const int truths = count_of("KNOTHE_VERDICT_TRUTHS", 1);
  BeamBench& bench = shared_bench();
  int runs = 0, false_green = 0, with_cause = 0;
  std::vector<std::string> badly_named;
  std::vector<Situation> situations = wrong_situations();
  if (!knothe::test::long_form()) {  // each third: some of what is named, some of what is not
    std::vector<Situation> some;
    for (std::size_t i = 0; i < situations.size(); i += 3) some.push_back(situations[i]);
    situations = some;
  }
  for (const Situation& situation : situations) {
    int ok = 0, caution = 0, reject = 0, named = 0, green = 0;
    std::string example;
    for (int k = 0; k < truths; ++k) {
      std::mt19937_64 random(1000 + static_cast<unsigned>(k));
      Eigen::Vector2d truth = draw_truth(random);
      const Case c = situation.make(bench, truth, random);
      if (situation.name == "truth outside the box") truth = outside_the_box(truth);
      const Answer answer = answer_of(bench, c);
      const VerdictLevel level = answer.verdict.level;
      ok += level == VerdictLevel::ok ? 1 : 0;
      caution += level == VerdictLevel::caution ? 1 : 0;
      reject += level == VerdictLevel::reject ? 1 : 0;
      // How wrong a caution or a rejected answer is does not matter: the judge's models cost time.
      const double off = level == VerdictLevel::ok ? distance(bench, c, answer, truth) : 0;
      if (off > 1) ++green;
      named += std::any_of(answer.verdict.reasons.begin(), answer.verdict.reasons.end(),
                           [&](const auto& r) { return r.cause && r.cause == situation.cause; })
                   ? 1
                   : 0;
      if (k == 0 || off > 1)
        example =
            fmt::format("truth {:.3f} {:.3f}, mean {:.3f} {:.3f} ± {:.3f} {:.3f}, {:.2f} of the limit; {}",
                        truth[0], truth[1], answer.mean[0], answer.mean[1], answer.std[0], answer.std[1], off,
                        first_reason(answer.verdict));
    }
    runs += truths;
    false_green += green;
    fmt::print("{:32} ok {:2} caution {:2} reject {:2} | false green {:2} | named {}\n    {}\n",
               situation.name, ok, caution, reject, green, situation.cause ? fmt::format("{:2}", named) : "–",
               example);
    if (!situation.cause) continue;
    ++with_cause;
    if (2 * named <= truths) badly_named.push_back(situation.name);
  }
  fmt::print("false green: {} of {}; cause named in {} of {} kinds\n", false_green, runs,
             with_cause - static_cast<int>(badly_named.size()), with_cause);
  EXPECT_LE(false_green, std::max(1, runs / 100));
  EXPECT_LE(5 * badly_named.size(), static_cast<std::size_t>(with_cause))
      << fmt::format("{}", fmt::join(badly_named, ", "));
}

TEST(Verdicts, OfRightSituations) {
  const int truths = count_of("KNOTHE_VERDICT_RIGHT", knothe::test::by_form(4, 20));
  BeamBench& bench = shared_bench();
  int not_ok = 0;
  double us = 0;
  for (int k = 0; k < truths; ++k) {
    std::mt19937_64 random(5000 + static_cast<unsigned>(k));
    const Eigen::Vector2d truth = draw_truth(random);
    const Answer answer = answer_of(bench, right_case(bench, truth, random));
    us += answer.verdict_us;
    if (answer.verdict.level == VerdictLevel::ok) continue;
    ++not_ok;
    fmt::print("truth {:.3f} {:.3f}: {}\n", truth[0], truth[1], first_reason(answer.verdict));
  }
  fmt::print("caution or worse: {} of {}; a verdict of 50 data took {:.0f} µs\n", not_ok, truths,
             us / truths);
  EXPECT_LE(not_ok, std::max(1, truths / 50));
}

}  // namespace
}  // namespace knothe::verdicts
