#include "knothe/numerics/integrate/quadrature.hpp"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <cmath>
#include <numbers>
#include <vector>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/numerics/integrate/hermite.hpp"

namespace knothe::numerics {

Quadrature gauss_hermite(int n) {
  if (n < 1 || n > 128)
    throw UsageError(fmt::format("Gauss-Hermite rule of {} points: 1 to 128 are possible", n));
  Eigen::VectorXd diagonal = Eigen::VectorXd::Zero(n), off(std::max(n - 1, 0));
  for (int k = 0; k < n - 1; ++k) off[k] = std::sqrt(k + 1.0);
  Quadrature rule{diagonal, Eigen::VectorXd::Ones(n)};
  if (n == 1) return rule;
  Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver;
  solver.computeFromTridiagonal(diagonal, off, Eigen::EigenvaluesOnly);
  std::vector<double> h(n + 1);
  for (int i = 0; i < n; ++i) {
    double x = solver.eigenvalues()[i];
    for (int step = 0; step < 3; ++step) {
      normalised_hermite(x, h);
      x -= h[n] / (std::sqrt(n) * h[n - 1]);
    }
    rule.nodes[i] = x;
  }
  rule.nodes = (0.5 * (rule.nodes - rule.nodes.reverse())).eval();  // exactly symmetric
  for (int i = 0; i < n; ++i) {
    normalised_hermite(rule.nodes[i], h);
    double sum = 0;
    for (int k = 0; k < n; ++k) sum += h[k] * h[k];
    rule.weights[i] = 1 / sum;
  }
  return rule;
}

Quadrature gauss_legendre(int n, double a, double b) {
  if (n < 1) throw UsageError(fmt::format("Gauss-Legendre rule of {} points: at least 1 is needed", n));
  Quadrature rule{Eigen::VectorXd(n), Eigen::VectorXd(n)};
  for (int i = 0; i < n; ++i) {
    double x = -std::cos(std::numbers::pi * (i + 0.75) / (n + 0.5)), slope = 1;
    for (int step = 0; step < 8; ++step) {
      double p = 1, previous = 0;
      for (int k = 1; k <= n; ++k) {
        const double next = ((2 * k - 1) * x * p - (k - 1) * previous) / k;
        previous = p;
        p = next;
      }
      slope = n * (previous - x * p) / (1 - x * x);
      const double change = p / slope;
      x -= change;
      if (std::abs(change) < 1e-16) break;
    }
    rule.nodes[i] = 0.5 * (a + b) + 0.5 * (b - a) * x;
    rule.weights[i] = (b - a) / ((1 - x * x) * slope * slope);
  }
  return rule;
}

PointRule tensor_rule(const Quadrature& rule, Index d, double drop) {
  if (d < 1) throw UsageError(fmt::format("tensor rule in {} dimensions: at least 1 is needed", d));
  return tensor_rule(std::vector<Quadrature>(d, rule), drop);
}

PointRule tensor_rule(const std::vector<Quadrature>& rules, double drop) {
  if (rules.empty()) throw UsageError("tensor rule in 0 dimensions: at least 1 is needed");
  const auto d = std::ssize(rules);
  std::vector<Index> index(d, 0), kept;
  std::vector<double> weights;
  double total = 0;
  for (bool more = true; more;) {
    double w = 1;
    for (Index k = 0; k < std::ssize(rules); ++k) w *= rules[k].weights[index[k]];
    total += w;
    if (w >= drop) {
      kept.insert(kept.end(), index.begin(), index.end());
      weights.push_back(w);
    }
    more = false;
    for (Index k = 0; k < std::ssize(rules); ++k) {
      if (++index[k] < rules[k].nodes.size()) {
        more = true;
        break;
      }
      index[k] = 0;
    }
  }
  PointRule result{Eigen::MatrixXd(std::ssize(weights), d),
                   Eigen::Map<Eigen::VectorXd>(weights.data(), std::ssize(weights))};
  for (Index p = 0; p < result.points.rows(); ++p)
    for (Index k = 0; k < d; ++k) result.points(p, k) = rules[k].nodes[kept[p * d + k]];
  result.weights *= total / result.weights.sum();
  return result;
}

}  // namespace knothe::numerics
