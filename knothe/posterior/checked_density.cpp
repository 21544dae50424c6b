#include "knothe/posterior/checked_density.hpp"

#include <fmt/format.h>

#include <cmath>
#include <limits>

#include "knothe/base/cancellation.hpp"
#include "knothe/base/error.hpp"

namespace knothe::posterior {

namespace {

std::string describe_point(const Eigen::Ref<const Eigen::MatrixXd>& points, Eigen::Index i) {
  std::string text = "z = (";
  for (Eigen::Index k = 0; k < points.cols(); ++k)
    text += fmt::format("{}{}", k > 0 ? ", " : "", points(i, k));
  return text + ")";
}

/// A target may write into the buffers but not replace them.
void require_sizes(Eigen::Index n, Eigen::Index d, int derivatives, const LogDensityBatch& out) {
  const auto complain = [&](const char* what, Eigen::Index rows, Eigen::Index columns, Eigen::Index wanted) {
    throw UsageError(fmt::format(
        "the log-density was given a buffer for its {} of {} × {} and handed back {} × {}; it must fill the "
        "buffers it is given and leave their sizes alone",
        what, n, wanted, rows, columns));
  };
  if (out.value.size() != n) complain("values", out.value.size(), 1, 1);
  if (derivatives >= 1 && (out.gradient.rows() != n || out.gradient.cols() != d))
    complain("gradient", out.gradient.rows(), out.gradient.cols(), d);
  if (derivatives >= 2 && (out.hessian.rows() != n || out.hessian.cols() != d * (d + 1) / 2))
    complain("Hessian", out.hessian.rows(), out.hessian.cols(), d * (d + 1) / 2);
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
            fmt::format("the {} of the log-density is not finite at {}; it must be finite wherever the "
                        "density is not zero",
                        what, describe_point(points, i)));
  };
  if (derivatives >= 1 && !is_finite(out.gradient)) complain("gradient", out.gradient);
  if (derivatives >= 2 && !is_finite(out.hessian)) complain("Hessian", out.hessian);
}

void CheckedDensity::excuse(int derivatives, LogDensityBatch& out) const {
  bool fine = std::isfinite(out.value.sum());
  if (derivatives >= 1) fine = fine && is_finite(out.gradient);
  if (derivatives >= 2) fine = fine && is_finite(out.hessian);
  if (fine) return;
  for (Eigen::Index i = 0; i < out.value.size(); ++i) {
    const bool finite = std::isfinite(out.value[i]) && (derivatives < 1 || out.gradient.row(i).allFinite()) &&
                        (derivatives < 2 || out.hessian.row(i).allFinite());
    if (finite || !(lenient_ || out.value[i] < k_min_log_density)) continue;
    out.value[i] = -std::numeric_limits<double>::infinity();
    if (derivatives >= 1) out.gradient.row(i).setZero();
    if (derivatives >= 2) out.hessian.row(i).setZero();
  }
}

void CheckedDensity::evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives,
                              LogDensityBatch& out) {
  check_cancellation("the posterior is not computed");
  out.resize(points.rows(), points.cols(), derivatives);
  constexpr double k_poison = std::numeric_limits<double>::quiet_NaN();
  out.value.setConstant(k_poison);
  if (derivatives >= 1) out.gradient.setConstant(k_poison);
  if (derivatives >= 2) out.hessian.setConstant(k_poison);
  target_->evaluate(points, derivatives, out);
  evaluations_ += points.rows();
  require_sizes(points.rows(), points.cols(), derivatives, out);
  excuse(derivatives, out);
  check(points, derivatives, out);
}

void CheckedDensity::evaluate_with_differences(const Eigen::Ref<const Eigen::MatrixXd>& points,
                                               int derivatives,
                                               const Eigen::Ref<const Eigen::MatrixXd>& scales,
                                               LogDensityBatch& out) {
  const int own = std::min(derivatives, available_derivatives());
  evaluate(points, own, out);
  if (own == derivatives) return;
  const Eigen::Index n = points.rows(), d = points.cols();
  out.resize(n, d, derivatives);
  // These steps balance truncation against rounding. A step is the difference of two numbers that exist.
  steps_ = (own == 1 ? k_gradient_step : k_value_step) * scales;
  steps_ = (points + steps_) - points;
  for (Eigen::Index a = 0; a < d; ++a)
    for (Eigen::Index i = 0; i < n; ++i)
      if (steps_(i, a) == 0)
        steps_(i, a) = 4 * std::numeric_limits<double>::epsilon() * std::max(std::abs(points(i, a)), 1e-290);
  const auto at = [&](Eigen::Index a, double s, Eigen::Index b, double t) {
    shifted_points_ = points;
    shifted_points_.col(a) += s * steps_.col(a);
    if (b >= 0) shifted_points_.col(b) += t * steps_.col(b);
    evaluate(shifted_points_, own, shifted_);
  };
  if (own == 1) {
    Eigen::MatrixXd difference(n, d);
    for (Eigen::Index a = 0; a < d; ++a) {
      at(a, 1, -1, 0);
      difference = shifted_.gradient;
      at(a, -1, -1, 0);
      difference -= shifted_.gradient;
      // Column a of the Hessian; entries met twice are averaged.
      for (Eigen::Index b = 0; b < d; ++b) {
        const Eigen::VectorXd entry =
            (difference.col(b).array() / (2 * steps_.col(a).array())).unaryExpr(&finite_or_zero);
        auto mean = out.hessian.col(packed_index(a, b));
        if (b >= a)
          mean = entry;
        else
          mean = 0.5 * (mean + entry);
      }
    }
    return;
  }
  Eigen::MatrixXd up(n, d), down(n, d);
  for (Eigen::Index a = 0; a < d; ++a) {
    at(a, 1, -1, 0);
    up.col(a) = shifted_.value;
    at(a, -1, -1, 0);
    down.col(a) = shifted_.value;
    out.gradient.col(a) =
        ((up.col(a) - down.col(a)).array() / (2 * steps_.col(a).array())).unaryExpr(&finite_or_zero);
  }
  if (derivatives < 2) return;
  for (Eigen::Index a = 0; a < d; ++a) {
    out.hessian.col(packed_index(a, a)) =
        ((up.col(a) - 2 * out.value + down.col(a)).array() / steps_.col(a).array().square())
            .unaryExpr(&finite_or_zero);
    for (Eigen::Index b = 0; b < a; ++b) {
      at(a, 1, b, 1);
      Eigen::VectorXd mixed = shifted_.value;
      at(a, -1, b, -1);
      mixed += shifted_.value - up.col(a) - up.col(b) - down.col(a) - down.col(b) + 2 * out.value;
      out.hessian.col(packed_index(a, b)) =
          (mixed.array() / (2 * steps_.col(a).array() * steps_.col(b).array())).unaryExpr(&finite_or_zero);
    }
  }
}

}  // namespace knothe::posterior
