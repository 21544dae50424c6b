#include <algorithm>
#include <cmath>
#include <numeric>

#include "knothe/base/cancellation.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/model/compress/separation.hpp"

namespace knothe::model {

namespace {

/// Squared HOSVD error relative to the deviation: far below what a canonical form of a travelling front
/// reaches.
constexpr double k_hosvd = 1e-10;
constexpr std::size_t k_growth_sweeps = 40;

}  // namespace

CanonicalSeparation::CanonicalSeparation(const Deviation& deviation, const ParameterProduct& product,
                                         const Snapshots& snapshots, const CompressionOptions& options)
    : deviation_(deviation), product_(product), options_(options) {
  const ParameterUnfolding unfolding(deviation, product, options.threads);
  const double allowed = std::max(k_hosvd * unfolding.squared_norm(), 1e-300);
  const Eigen::MatrixXd grid = dominant_space(unfolding, {.allowed = allowed, .seed = options.seed}).basis;
  const Index kept = grid.cols();
  const Eigen::MatrixXd weighted = deviation.projected(product.times(grid), options.threads);
  space_ = dominant_space(weighted, allowed, options.seed, options.threads).basis;
  const Eigen::MatrixXd core = space_.transpose() * weighted;  // l × (n_t · kept)

  // The time direction: each row of `by_time` is one instant.
  const Index l = space_.cols(), times = deviation.times();
  Eigen::MatrixXd time_gram(times, times);
  for (Index a = 0; a < times; ++a) {
    for (Index b = 0; b <= a; ++b) {
      time_gram(a, b) = time_gram(b, a) =
          core.middleCols(a * kept, kept).cwiseProduct(core.middleCols(b * kept, kept)).sum();
    }
  }
  const FallingEigenpairs instants = falling_eigenpairs(time_gram);
  const DominantSpace by_instant{instants.vectors, instants.values};
  const Index s = std::max<Index>(1, by_instant.rank_for(allowed));
  time_ = instants.vectors.leftCols(s);

  // [l, s, P]: time compressed, parameters back on the grid (in the coordinates Lᵀ f of ParameterProduct).
  const Index points = deviation.grid();
  core_.unfolded.resize(l, s * points);
  for (Index j = 0; j < s; ++j) {
    Eigen::MatrixXd part = Eigen::MatrixXd::Zero(l, kept);
    for (Index t = 0; t < times; ++t) part += time_(t, j) * core.middleCols(t * kept, kept);
    core_.unfolded.middleCols(j * points, points).noalias() = part * grid.transpose();
  }
  core_.others.push_back(s);
  for (const Axis& axis : snapshots.axes) {
    axis_weights_.push_back(trapezoid_weights(axis.nodes));
    core_.others.push_back(std::ssize(axis.nodes));
  }
}

const CpFactors& CanonicalSeparation::decompose(std::size_t m) {
  if (!options_.grown_start && options_.random_starts == 0)
    throw UsageError("canonical form: no start is asked for, neither grown nor random");
  const Index modes = m;
  best_ = {};
  best_.error = std::numeric_limits<double>::infinity();
  while (options_.grown_start && (grown_.factors.empty() || grown_.modes() < modes)) {
    check_cancellation("nothing of the compression is kept; start it again");
    const std::uint64_t seed =
        options_.seed + (grown_.factors.empty() ? 0 : static_cast<std::uint64_t>(grown_.modes()));
    grown_ = als(core_, with_one_more_mode(core_, grown_, seed), k_growth_sweeps);
  }
  if (options_.grown_start) best_ = als(core_, grown_, options_.sweeps);
  for (std::size_t i = 0; i < options_.random_starts; ++i) {
    check_cancellation("nothing of the compression is kept; start it again");
    const std::uint64_t seed = options_.seed + 7919 * (i + 1) + m;
    CpFactors other = als(core_, random_start(core_, modes, seed), options_.sweeps);
    if (other.error < best_.error) best_ = std::move(other);
  }
  return best_;
}

void CanonicalSeparation::fill(ModelContents& model) const {
  const Index m = best_.modes();
  Eigen::MatrixXd space = space_ * best_.factors[0];
  const Eigen::VectorXd by_time = deviation_.time_weights().cwiseSqrt().cwiseInverse();
  Eigen::MatrixXd time = by_time.asDiagonal() * time_ * best_.factors[1];
  std::vector<Eigen::MatrixXd> parameters;
  for (Index i = 0; i < std::ssize(axis_weights_); ++i) {
    const Eigen::MatrixXd& factor = product_.factors()[i];
    parameters.push_back(factor.transpose().triangularView<Eigen::Upper>().solve(best_.factors[i + 2]));
  }
  // Space modes have unit norm, parameter modes unit weighted mean square and a positive mean: the time modes
  // carry amplitude and sign.
  for (Index k = 0; k < m; ++k) {
    const double norm = space.col(k).norm();
    if (norm > 0.0) space.col(k) /= norm;
    time.col(k) *= norm;
    for (Index i = 0; i < std::ssize(parameters); ++i) {
      auto alpha = parameters[i].col(k);
      double scale = std::sqrt(axis_weights_[i].dot(alpha.cwiseAbs2()));
      if (axis_weights_[i].dot(alpha) < 0.0) scale = -scale;
      if (scale != 0.0) alpha /= scale;
      time.col(k) *= scale;
    }
  }
  std::vector<Index> order(m);
  std::iota(order.begin(), order.end(), Index{0});
  const Eigen::VectorXd amplitude = time.colwise().norm();
  std::stable_sort(order.begin(), order.end(), [&](Index a, Index b) { return amplitude[a] > amplitude[b]; });

  const auto stored = [&](const Eigen::MatrixXd& columns) {
    const Eigen::MatrixXd sorted = columns(Eigen::all, order);
    return std::vector<double>(sorted.data(), sorted.data() + sorted.size());
  };
  model.form = Form::canonical;
  model.space_modes = model.parameter_modes = m;
  model.space = stored(space);
  model.temporal = stored(time);
  model.parameters.clear();
  for (const Eigen::MatrixXd& factor : parameters) model.parameters.push_back(stored(factor));
}

}  // namespace knothe::model
