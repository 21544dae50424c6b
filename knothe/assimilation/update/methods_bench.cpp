/// @file Time to the same accuracy, method by method, side by side in one run: means within 0.05 std and stds
/// within 5 % of dense quadrature at every step. Prints machine, threads, and a table.
///
/// Usage: methods_bench [observations] [steps]
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <functional>

#include "knothe/assimilation/update/sequential_update.hpp"
#include "knothe/likelihood/testing/bench_models.hpp"

namespace {

using namespace knothe;
using namespace knothe::posterior;
using namespace knothe::likelihood;
using namespace knothe::assimilation;

struct Problem {
  std::shared_ptr<const knothe::model::ObservedModel> model;
  NoiseModel noise;
  std::vector<Prior> priors;
  Eigen::MatrixXd data;
  std::vector<UpdateResult> exact;
};

struct Score {
  double mean = 0, std = 0;  ///< worst over the steps: shift in std, relative error of the std
  double median_us = 0, worst_us = 0;
  [[nodiscard]] bool reached() const { return mean <= 0.05 && std <= 0.05; }
};

using Update = std::function<const UpdateResult&(std::size_t step)>;

Score score(const Problem& problem, const Update& update) {
  Score score;
  std::vector<double> us;
  for (std::size_t t = 0; t < problem.exact.size(); ++t) {
    const UpdateResult& r = update(t);
    const UpdateResult& exact = problem.exact[t];
    us.push_back(r.elapsed_us.total());
    for (Eigen::Index k = 0; k < exact.mean.size(); ++k) {
      const double s = std::sqrt(exact.covariance(k, k));
      score.mean = std::max(score.mean, std::abs(r.mean[k] - exact.mean[k]) / s);
      score.std = std::max(score.std, std::abs(std::sqrt(r.covariance(k, k)) / s - 1));
    }
  }
  std::sort(us.begin(), us.end());
  score.median_us = us[us.size() / 2];
  score.worst_us = us.back();
  return score;
}

void print(const std::string& name, const Score& s) {
  fmt::print("  {:<34} {:>9.0f} {:>9.0f} {:>12.3f} {:>10.1f} %   {}\n", name, s.median_us, s.worst_us, s.mean,
             100 * s.std, s.reached() ? "reached" : "not reached");
}

void baseline(const Problem& problem, const std::string& name, Method kind,
              std::vector<Eigen::Index> samples) {
  for (const Eigen::Index n : samples) {
    UpdateOptions options;
    options.kind = kind;
    options.samples = n;
    SequentialUpdate update(problem.model, problem.noise, problem.priors, options);
    const Score s = score(problem, [&](std::size_t t) -> const UpdateResult& {
      return update.update(t, t, problem.data.col(static_cast<Eigen::Index>(t)));
    });
    print(samples.size() == 1 ? name : fmt::format("{}, {} samples", name, n), s);
    if (s.reached()) return;
  }
}

void maps(const Problem& problem, const std::string& name, UpdateOptions::Form form) {
  UpdateOptions options;
  options.form = form;
  SequentialUpdate update(problem.model, problem.noise, problem.priors, options);
  print(name, score(problem, [&](std::size_t t) -> const UpdateResult& {
          return update.update(t, t, problem.data.col(static_cast<Eigen::Index>(t)));
        }));
}

}  // namespace

int main(int argc, char** argv) {
  const int n = argc > 1 ? std::atoi(argv[1]) : 60, steps = argc > 2 ? std::atoi(argv[2]) : 30;
  std::mt19937_64 random(5);
  Problem problem;
  problem.model = likelihood::bench::large_model(n, 20, 10, steps, random);
  problem.noise = NoiseModel::independent(Eigen::VectorXd::Constant(n, 0.25));
  problem.priors.assign(2, Prior::normal(1, 0.45));
  problem.data.resize(n, steps);
  for (int t = 0; t < steps; ++t)
    problem.data.col(t) = problem.model->predict(Eigen::Vector2d(1.15, 0.85), static_cast<std::size_t>(t)) +
                          0.25 * likelihood::bench::normal_matrix(n, 1, random);
  UpdateOptions options;
  options.kind = Method::grid;
  SequentialUpdate grid(problem.model, problem.noise, problem.priors, options);
  for (int t = 0; t < steps; ++t)
    problem.exact.push_back(
        grid.update(static_cast<std::size_t>(t), static_cast<std::size_t>(t), problem.data.col(t)));
  fmt::print("{}, 1 thread; {} observations, r = 10, {} steps, against dense quadrature\n",
             bench::processor(), n, steps);
  fmt::print("  {:<34} {:>9} {:>9} {:>12} {:>12}\n", "method", "median µs", "worst µs", "mean off/std",
             "std wrong");
  maps(problem, "collapsed map", UpdateOptions::Form::collapsed);
  maps(problem, "composed maps", UpdateOptions::Form::composed);
  baseline(problem, "weighted draws", Method::sequential_monte_carlo, {10000, 40000});
  baseline(problem, "Markov chain", Method::markov_chain, {2500, 10000, 40000, 160000});
  baseline(problem, "extended Kalman filter", Method::extended_kalman, {1000});
  baseline(problem, "unscented Kalman filter", Method::unscented_kalman, {1000});
  baseline(problem, "ensemble Kalman filter", Method::ensemble_kalman, {2500, 10000});
  return 0;
}
