#include "knothe/posterior/map/composed_map.hpp"

#include <fmt/format.h>

#include <cmath>
#include <type_traits>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/posterior/log_density.hpp"

namespace knothe::posterior {

namespace {

constexpr double k_log_two_pi = 1.83787706640934548356;

/// Derivatives of outer ∘ inner, where `outer` was evaluated at the value of `inner`: the chain rule
///   ∂_a M_i = Σ_m O_im I_ma,   ∂_ab M_i = Σ_m O_im I_m,ab + Σ_mn O_i,mn I_ma I_nb.
void chain(const MapBatch& outer, const MapBatch& inner, int derivatives, MapBatch& out) {
  const Index n = inner.value.rows(), d = inner.value.cols(), packed = d * (d + 1) / 2;
  out.resize(n, d, derivatives);
  out.value = outer.value;
  out.log_determinant = outer.log_determinant + inner.log_determinant;
  if (derivatives >= 1) out.jacobian.setZero();
  if (derivatives >= 2) out.hessian.setZero();
  if (derivatives < 1) return;
  for (Index i = 0; i < d; ++i)
    for (Index m = 0; m < d; ++m) {
      const auto slope = outer.jacobian.col(i * d + m).array();
      for (Index a = 0; a < d; ++a)
        out.jacobian.col(i * d + a).array() += slope * inner.jacobian.col(m * d + a).array();
      if (derivatives < 2) continue;
      for (Index a = 0; a < d; ++a)
        for (Index b = 0; b <= a; ++b) {
          auto entry = out.hessian.col(i * packed + packed_index(a, b)).array();
          entry += slope * inner.hessian.col(m * packed + packed_index(a, b)).array();
          for (Index l = 0; l < d; ++l)
            entry += outer.hessian.col(i * packed + packed_index(m, l)).array() *
                     inner.jacobian.col(m * d + a).array() * inner.jacobian.col(l * d + b).array();
        }
    }
}

}  // namespace

Eigen::VectorXd standard_normal_log_density(const Eigen::Ref<const Eigen::MatrixXd>& points) {
  return (-0.5 * points.rowwise().squaredNorm()).array() - 0.5 * points.cols() * k_log_two_pi;
}

AffineMap AffineMap::identity(Index d) {
  return {Eigen::VectorXd::Zero(d), Eigen::MatrixXd::Identity(d, d), {}};
}

void AffineMap::evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives,
                         MapBatch& out) const {
  const Index n = points.rows(), d = dimension();
  const Eigen::MatrixXd a = matrix();
  out.resize(n, d, derivatives);
  for (Index i = 0; i < d; ++i) {
    out.value.col(i).setConstant(shift[i]);
    for (Index j = 0; j < d; ++j)
      if (a(i, j) != 0) out.value.col(i) += a(i, j) * points.col(j);
  }
  out.log_determinant.setConstant(log_determinant());
  if (derivatives >= 1)
    for (Index i = 0; i < d; ++i)
      for (Index j = 0; j < d; ++j) out.jacobian.col(i * d + j).setConstant(a(i, j));
  if (derivatives >= 2) out.hessian.setZero();
}

Eigen::MatrixXd AffineMap::inverse(const Eigen::Ref<const Eigen::MatrixXd>& z) const {
  Eigen::MatrixXd x = (z.rowwise() - shift.transpose()).transpose();
  if (!is_triangular()) x = rotation.transpose() * x;
  lower.triangularView<Eigen::Lower>().solveInPlace(x);
  return x.transpose();
}

std::string AffineMap::describe() const {
  if (dimension() == 0) return "affine map of 0 variables\n";
  return fmt::format(
      "affine{}: shift from {:.4g} to {:.4g}, diagonal from {:.4g} to {:.4g}, log det {:.4g}\n",
      is_triangular() ? "" : ", rotated", shift.minCoeff(), shift.maxCoeff(), lower.diagonal().minCoeff(),
      lower.diagonal().maxCoeff(), log_determinant());
}

void ComposedMap::append(Part part) {
  const Index d = std::visit([](const auto& map) { return map.dimension(); }, part);
  if (d != dimension_)
    throw UsageError(fmt::format("composed map in {} dimensions: the map to append has {}", dimension_, d));
  parts_.push_back(std::move(part));
}

void ComposedMap::evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives,
                           MapBatch& out) const {
  AffineMap::identity(dimension_).evaluate(points, derivatives, out);
  MapBatch outer, composed;
  for (std::size_t k = parts_.size(); k-- > 0;) {
    std::visit([&](const auto& map) { map.evaluate(out.value, derivatives, outer); }, parts_[k]);
    chain(outer, out, derivatives, composed);
    std::swap(out, composed);
  }
}

Eigen::MatrixXd ComposedMap::evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points) const {
  MapBatch batch;
  evaluate(points, 0, batch);
  return std::move(batch.value);
}

Eigen::MatrixXd ComposedMap::inverse(const Eigen::Ref<const Eigen::MatrixXd>& z) const {
  Eigen::MatrixXd x = z;
  for (const Part& part : parts_) x = std::visit([&](const auto& map) { return map.inverse(x); }, part);
  return x;
}

Eigen::VectorXd ComposedMap::log_density(const Eigen::Ref<const Eigen::MatrixXd>& z) const {
  const Eigen::MatrixXd x = inverse(z);
  MapBatch batch;
  evaluate(x, 0, batch);
  // A slope of zero (log det = −∞) would be an infinite density; that set has no mass, and no finite answer
  // helps there.
  return (batch.log_determinant.array() > -1e300)
      .select(standard_normal_log_density(x) - batch.log_determinant,
              -std::numeric_limits<double>::infinity());
}

std::string ComposedMap::describe() const {
  if (parts_.empty()) return fmt::format("identity of {} variables\n", dimension_);
  std::string text = fmt::format("map of {} variables, {} part{}, the first to act first\n", dimension_,
                                 parts_.size(), parts_.size() == 1 ? "" : "s");
  for (std::size_t k = parts_.size(); k-- > 0;) {
    text += fmt::format("part {}: ", parts_.size() - k);
    text += std::visit(
        [](const auto& map) {
          if constexpr (std::is_same_v<std::decay_t<decltype(map)>, TriangularMap>)
            return fmt::format("triangular of order {}, {} coefficients\n", map.order(),
                               map.coefficients().size()) +
                   map.describe();
          else
            return map.describe();
        },
        parts_[k]);
  }
  return text;
}

}  // namespace knothe::posterior
