#pragma once
/// @file What the benchmarks of large data share: a field of smooth functions, the noise of image
/// correlation.
#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <cmath>
#include <fstream>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "knothe/model/observe/observed_model.hpp"

namespace knothe::likelihood::bench {

inline std::string processor() {
  std::ifstream cpuinfo("/proc/cpuinfo");
  for (std::string line; std::getline(cpuinfo, line);) {
    if (line.starts_with("model name")) return line.substr(line.find(':') + 2);
  }
  return "unknown processor";
}

/// r smooth functions of two parameters on [0.5, 1.5]².
class SmoothFunctions final : public model::ParameterFunctions {
 public:
  explicit SmoothFunctions(Eigen::Index r) : r_(r) {}
  [[nodiscard]] Eigen::Index dimension() const override { return 2; }
  [[nodiscard]] Eigen::Index count() const override { return r_; }
  [[nodiscard]] Eigen::VectorXd lower() const override { return Eigen::Vector2d::Constant(0.5); }
  [[nodiscard]] Eigen::VectorXd upper() const override { return Eigen::Vector2d::Constant(1.5); }
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& p, int derivatives,
                model::FunctionBatch& out) const override {
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
inline Eigen::SparseMatrix<double> correlation_matrix(int side, double scale) {
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

inline Eigen::MatrixXd normal_matrix(Eigen::Index rows, Eigen::Index columns, std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  Eigen::MatrixXd m = Eigen::MatrixXd::Zero(rows, columns);
  return m.unaryExpr([&](double) { return normal(random); });
}

/// n observations of a random model, smooth in time, with l space modes and r functions of two parameters.
inline std::shared_ptr<model::ObservedModel> large_model(Eigen::Index n, Eigen::Index l, Eigen::Index r,
                                                         int steps, std::mt19937_64& random) {
  auto model = std::make_shared<model::ObservedModel>();
  model->functions = std::make_shared<SmoothFunctions>(r);
  model->parameters = {"a", "b"};
  model->space = normal_matrix(n, l, random);
  model->lift = normal_matrix(n, steps, random);
  // A load that grows: twelve smooth functions of time.
  std::vector<Eigen::MatrixXd> shapes;
  for (int i = 0; i < 12; ++i) shapes.push_back(normal_matrix(l, r, random));
  for (int t = 0; t < steps; ++t) {
    model->time.push_back(t);
    model->core.emplace_back(Eigen::MatrixXd::Zero(l, r));
    for (int i = 0; i < 12; ++i)
      model->core.back() +=
          0.003 * std::sin((i + 1) * 1.5 * (t + 1) / steps) * shapes[static_cast<std::size_t>(i)];
  }
  return model;
}

}  // namespace knothe::likelihood::bench
