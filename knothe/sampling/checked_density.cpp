#include "knothe/sampling/checked_density.hpp"

#include <fmt/format.h>

#include <cmath>
#include <limits>

#include "knothe/base/error.hpp"

namespace knothe::sampling {

namespace {

std::string describe_point(const Eigen::Ref<const Eigen::MatrixXd>& points, Eigen::Index i) {
  std::string text = "z = (";
  for (Eigen::Index k = 0; k < points.cols(); ++k)
    text += fmt::format("{}{}", k > 0 ? ", " : "", points(i, k));
  return text + ")";
}

/// Sums propagate what is not finite, and are quick.
template <class Matrix>
bool is_finite(const Matrix& m) {
  return std::isfinite(m.sum()) || m.allFinite();
}

double finite_or_zero(double x) {
  return std::isfinite(x) ? x : 0.0;
}

}  // namespace

void CheckedDensity::check(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives,
                           const LogDensityBatch& out) const {
  constexpr double k_infinity = std::numeric_limits<double>::infinity();
  if (!std::isfinite(out.value.sum()))
    for (Eigen::Index i = 0; i < points.rows(); ++i)
      if (std::isnan(out.value[i]) || out.value[i] == k_infinity)
        throw NumericalError(
            fmt::format("the log-density is {} at {}; it must be a number, or -inf where the density is zero",
                        out.value[i], describe_point(points, i)));
  const auto complain = [&](const char* what, const Eigen::MatrixXd& values) {
    for (Eigen::Index i = 0; i < points.rows(); ++i)
      if (!values.row(i).allFinite())
        throw NumericalError(
            fmt::format("the {} of the log-density is not finite at {}; it must be finite everywhere", what,
                        describe_point(points, i)));
  };
  if (derivatives >= 1 && !is_finite(out.gradient)) complain("gradient", out.gradient);
  if (derivatives >= 2 && !is_finite(out.hessian)) complain("Hessian", out.hessian);
}

void CheckedDensity::evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives,
                              LogDensityBatch& out) {
  out.resize(points.rows(), points.cols(), derivatives);
  constexpr double k_poison = std::numeric_limits<double>::quiet_NaN();
  out.value.setConstant(k_poison);
  if (derivatives >= 1) out.gradient.setConstant(k_poison);
  if (derivatives >= 2) out.hessian.setConstant(k_poison);
  target_->evaluate(points, derivatives, out);
  evaluations_ += points.rows();
  check(points, derivatives, out);
}

void CheckedDensity::evaluate_with_differences(const Eigen::Ref<const Eigen::MatrixXd>& points,
                                               int derivatives, LogDensityBatch& out) {
  const int own = std::min(derivatives, available_derivatives());
  evaluate(points, own, out);
  if (own == derivatives) return;
  const Eigen::Index n = points.rows(), d = points.cols();
  out.resize(n, d, derivatives);
  const double step = own == 1 ? 1e-5 : 2e-4;  // balances truncation against rounding
  const auto at = [&](Eigen::Index a, double s, Eigen::Index b, double t) {
    shifted_points_ = points;
    shifted_points_.col(a).array() += s;
    if (b >= 0) shifted_points_.col(b).array() += t;
    evaluate(shifted_points_, own, shifted_);
  };
  if (own == 1) {
    Eigen::MatrixXd difference(n, d);
    for (Eigen::Index a = 0; a < d; ++a) {
      at(a, step, -1, 0);
      difference = shifted_.gradient;
      at(a, -step, -1, 0);
      difference -= shifted_.gradient;
      // Column a of the Hessian; entries met twice are averaged.
      for (Eigen::Index b = 0; b < d; ++b) {
        const auto half = difference.col(b) / (2 * step);
        auto entry = out.hessian.col(packed_index(a, b));
        if (b > a || b == a)
          entry = half;
        else
          entry = 0.5 * (entry + half);
      }
    }
    return;
  }
  Eigen::MatrixXd up(n, d), down(n, d);
  for (Eigen::Index a = 0; a < d; ++a) {
    at(a, step, -1, 0);
    up.col(a) = shifted_.value;
    at(a, -step, -1, 0);
    down.col(a) = shifted_.value;
    out.gradient.col(a) = ((up.col(a) - down.col(a)) / (2 * step)).unaryExpr(&finite_or_zero);
  }
  if (derivatives < 2) return;
  for (Eigen::Index a = 0; a < d; ++a) {
    out.hessian.col(packed_index(a, a)) =
        ((up.col(a) - 2 * out.value + down.col(a)) / (step * step)).unaryExpr(&finite_or_zero);
    for (Eigen::Index b = 0; b < a; ++b) {
      at(a, step, b, step);
      Eigen::VectorXd mixed = shifted_.value;
      at(a, -step, b, -step);
      mixed += shifted_.value - up.col(a) - up.col(b) - down.col(a) - down.col(b) + 2 * out.value;
      out.hessian.col(packed_index(a, b)) = (mixed / (2 * step * step)).unaryExpr(&finite_or_zero);
    }
  }
}

}  // namespace knothe::sampling
