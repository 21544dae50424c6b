/// @file Time of one update with the correction of model bias: the claims of
/// docs/explanation/assimilation.md. 60 sensors and r = 10, joint and extrapolated, with a model that is
/// right and one that is wrong, and with three parameters; 20,000 dofs with the noise of image correlation
/// and the extrapolated, low-rank correction. Prints machine, threads, median, p99.
///
/// Usage: corrected_update_bench [steps] [nodes a side of the large field]
#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <ctime>
#include <random>

#include "knothe/assimilation/update/sequential_update.hpp"
#include "knothe/likelihood/testing/bench_models.hpp"
#include "knothe/model/reduced/spline_functions.hpp"

namespace {

using namespace knothe;
using namespace knothe;
using namespace knothe::posterior;
using namespace knothe::likelihood;
using namespace knothe::assimilation;

/// Of this thread, µs: one update is one thread's work, and other jobs do not count.
double cpu_us() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return 1e6 * static_cast<double>(t.tv_sec) + 1e-3 * static_cast<double>(t.tv_nsec);
}

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

/// The functions of the model as splines on 9 × 9 nodes, as a reduced model has them; with three parameters
/// the last one is a factor of all.
std::shared_ptr<const model::ParameterFunctions> as_splines(const model::ParameterFunctions& functions,
                                                            bool three = false) {
  std::vector<double> nodes;
  for (int k = 0; k < 9; ++k) nodes.push_back(0.5 + 0.125 * k);
  Eigen::MatrixXd points(81, 2);
  for (int i = 0; i < 81; ++i)
    points.row(i) << nodes[static_cast<std::size_t>(i / 9)], nodes[static_cast<std::size_t>(i % 9)];
  model::FunctionBatch batch;
  batch.resize(81, 2, functions.count(), 0);
  functions.evaluate(points, 0, batch);
  model::RowMatrix values = batch.value.transpose();
  if (three) {
    model::RowMatrix scaled(values.rows(), 9 * values.cols());
    for (int i = 0; i < 81; ++i)
      for (int k = 0; k < 9; ++k) scaled.col(9 * i + k) = nodes[static_cast<std::size_t>(k)] * values.col(i);
    return std::make_shared<model::JointFunctions>(
        std::vector<std::vector<double>>{nodes, nodes, nodes},
        std::span(scaled.data(), static_cast<std::size_t>(scaled.size())), functions.count());
  }
  return std::make_shared<model::JointFunctions>(
      std::vector<std::vector<double>>{nodes, nodes},
      std::span(values.data(), static_cast<std::size_t>(values.size())), functions.count());
}

/// What the three large-scale terms of the model do not say: the model is wrong by a few standard deviations.
Eigen::VectorXd bias(const model::ObservedModel& model, int step, double size) {
  const double t = (step + 1.0) / static_cast<double>(model.time.size());
  return size * (std::sin(4 * t) * model.space.col(0) + std::cos(3 * t) * model.space.col(1));
}

void run(const std::string& what, const std::shared_ptr<const model::ObservedModel>& model,
         const NoiseModel& noise, double noise_std, double bias_size, BiasCorrectionMode mode,
         BiasOptions::Way way) {
  UpdateOptions options;
  options.bias_correction = mode;
  options.bias.way = way;
  const Eigen::Index d = model->functions->dimension();
  const std::vector<Prior> priors(static_cast<std::size_t>(d), Prior::normal(1, 0.3));
  SequentialUpdate update(model, noise, priors, options);
  std::mt19937_64 random(7);
  std::vector<double> us, map_us, correction_us, watch_us;
  int by_quadrature = 0;
  for (int t = 0; t < static_cast<int>(model->time.size()); ++t) {
    const auto step = static_cast<std::size_t>(t);
    const Eigen::VectorXd values = model->predict(Eigen::Vector3d(1.1, 0.9, 1.05).head(d), step) +
                                   bias(*model, t, bias_size) +
                                   noise_std * likelihood::bench::normal_matrix(noise.size(), 1, random);
    const double start = cpu_us();
    const UpdateResult& result = update.update(step, step, values);
    by_quadrature += result.by_quadrature;
    if (t == 0) continue;
    us.push_back(cpu_us() - start);
    map_us.push_back(result.elapsed_us.map);
    correction_us.push_back(result.elapsed_us.correction);
    watch_us.push_back(result.elapsed_us.watch);
  }
  std::sort(us.begin(), us.end());
  fmt::print(
      "  {:<28} median {:6.0f} µs (map {:.0f}, correction {:.0f}, watch and bias {:.0f})   p99 {:6.0f} µs   "
      "{} "
      "of {} steps by quadrature\n",
      what, us[us.size() / 2], median(map_us), median(correction_us), median(watch_us),
      us[us.size() * 99 / 100], by_quadrature, us.size() + 1);
}

}  // namespace

int main(int argc, char** argv) {
  const int steps = argc > 1 ? std::atoi(argv[1]) : 100, side = argc > 2 ? std::atoi(argv[2]) : 100;
  using enum BiasCorrectionMode;
  using Way = BiasOptions::Way;
  fmt::print("{}, 1 thread; r = 10, two parameters, {} steps\n60 sensors\n", bench::processor(), steps);
  std::mt19937_64 random(1);
  const auto small = likelihood::bench::large_model(60, 20, 10, steps, random);
  small->functions = as_splines(*small->functions);
  const double std = 0.05;
  const NoiseModel noise = NoiseModel::independent(Eigen::VectorXd::Constant(60, std));
  for (const double size : {0.0, 0.01}) {
    const std::string model = size > 0 ? ", model wrong" : ", model right";
    run("off" + model, small, noise, std, size, off, Way::joint);
    run("joint" + model, small, noise, std, size, on, Way::joint);
    run("linear" + model, small, noise, std, size, on, Way::modes);
  }
  fmt::print("60 sensors, three parameters\n");
  const auto three = std::make_shared<model::ObservedModel>(*small);
  three->functions = as_splines(likelihood::bench::SmoothFunctions(10), true);
  run("off, model wrong", three, noise, std, 0.01, off, Way::joint);
  run("joint, model wrong", three, noise, std, 0.01, on, Way::joint);
  fmt::print("{} dofs, noise of image correlation\n", 2 * side * side);
  const auto large = likelihood::bench::large_model(2 * side * side, 20, 10, steps, random);
  large->functions = as_splines(*large->functions);
  const NoiseModel correlated = NoiseModel::correlated(likelihood::bench::correlation_matrix(side, 1));
  run("off, model wrong", large, correlated, 0.8, 0.05, off, Way::modes);
  run("linear, model wrong", large, correlated, 0.8, 0.05, on, Way::modes);
  run("joint, model wrong", large, correlated, 0.8, 0.05, on, Way::joint);
  return 0;
}
