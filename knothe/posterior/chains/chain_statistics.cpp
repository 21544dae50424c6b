#include "knothe/posterior/chains/chain_statistics.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <numeric>
#include <unsupported/Eigen/FFT>
#include <vector>

#include "knothe/base/error.hpp"
#include "knothe/numerics/statistics/normal_distribution.hpp"

namespace knothe::posterior {

namespace {

void require_draws(const Eigen::Ref<const Eigen::MatrixXd>& draws) {
  if (draws.rows() < 4 || draws.cols() < 1)
    throw UsageError(
        fmt::format("chain statistics: {} draws in {} chains; at least 4 draws a chain are needed",
                    draws.rows(), draws.cols()));
  if (!draws.allFinite()) throw UsageError("chain statistics: a draw is not finite");
}

/// Both halves of each chain as chains of their own; the middle draw of an odd number is left out.
Eigen::MatrixXd split(const Eigen::Ref<const Eigen::MatrixXd>& draws) {
  const Eigen::Index half = draws.rows() / 2;
  Eigen::MatrixXd halves(half, 2 * draws.cols());
  halves.leftCols(draws.cols()) = draws.topRows(half);
  halves.rightCols(draws.cols()) = draws.bottomRows(half);
  return halves;
}

/// Normal scores of average ranks, Φ⁻¹((rank − 3/8)/(S + 1/4)) (Vehtari et al. 2021, Eq. 14).
Eigen::MatrixXd rank_normalise(const Eigen::MatrixXd& draws) {
  const std::size_t n = draws.size();
  std::vector<Eigen::Index> order(n);
  std::iota(order.begin(), order.end(), Eigen::Index{0});
  const double* values = draws.data();
  std::sort(order.begin(), order.end(),
            [&](Eigen::Index a, Eigen::Index b) { return values[a] < values[b]; });
  Eigen::MatrixXd scores(draws.rows(), draws.cols());
  for (std::size_t begin = 0, end = 0; begin < n; begin = end) {
    while (end < n && values[order[end]] == values[order[begin]]) ++end;
    const double rank = 0.5 * (begin + 1 + end);  // the mean of begin + 1 … end
    const double score = numerics::normal_quantile((rank - 0.375) / (n + 0.25));
    for (std::size_t i = begin; i < end; ++i) scores.data()[order[i]] = score;
  }
  return scores;
}

/// Mean variance within chains, W, and the estimate of the whole variance, (n − 1)/n W + B/n (their Eq. 3).
struct Variances {
  double within = 0, whole = 0;
};

Variances variances(const Eigen::MatrixXd& chains) {
  const double n = chains.rows(), m = chains.cols();
  const Eigen::RowVectorXd means = chains.colwise().mean();
  Variances v;
  v.within = (chains.rowwise() - means).squaredNorm() / ((n - 1) * m);
  const double between = (means.array() - means.mean()).square().sum() / (m - 1);  // B/n
  v.whole = (n - 1) / n * v.within + between;
  return v;
}

double r_hat(const Eigen::MatrixXd& chains) {
  constexpr double k_standing_still = 1e6;
  const Variances v = variances(chains);
  if (v.whole <= 0) return 1;
  if (v.within <= v.whole / (k_standing_still * k_standing_still)) return k_standing_still;
  return std::sqrt(v.whole / v.within);
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + values.size() / 2;
  std::nth_element(values.begin(), middle, values.end());
  if (values.size() % 2 == 1) return *middle;
  return 0.5 * (*middle + *std::max_element(values.begin(), middle));
}

/// Autocovariances of one chain at all lags, divisor n, by the Fourier transform of the chain and as many
/// zeros.
Eigen::VectorXd autocovariance(const Eigen::Ref<const Eigen::VectorXd>& chain) {
  const Eigen::Index n = chain.size();
  Eigen::Index padded = 1;
  while (padded < 2 * n) padded *= 2;
  Eigen::VectorXd signal = Eigen::VectorXd::Zero(padded), result(padded);
  signal.head(n) = chain.array() - chain.mean();
  Eigen::FFT<double> transform;
  Eigen::VectorXcd spectrum(padded);
  transform.fwd(spectrum, signal);
  spectrum = spectrum.cwiseAbs2().cast<std::complex<double>>();
  transform.inv(result, spectrum);
  return result.head(n) / n;
}

/// Of chains that are halves already, by the initial monotone sequence.
double effective_of(const Eigen::MatrixXd& halves) {
  if (halves.maxCoeff() == halves.minCoeff()) return 1;
  const Eigen::Index n = halves.rows();
  const double total = halves.size();
  const Variances v = variances(halves);
  Eigen::VectorXd covariance = Eigen::VectorXd::Zero(n);
  for (Eigen::Index m = 0; m < halves.cols(); ++m) covariance += autocovariance(halves.col(m));
  covariance /= halves.cols();
  // ρ_t = 1 − (W − mean autocovariance)/whole variance (their Eq. 10); sums of neighbouring pairs are
  // positive and decrease for a reversible chain (Geyer 1992): the sum ends where that is lost in noise.
  const auto rho = [&](Eigen::Index t) { return t == 0 ? 1.0 : 1 - (v.within - covariance[t]) / v.whole; };
  double time = -1, previous = std::numeric_limits<double>::infinity();
  for (Eigen::Index t = 0; t + 1 < n; t += 2) {
    const double pair = std::min(rho(t) + rho(t + 1), previous);
    if (pair <= 0) break;
    time += 2 * pair;
    previous = pair;
  }
  return total / std::max(time, 1 / std::log10(total));
}

/// 1 below the quantile of `level`, else 0.
Eigen::MatrixXd below_quantile(const Eigen::MatrixXd& draws, double level) {
  std::vector<double> values(draws.data(), draws.data() + draws.size());
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(level * values.size());
  std::nth_element(values.begin(), at, values.end());
  return (draws.array() <= *at).cast<double>();
}

}  // namespace

double split_r_hat(const Eigen::Ref<const Eigen::MatrixXd>& draws) {
  require_draws(draws);
  if (draws.maxCoeff() == draws.minCoeff()) return 1;
  const Eigen::MatrixXd halves = split(draws);
  const double centre = median({halves.data(), halves.data() + halves.size()});
  const Eigen::MatrixXd folded = (halves.array() - centre).abs();
  return std::max(r_hat(rank_normalise(halves)), r_hat(rank_normalise(folded)));
}

double effective_sample_size(const Eigen::Ref<const Eigen::MatrixXd>& draws) {
  require_draws(draws);
  return effective_of(split(draws));
}

double min_effective_size(const Eigen::Ref<const Eigen::MatrixXd>& draws) {
  require_draws(draws);
  const Eigen::MatrixXd halves = split(draws);
  const Eigen::MatrixXd squares = (halves.array() - halves.mean()).square();
  return std::min({effective_of(halves), effective_of(rank_normalise(halves)), effective_of(squares),
                   effective_of(below_quantile(halves, 0.05)), effective_of(below_quantile(halves, 0.95))});
}

double relative_error_of_deviation(const Eigen::Ref<const Eigen::MatrixXd>& draws) {
  require_draws(draws);
  const Eigen::MatrixXd halves = split(draws);
  const Eigen::MatrixXd squares = (halves.array() - halves.mean()).square();
  const double variance = squares.mean();
  if (!(variance > 0)) return 0;
  const auto relative = [&](double error_of_variance) { return 0.5 * error_of_variance / variance; };
  const double by_autocorrelation =
      std::sqrt((squares.array() - variance).square().mean() / effective_of(squares));
  const Eigen::RowVectorXd of_half = squares.colwise().mean();
  const double m = halves.cols();
  const double by_halves = std::sqrt((of_half.array() - variance).square().sum() / ((m - 1) * m));
  return relative(std::max(by_autocorrelation, by_halves));
}

}  // namespace knothe::posterior
