// Marginal densities, distribution functions and quantiles of a map, by averages of exact conditionals.
#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <vector>

#include "knothe/base/error.hpp"
#include "knothe/numerics/integrate/sobol.hpp"
#include "knothe/numerics/linear/symmetric_eigen.hpp"
#include "knothe/numerics/statistics/normal_distribution.hpp"
#include "knothe/transport/extras/map_distribution.hpp"
#include "knothe/transport/map/pull_back.hpp"

namespace knothe::transport {

namespace {

/// Coordinate k of a triangular map, conditional on reference variables x_0 … x_{k−1}: exact, one per
/// quasi-random point.
class TriangularConditional {
 public:
  TriangularConditional(const MapDistribution& map, Eigen::Index k, const MarginalOptions& options)
      : k_(k), upto_(map.leading(k + 1).map()), before_(std::max<Eigen::Index>(k, 1)) {
    if (k == 0) {  // nothing before it
      x_.resize(1, 0), z_.resize(1, 0);
      log_determinant_.setZero(1);
      return;
    }
    before_ = map.leading(k).map();
    set_before(numerics::sobol_normal_points(options.points, k, options.seed));
  }
  /// Other values of the reference variables before k.
  void set_before(Eigen::MatrixXd x) {
    x_ = std::move(x);
    if (k_ == 0) {
      log_determinant_.setZero(x_.rows());
      return;
    }
    MapBatch batch;
    before_.evaluate(x_, 0, batch);
    z_ = std::move(batch.value);
    log_determinant_ = std::move(batch.log_determinant);
  }
  [[nodiscard]] Eigen::Index points() const { return x_.rows(); }

  /// x_k with T_k(x_0 … x_{k−1}, x_k) = at, and the density of z_k there, for every point.
  void evaluate(double at, Eigen::VectorXd& reference, Eigen::VectorXd& density) {
    full_.resize(points(), k_ + 1);
    if (k_ > 0) full_.leftCols(k_) = z_;
    full_.col(k_).setConstant(at);
    const Eigen::MatrixXd x = upto_.inverse(full_);
    upto_.evaluate(x, 0, batch_);
    reference = x.col(k_);
    density =
        (-0.5 * reference.array().square() - (batch_.log_determinant - log_determinant_).array()).exp() /
        std::sqrt(2 * std::numbers::pi);
    density = (density.array().isFinite()).select(density, 0.0);  // a slope of zero: a set without mass
  }
  [[nodiscard]] const Eigen::MatrixXd& before() const { return x_; }

 private:
  Eigen::Index k_;
  ComposedMap upto_, before_;
  Eigen::MatrixXd x_, z_, full_;
  Eigen::VectorXd log_determinant_;
  MapBatch batch_;
};

/// Coordinates `which` of A ∘ S_1 ∘ … ∘ S_l, S_i maps on subspaces U_i, A affine: along directions v
/// orthogonal to all U_i the map is x + v ↦ T(x) + L v, so that with P the projection on those directions,
/// given x − P x, the coordinates are N(T(x) − L P x, L P Lᵀ) restricted to `which`.
struct GaussianMixture {
  Eigen::MatrixXd mean;        ///< n × |which|
  Eigen::MatrixXd covariance;  ///< |which| × |which|, the same for all

  GaussianMixture(const ComposedMap& map, const std::vector<Eigen::Index>& which,
                  const MarginalOptions& options) {
    const Eigen::Index d = map.dimension(), m = static_cast<Eigen::Index>(which.size());
    Eigen::MatrixXd rows = Eigen::MatrixXd::Zero(m, d);  // of L
    for (Eigen::Index i = 0; i < m; ++i) rows(i, which[static_cast<std::size_t>(i)]) = 1;
    Eigen::MatrixXd bases(d, 0);
    for (const auto& part : map.parts()) {
      if (const auto* affine = std::get_if<AffineMap>(&part)) {
        if (bases.cols() > 0)
          throw UsageError(
              "marginals of a lazy map: an affine part stands behind a subspace part; only in front is "
              "possible");
        rows = (rows * affine->matrix()).eval();
      } else if (const auto* subspace = std::get_if<SubspaceMap>(&part)) {
        bases.conservativeResize(d, bases.cols() + subspace->rank());
        bases.rightCols(subspace->rank()) = subspace->basis();
      } else {
        throw UsageError(
            "marginals: the map is neither triangular nor a lazy map; the solver turns maps to the principal "
            "axes of the mode unless MapSolverOptions::orientation is Orientation::given");
      }
    }
    const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(bases);
    const Eigen::MatrixXd q = qr.householderQ() * Eigen::MatrixXd::Identity(d, qr.rank());
    const Eigen::MatrixXd across = rows - (rows * q) * q.transpose();  // L P
    const Eigen::MatrixXd x = numerics::sobol_normal_points(options.points, d, options.seed);
    MapTrace trace;
    trace.evaluate(map, x, false);
    mean.resize(x.rows(), m);
    for (Eigen::Index i = 0; i < m; ++i) mean.col(i) = trace.value().col(which[static_cast<std::size_t>(i)]);
    const Eigen::MatrixXd spread = mean.rowwise() - mean.colwise().mean();
    mean -= x * across.transpose();
    covariance = across * across.transpose();
    // A coordinate that lies in the subspaces has no spread of its own: there, and only there, a narrow
    // kernel.
    const Eigen::VectorXd std =
        (spread.colwise().squaredNorm().transpose() / static_cast<double>(x.rows())).cwiseSqrt();
    const numerics::SymmetricEigen eigen(std.cwiseInverse().asDiagonal() * covariance *
                                         std.cwiseInverse().asDiagonal());
    const double least = 0.25 * std::pow(static_cast<double>(x.rows()), -0.4);
    const Eigen::MatrixXd vectors = std.asDiagonal() * eigen.eigenvectors();
    covariance = vectors * eigen.eigenvalues().cwiseMax(least).asDiagonal() * vectors.transpose();
  }
};

}  // namespace

Eigen::VectorXd MapDistribution::marginal_density(Eigen::Index k, std::span<const double> at,
                                                  const MarginalOptions& options) const {
  require_coordinate(k);
  Eigen::VectorXd result(static_cast<Eigen::Index>(at.size()));
  if (!is_triangular()) {
    const GaussianMixture mixture(map_, {k}, options);
    const double std = std::sqrt(mixture.covariance(0, 0));
    for (std::size_t i = 0; i < at.size(); ++i)
      result[static_cast<Eigen::Index>(i)] =
          (-0.5 * ((at[i] - mixture.mean.col(0).array()) / std).square()).exp().mean() /
          (std * std::sqrt(2 * std::numbers::pi));
    return result;
  }
  TriangularConditional conditional(*this, k, options);
  Eigen::VectorXd reference, density;
  for (std::size_t i = 0; i < at.size(); ++i) {
    conditional.evaluate(at[i], reference, density);
    result[static_cast<Eigen::Index>(i)] = density.mean();
  }
  return result;
}

Eigen::VectorXd MapDistribution::marginal_cumulative(Eigen::Index k, std::span<const double> at,
                                                     const MarginalOptions& options) const {
  require_coordinate(k);
  Eigen::VectorXd result(static_cast<Eigen::Index>(at.size()));
  const auto normal_cdf = [](double u) { return numerics::normal_cdf(u); };
  if (!is_triangular()) {
    const GaussianMixture mixture(map_, {k}, options);
    const double std = std::sqrt(mixture.covariance(0, 0));
    for (std::size_t i = 0; i < at.size(); ++i)
      result[static_cast<Eigen::Index>(i)] =
          ((at[i] - mixture.mean.col(0).array()) / std).unaryExpr(normal_cdf).mean();
    return result;
  }
  TriangularConditional conditional(*this, k, options);
  Eigen::VectorXd reference, density;
  for (std::size_t i = 0; i < at.size(); ++i) {
    conditional.evaluate(at[i], reference, density);
    result[static_cast<Eigen::Index>(i)] = reference.unaryExpr(normal_cdf).mean();
  }
  return result;
}

Eigen::VectorXd MapDistribution::marginal_quantiles(Eigen::Index k, std::span<const double> levels,
                                                    const MarginalOptions& options) const {
  require_coordinate(k);
  for (const double level : levels)
    if (!(level > 0 && level < 1))
      throw UsageError(fmt::format("quantile of level {}: levels lie between 0 and 1, both excluded", level));
  // A bracket from the images of the same points, widened until it holds the level, then regula falsi
  // (Illinois).
  Eigen::VectorXd image = map_.evaluate(numerics::sobol_normal_points(256, dimension(), options.seed)).col(k);
  std::sort(image.begin(), image.end());
  const double width = std::max(image.maxCoeff() - image.minCoeff(), 1e-300);
  Eigen::VectorXd result(static_cast<Eigen::Index>(levels.size()));
  const auto residual = [&](double z, double level) {
    return marginal_cumulative(k, std::span<const double>(&z, 1), options)[0] - level;
  };
  for (std::size_t i = 0; i < levels.size(); ++i) {
    const auto place = static_cast<Eigen::Index>(levels[i] * 255);
    double low = image[std::max<Eigen::Index>(place - 6, 0)],
           high = image[std::min<Eigen::Index>(place + 6, 255)];
    double f_low = residual(low, levels[i]), f_high = residual(high, levels[i]);
    for (double reach = 0.1 * width; f_low > 0 && reach < 1e6 * width; reach *= 2)
      f_low = residual(low -= reach, levels[i]);
    for (double reach = 0.1 * width; f_high < 0 && reach < 1e6 * width; reach *= 2)
      f_high = residual(high += reach, levels[i]);
    for (int iteration = 0; iteration < 60 && high - low > 1e-10 * width && f_low < 0 && f_high > 0;
         ++iteration) {
      const double secant = low - f_low * (high - low) / (f_high - f_low);
      const double z = iteration % 3 == 2 ? 0.5 * (low + high) : secant, f = residual(z, levels[i]);
      if (std::abs(f) < 1e-12) {
        low = high = z;
        break;
      }
      (f < 0 ? low : high) = z;
      (f < 0 ? f_low : f_high) = f;
    }
    result[static_cast<Eigen::Index>(i)] = f_low == 0 ? low : f_high == 0 ? high : 0.5 * (low + high);
  }
  return result;
}

Eigen::MatrixXd MapDistribution::pair_density(Eigen::Index k, Eigen::Index l, std::span<const double> at_k,
                                              std::span<const double> at_l,
                                              const MarginalOptions& options) const {
  require_coordinate(k), require_coordinate(l);
  if (k == l) throw UsageError(fmt::format("pair density of coordinate {} with itself", k));
  if (k > l) return pair_density(l, k, at_l, at_k, options).transpose();
  const auto rows = static_cast<Eigen::Index>(at_k.size()), columns = static_cast<Eigen::Index>(at_l.size());
  Eigen::MatrixXd result(rows, columns);
  if (!is_triangular()) {
    const GaussianMixture mixture(map_, {k, l}, options);
    const Eigen::Matrix2d precision = mixture.covariance.inverse();
    const double scale = std::sqrt(precision.determinant()) / (2 * std::numbers::pi);
    for (Eigen::Index i = 0; i < rows; ++i)
      for (Eigen::Index j = 0; j < columns; ++j) {
        const Eigen::ArrayXd u = at_k[static_cast<std::size_t>(i)] - mixture.mean.col(0).array();
        const Eigen::ArrayXd v = at_l[static_cast<std::size_t>(j)] - mixture.mean.col(1).array();
        result(i, j) = scale * (-0.5 * (precision(0, 0) * u.square() + precision(1, 1) * v.square()) -
                                precision(0, 1) * u * v)
                                   .exp()
                                   .mean();
      }
    return result;
  }
  // z_k at at_k[i] fixes x_k; the variables between k and l are integrated over like those before k.
  const Eigen::MatrixXd points = l == 1 ? Eigen::MatrixXd::Zero(1, 1)
                                        : numerics::sobol_normal_points(options.points, l - 1, options.seed);
  TriangularConditional first(*this, k, options), second(*this, l, options);
  first.set_before(l == 1 ? Eigen::MatrixXd(1, 0) : Eigen::MatrixXd(points.leftCols(k)));
  Eigen::VectorXd reference, density_k, density_l;
  Eigen::MatrixXd before(first.points(), l);
  for (Eigen::Index i = 0; i < rows; ++i) {
    first.evaluate(at_k[static_cast<std::size_t>(i)], reference, density_k);
    if (k > 0) before.leftCols(k) = first.before();
    before.col(k) = reference;
    if (l > k + 1) before.rightCols(l - k - 1) = points.rightCols(l - k - 1);
    second.set_before(before);
    for (Eigen::Index j = 0; j < columns; ++j) {
      second.evaluate(at_l[static_cast<std::size_t>(j)], reference, density_l);
      result(i, j) = density_k.cwiseProduct(density_l).mean();
    }
  }
  return result;
}

}  // namespace knothe::transport
