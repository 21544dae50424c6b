#include "knothe/posterior/quadrature/lattice_rule.hpp"

#include <algorithm>
#include <cmath>

#include "knothe/numerics/statistics/weighted_statistics.hpp"

namespace knothe::posterior {

using Eigen::Index;
using numerics::k_quantile_levels;

void evaluate_in_blocks(CheckedDensity& target, const Eigen::MatrixXd& points, LogDensityBatch& workspace,
                        Eigen::VectorXd& values) {
  // Few sizes of blocks: a target may keep workspace for each.
  for (Index begin = 0, block = 512; begin < values.size(); begin += block) {
    while (block > values.size() - begin) block /= 2;
    target.evaluate(points.middleRows(begin, block), 0, workspace);
    values.segment(begin, block) = workspace.value;
  }
}

void Marginals::add(const numerics::GridRun& run, const Eigen::VectorXd& weights, Index first, Index stride,
                    std::span<const Index> row) {
  const Index n = std::max<Index>((run.end - first + stride - 1) / stride, 0);
  const auto of_run = weights(Eigen::seqN(run.at + first - run.begin, n, stride));
  mass.rightCols<1>()(Eigen::seqN(first, n, stride)) += of_run;
  const double total = of_run.sum();
  for (Index k = 0; k < std::ssize(row); ++k) mass(row[k], k) += total;
  sum += total;
}

std::array<double, 2> Marginals::moments(Index k) const {
  const Eigen::ArrayXd at = Eigen::ArrayXd::LinSpaced(mass.rows(), 0, mass.rows() - 1);
  const double mean = (mass.col(k).array() * at).sum() / sum;
  return {mean, std::sqrt((mass.col(k).array() * (at - mean).square()).sum() / sum)};
}

double Marginals::change_from(const Marginals& coarser, Index k) const {
  const auto [mean, deviation] = moments(k);
  const auto [coarse_mean, coarse_deviation] = coarser.moments(k);
  return std::max(std::abs(coarse_mean - mean) / deviation, std::abs(coarse_deviation / deviation - 1));
}

void LineNodes::add(std::span<const double> at, std::span<const double> weight, double spacing,
                    double factor) {
  constexpr double k_spread = 1.3;  ///< of a node, in spacings
  nodes.insert(nodes.end(), at.begin(), at.end());
  for (const double w : weight) weights.push_back(factor * w);
  widths.resize(nodes.size(), k_spread * spacing);
}

Eigen::RowVectorXd LineNodes::quantiles() const {
  Eigen::RowVectorXd result(std::ssize(k_quantile_levels));
  numerics::lattice_quantiles(nodes, weights, widths, k_quantile_levels,
                              {result.data(), k_quantile_levels.size()});
  return result;
}

}  // namespace knothe::posterior
