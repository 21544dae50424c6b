/// @file The tables of docs/benchmarks/adaptive-runs.md: runs that a posterior shift of 0.1 std takes for 2
/// to 8 parameters, chosen, on the plain sparse grid, on a full tensor grid and at random points.
///
/// Usage: run_selection_bench [largest number of parameters, default 8]
#include <fmt/format.h>

#include <Eigen/QR>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <optional>
#include <random>

#include "knothe/assimilation/select/run_selection.hpp"
#include "knothe/model/grid/sparse_solutions.hpp"
#include "knothe/numerics/functions/cubic_spline.hpp"
#include "knothe/numerics/functions/degree_growth.hpp"

namespace {

using namespace knothe;
using namespace knothe;
using namespace knothe::posterior;
using namespace knothe::assimilation;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double k_wanted = 0.1;           // std
constexpr std::size_t k_max_runs = 12000;  // runs: beyond, a design has lost
constexpr int k_sensors = 4, k_times = 20;

/// Four signals that decay, each parameter half as influential as the one before: y/noise.
VectorXd signals(const VectorXd& p) {
  VectorXd y(k_sensors * k_times);
  for (int s = 0; s < k_sensors; ++s) {
    double rate = 0.4, level = 1;
    for (Index i = 0; i < p.size(); ++i) {
      const double weight = std::pow(0.5, static_cast<double>(i)),
                   phase = std::cos(1.3 * s + 0.9 * static_cast<double>(i));
      rate += 0.6 * weight * phase * phase * p[i];
      level += 0.5 * weight * std::sin(0.7 * s + static_cast<double>(i)) * p[i];
    }
    for (int t = 0; t < k_times; ++t) y[s * k_times + t] = 50 * level * std::exp(-rate * 0.15 * (t + 1));
  }
  return y;
}

MatrixXd signals_at(const std::vector<std::vector<double>>& points) {
  MatrixXd result(static_cast<Index>(points.size()), k_sensors * k_times);
  for (std::size_t n = 0; n < points.size(); ++n)
    result.row(static_cast<Index>(n)) =
        signals(Eigen::Map<const VectorXd>(points[n].data(), static_cast<Index>(points[n].size())))
            .transpose();
  return result;
}

/// Judges designs by the posterior shift at 64 truths that none of them has seen, with the exact slopes.
class Judge {
 public:
  explicit Judge(Index d) : shift_(std::vector<Prior>(static_cast<std::size_t>(d), Prior::uniform(0, 1))) {
    truths_ = shift_.draw(64, 4711);
  }
  [[nodiscard]] const MatrixXd& truths() const { return truths_; }
  /// Root mean square of the shifts by these predictions at the truths, 64 × N.
  [[nodiscard]] double operator()(const MatrixXd& predictions) const {
    double sum = 0;
    for (Index n = 0; n < truths_.rows(); ++n) {
      const VectorXd p = truths_.row(n).transpose();
      MatrixXd jacobian(k_sensors * k_times, p.size());
      for (Index i = 0; i < p.size(); ++i) {
        constexpr double h = 1e-5;
        VectorXd ahead = p, behind = p;
        ahead[i] += h;
        behind[i] -= h;
        jacobian.col(i) = (signals(ahead) - signals(behind)) / (2 * h);
      }
      const VectorXd error = signals(p) - predictions.row(n).transpose();
      sum += linear_posterior_shift(jacobian.transpose() * jacobian, shift_.prior_variance(),
                                    jacobian.transpose() * error)
                 .squaredNorm();
    }
    return std::sqrt(sum / static_cast<double>(truths_.rows()));
  }

 private:
  ExpectedShift shift_;
  MatrixXd truths_;
};

struct DesignOutcome {
  std::size_t runs = 0;
  double shift = 0, seconds = 0;  ///< without the runs themselves
  std::string grid;               ///< nodes of the model's splines
};

MatrixXd predicted(const numerics::SparseInterpolation& interpolation, const MatrixXd& surpluses,
                   const MatrixXd& truths) {
  MatrixXd result(truths.rows(), surpluses.cols());
  for (Index n = 0; n < truths.rows(); ++n)
    result.row(n) = interpolation.basis(truths.row(n).transpose()).transpose() * surpluses;
  return result;
}

/// As offline/adaptive_runs.cpp has it.
std::string model_grid(const SelectedRuns& selected) {
  const auto d = static_cast<std::size_t>(selected.interpolation.dimension());
  ExpectedShift shift(std::vector<Prior>(d, Prior::uniform(0, 1)));
  shift.set(selected.interpolation, selected.surpluses);
  std::vector<model::Axis> axes(d);
  for (model::Axis& axis : axes) axis.nodes = {0, 1};
  model::choose_nodes(selected.interpolation,
                      {.error = [&](const auto& missed) { return shift.of_factors(missed); },
                       .allowed = 0.3 * k_wanted / std::sqrt(static_cast<double>(d))},
                      axes);
  std::size_t points = 1;
  std::vector<std::size_t> nodes;
  for (const model::Axis& axis : axes) {
    nodes.push_back(axis.nodes.size());
    points *= axis.nodes.size();
  }
  return fmt::format("{} = {}", fmt::join(nodes, "·"), points);
}

DesignOutcome chosen_runs(Index d, const Judge& judge) {
  const auto start = std::chrono::steady_clock::now();
  const SelectedRuns selected =
      select_runs(std::vector<Prior>(static_cast<std::size_t>(d), Prior::uniform(0, 1)), VectorXd::Zero(d),
                  VectorXd::Ones(d), {.shift = k_wanted, .runs = k_max_runs}, signals_at);
  const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - start;
  return {selected.history.back().runs,
          judge(predicted(selected.interpolation, selected.surpluses, judge.truths())), elapsed.count(),
          model_grid(selected)};
}

/// All degrees of a total degree that rises.
DesignOutcome plain_sparse_grid(Index d, const Judge& judge) {
  numerics::SparseInterpolation interpolation(VectorXd::Zero(d), VectorXd::Ones(d));
  numerics::DegreeGrowth growth(static_cast<int>(d), 40);
  DesignOutcome outcome;
  while (true) {
    std::vector<std::vector<double>> points;
    for (std::size_t n = 0; n < growth.indices().size(); ++n) {
      if (n >= static_cast<std::size_t>(interpolation.count())) interpolation.add(growth.indices()[n]);
      const VectorXd p = interpolation.node(growth.indices()[n]);
      points.emplace_back(p.data(), p.data() + p.size());
    }
    const MatrixXd surpluses = interpolation.surpluses(signals_at(points));
    outcome = {points.size(), judge(predicted(interpolation, surpluses, judge.truths())), 0, ""};
    if (outcome.shift <= k_wanted || outcome.runs > k_max_runs) return outcome;
    growth.expand(std::vector<double>(growth.indices().size(), 0.0), true, 1000000);
  }
}

/// Calls visit(index) for all multi-indices below n in d variables.
template <class Visit>
void for_each_index(Index d, int n, const Visit& visit) {
  std::vector<int> index(static_cast<std::size_t>(d), 0);
  while (true) {
    visit(index);
    std::size_t i = index.size();
    while (i > 0 && ++index[i - 1] == n) index[--i] = 0;
    if (i == 0) return;
  }
}

/// n evenly spaced nodes on each axis and cubic splines, as `knothe offline` without a choice.
DesignOutcome tensor_grid(Index d, const Judge& judge) {
  for (int n = 2;; ++n) {
    std::vector<double> nodes;
    for (int k = 0; k < n; ++k) nodes.push_back(static_cast<double>(k) / (n - 1));
    const numerics::CubicSplineBasis spline(nodes);
    const MatrixXd& truths = judge.truths();
    std::vector<MatrixXd> weights;  // of each axis: truths × n
    for (Index i = 0; i < d; ++i) {
      MatrixXd w(truths.rows(), n);
      for (Index k = 0; k < truths.rows(); ++k) w.row(k) = spline.cardinal_weights(truths(k, i)).transpose();
      weights.push_back(w);
    }
    MatrixXd sum = MatrixXd::Zero(truths.rows(), k_sensors * k_times);
    for_each_index(d, n, [&](const std::vector<int>& index) {
      VectorXd p(d), weight = VectorXd::Ones(truths.rows());
      for (Index i = 0; i < d; ++i) {
        const int k = index[static_cast<std::size_t>(i)];
        p[i] = nodes[static_cast<std::size_t>(k)];
        weight.array() *= weights[static_cast<std::size_t>(i)].col(k).array();
      }
      sum.noalias() += weight * signals(p).transpose();
    });
    const DesignOutcome outcome{static_cast<std::size_t>(std::llround(std::pow(n, d))), judge(sum), 0, ""};
    if (outcome.shift <= k_wanted || std::pow(n + 1, d) > 2e6) return outcome;
  }
}

/// Least squares of polynomials of a total degree that rises, at twice as many random points as coefficients.
DesignOutcome random_points(Index d, const Judge& judge) {
  numerics::SparseInterpolation basis(VectorXd::Zero(d), VectorXd::Ones(d));
  numerics::DegreeGrowth growth(static_cast<int>(d), 40);
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> unit;
  while (true) {
    for (auto n = static_cast<std::size_t>(basis.count()); n < growth.indices().size(); ++n)
      basis.add(growth.indices()[n]);
    std::vector<std::vector<double>> points(2 * growth.indices().size(),
                                            std::vector<double>(static_cast<std::size_t>(d)));
    MatrixXd matrix(static_cast<Index>(points.size()), basis.count());
    for (std::size_t n = 0; n < points.size(); ++n) {
      for (double& x : points[n]) x = unit(random);
      matrix.row(static_cast<Index>(n)) =
          basis.basis(Eigen::Map<const VectorXd>(points[n].data(), d)).transpose();
    }
    const MatrixXd coefficients = matrix.householderQr().solve(signals_at(points));
    const DesignOutcome outcome{points.size(), judge(predicted(basis, coefficients, judge.truths())), 0, ""};
    if (outcome.shift <= k_wanted || outcome.runs > k_max_runs / 4) return outcome;
    growth.expand(std::vector<double>(growth.indices().size(), 0.0), true, 1000000);
  }
}

std::string cell(const DesignOutcome& outcome) {
  return fmt::format("{}{} | {:.3f}", outcome.shift > k_wanted ? "> " : "", outcome.runs, outcome.shift);
}

}  // namespace

int main(int argc, char** argv) {
  const int most = argc > 1 ? std::atoi(argv[1]) : 8;
  fmt::print(
      "| d | chosen | shift | ms | grid of the model | plain sparse grid | shift | tensor grid | shift | "
      "random points | shift |\n"
      "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n");
  for (int d = 2; d <= most; ++d) {
    const Judge judge(d);
    const DesignOutcome chosen = chosen_runs(d, judge);
    fmt::print("| {} | {} | {:.1f} | {} | {} | {} | {} |\n", d, cell(chosen), 1e3 * chosen.seconds,
               chosen.grid, cell(plain_sparse_grid(d, judge)), cell(tensor_grid(d, judge)),
               cell(random_points(d, judge)));
    std::fflush(stdout);
  }
}
