/// @file Time of one update with a whole field of measured dofs, correlated in space and, through the shared
/// reference picture, in time: the claim of docs/assimilation.md. Prints machine, threads, median, p99.
///
/// Usage: large_update_bench [nodes a side] [steps]
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <random>
#include <string>

#include "knothe/assimilation/sequential_update.hpp"

namespace {

namespace reduction = knothe::reduction;
using namespace knothe::assimilation;
using Clock = std::chrono::steady_clock;

std::string processor() {
  std::ifstream cpuinfo("/proc/cpuinfo");
  for (std::string line; std::getline(cpuinfo, line);) {
    if (line.starts_with("model name")) return line.substr(line.find(':') + 2);
  }
  return "unknown processor";
}

/// r smooth functions of two parameters on [0.5, 1.5]².
class SmoothFunctions final : public reduction::ParameterFunctions {
 public:
  explicit SmoothFunctions(Eigen::Index r) : r_(r) {}
  [[nodiscard]] Eigen::Index dimension() const override { return 2; }
  [[nodiscard]] Eigen::Index count() const override { return r_; }
  [[nodiscard]] Eigen::VectorXd lower() const override { return Eigen::Vector2d::Constant(0.5); }
  [[nodiscard]] Eigen::VectorXd upper() const override { return Eigen::Vector2d::Constant(1.5); }
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& p, int derivatives,
                reduction::FunctionBatch& out) const override {
    for (Eigen::Index k = 0; k < r_; ++k) {
      const double a = 1 + 0.3 * static_cast<double>(k % 5), b = 0.5 + 0.2 * static_cast<double>(k % 7);
      const double size = std::pow(0.8, static_cast<double>(k));
      const Eigen::ArrayXd phase = a * p.col(0).array() + b * p.col(1).array() + static_cast<double>(k);
      out.value.col(k) = size * phase.sin();
      if (derivatives < 1) continue;
      out.first[0].col(k) = size * a * phase.cos();
      out.first[1].col(k) = size * b * phase.cos();
      if (derivatives < 2) continue;
      out.second[0].col(k) = -size * a * a * phase.sin();
      out.second[1].col(k) = -size * a * b * phase.sin();
      out.second[2].col(k) = -size * b * b * phase.sin();
    }
  }

 private:
  Eigen::Index r_;
};

/// M/γ² of a regular mesh of side × side nodes with two components: nine nodes a row, both components
/// coupled.
Eigen::SparseMatrix<double> correlation_matrix(int side, double scale) {
  std::vector<Eigen::Triplet<double>> entries;
  for (int y = 0; y < side; ++y) {
    for (int x = 0; x < side; ++x) {
      for (int dy = -1; dy <= 1; ++dy) {
        for (int dx = -1; dx <= 1; ++dx) {
          if (x + dx < 0 || y + dy < 0 || x + dx >= side || y + dy >= side) continue;
          const double w = (dx == 0 ? 4 : 1) * (dy == 0 ? 4 : 1) * scale / 16;
          const int i = y * side + x, j = (y + dy) * side + x + dx;
          for (int c = 0; c < 2; ++c) {
            for (int e = 0; e < 2; ++e) entries.emplace_back(2 * i + c, 2 * j + e, c == e ? w : 0.1 * w);
          }
        }
      }
    }
  }
  Eigen::SparseMatrix<double> m(2 * side * side, 2 * side * side);
  m.setFromTriplets(entries.begin(), entries.end());
  return m;
}

void run(const char* what, int side, int steps, bool shared) {
  const Eigen::Index n = 2 * side * side, l = 20, r = 10;
  std::mt19937_64 random(1);
  std::normal_distribution<double> normal;
  const auto fill = [&](Eigen::MatrixXd m) {
    return Eigen::MatrixXd(m.unaryExpr([&](double) { return normal(random); }));
  };
  auto model = std::make_shared<reduction::ObservedModel>();
  model->functions = std::make_shared<SmoothFunctions>(r);
  model->parameters = {"a", "b"};
  model->space = fill(Eigen::MatrixXd::Zero(n, l));
  model->lift = fill(Eigen::MatrixXd::Zero(n, steps));
  for (int t = 0; t < steps; ++t) {
    model->time.push_back(t);
    model->core.push_back(0.01 * fill(Eigen::MatrixXd::Zero(l, r)));
  }
  NoiseModel noise = NoiseModel::correlated(correlation_matrix(side, 1));
  if (shared) noise = noise.with_shared_reference(1);
  const std::vector<Prior> priors(2, Prior::normal(1, 0.3));
  SequentialUpdate update(model, noise, priors);
  std::vector<double> us, projection;
  for (int t = 0; t < steps; ++t) {
    const Eigen::VectorXd values = model->predict(Eigen::Vector2d(1.1, 0.9), static_cast<std::size_t>(t)) +
                                   0.8 * fill(Eigen::MatrixXd::Zero(n, 1));
    const auto start = Clock::now();
    const UpdateResult& result =
        update.update(static_cast<std::size_t>(t), static_cast<std::size_t>(t), values);
    if (t == 0) continue;  // tables are made
    us.push_back(std::chrono::duration<double, std::micro>(Clock::now() - start).count());
    projection.push_back(result.elapsed_us.projection);
  }
  std::sort(us.begin(), us.end());
  std::sort(projection.begin(), projection.end());
  fmt::print("  {:<40} median {:7.0f} µs   p99 {:7.0f} µs   of which projection {:7.0f} µs\n", what,
             us[us.size() / 2], us[us.size() * 99 / 100], projection[projection.size() / 2]);
}

}  // namespace

int main(int argc, char** argv) {
  const int side = argc > 1 ? std::atoi(argv[1]) : 100, steps = argc > 2 ? std::atoi(argv[2]) : 60;
  fmt::print("{}, 1 thread; {} dofs, noise of image correlation, l = 20, r = 10, {} steps\n", processor(),
             2 * side * side, steps);
  run("pictures independent", side, steps, false);
  run("noise of the reference picture shared", side, steps, true);
  return 0;
}
