#include "knothe/assimilation/verdict/what_if_fit.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <numeric>

namespace knothe::assimilation {
namespace {

using Eigen::Index;

constexpr double k_cauchy = 2.385;  // in standard deviations: 95 % efficient for normal errors
constexpr int k_iterations = 25;
constexpr Index k_descents = 3;  // from the best of the starts

double loss(double square, bool robust) {
  return robust ? k_cauchy * k_cauchy * std::log1p(square / (k_cauchy * k_cauchy)) : square;
}

}  // namespace

struct WhatIfFits::Point {
  Eigen::VectorXd p;
  double factor = 1, shift = 0, misfit = 0;
  Eigen::MatrixXd scores;                // n × m
  std::vector<Eigen::MatrixXd> columns;  // of the prediction, in standard deviations: by p, factor, shift
};

WhatIfFits::WhatIfFits(const model::ObservedModel& model, const ResidualTests& tests,
                       std::span<const likelihood::DatumPointer> data, Eigen::MatrixXd starts)
    : model_(model),
      tests_(tests),
      values_(tests.noise().size(), std::ssize(data)),
      starts_(std::move(starts)) {
  for (std::size_t k = 0; k < data.size(); ++k) {
    values_.col(k) = data[k]->values;
    time_indices_.push_back(data[k]->time_index);
  }
  present_ = (values_.array() == values_.array()).count();
}

/// U C_t w (+ lift) at the data's times + `shift` steps, linear between two times; outside, the first or
/// last.
Eigen::MatrixXd WhatIfFits::at_shifted(const Eigen::VectorXd& w, double shift, bool with_lift,
                                       Eigen::MatrixXd* slope) const {
  const Index m = values_.cols(), last = std::ssize(model_.core) - 1;
  Eigen::MatrixXd low(model_.space.cols(), m), step = Eigen::MatrixXd::Zero(model_.space.cols(), m);
  Eigen::MatrixXd lift_low(values_.rows(), m), lift_step = Eigen::MatrixXd::Zero(values_.rows(), m);
  Eigen::RowVectorXd share = Eigen::RowVectorXd::Zero(m);
  for (Index k = 0; k < m; ++k) {
    const double at = std::clamp<double>(time_indices_[k] + shift, 0, last);
    const Index below = std::min<Index>(at, std::max<Index>(0, last - 1));
    low.col(k) = model_.core[below] * w;
    lift_low.col(k) = model_.lift.col(below);
    if (shift == 0 && slope == nullptr && below == at) continue;
    const Index above = std::min(below + 1, last);
    share[k] = at - below;
    step.col(k) = model_.core[above] * w - low.col(k);
    lift_step.col(k) = model_.lift.col(above) - lift_low.col(k);
  }
  Eigen::MatrixXd result = model_.space * (low + step * share.asDiagonal());
  if (with_lift) result += lift_low + lift_step * share.asDiagonal();
  if (slope != nullptr) *slope = model_.space * step + lift_step;
  return result;
}

Eigen::MatrixXd WhatIfFits::predicted(const Eigen::VectorXd& p) const {
  model::FunctionBatch batch;
  batch.resize(1, p.size(), model_.functions->count(), 0);
  model_.functions->evaluate(p.transpose(), 0, batch);
  return at_shifted(batch.value.row(0).transpose(), 0, true, nullptr);
}

void WhatIfFits::evaluate(const WhatIf& assumption, Point& point, bool derivatives) const {
  const Index d = point.p.size();
  model::FunctionBatch batch;
  batch.resize(1, d, model_.functions->count(), derivatives ? 1 : 0);
  model_.functions->evaluate(point.p.transpose(), derivatives ? 1 : 0, batch);
  Eigen::MatrixXd slope;
  const bool wants_slope = derivatives && assumption.shifted;
  const auto ordered = [&](const Eigen::MatrixXd& y) -> Eigen::MatrixXd {
    if (assumption.order.empty()) return y;
    return y(assumption.order, Eigen::all);
  };
  const Eigen::VectorXd factors = assumption.scaled.size() == 0
                                      ? Eigen::VectorXd::Ones(values_.rows())
                                      : Eigen::VectorXd(assumption.scaled.array() * (point.factor - 1) + 1);
  const Eigen::VectorXd to_scores = factors.cwiseProduct(tests_.inverse_std());
  const Eigen::MatrixXd y =
      ordered(at_shifted(batch.value.row(0).transpose(), point.shift, true, wants_slope ? &slope : nullptr));
  point.scores = tests_.inverse_std().asDiagonal() * values_ - to_scores.asDiagonal() * y;
  point.scores = point.scores.unaryExpr([](double z) { return std::isnan(z) ? 0.0 : z; });
  point.misfit = 0;
  for (const double z : point.scores.reshaped()) point.misfit += loss(z * z, assumption.robust);
  if (!derivatives) return;
  point.columns.clear();
  for (Index a = 0; a < d; ++a)
    point.columns.emplace_back(to_scores.asDiagonal() * ordered(at_shifted(batch.first[a].row(0).transpose(),
                                                                           point.shift, false, nullptr)));
  if (assumption.scaled.size() > 0)
    point.columns.emplace_back(assumption.scaled.cwiseProduct(tests_.inverse_std()).asDiagonal() * y);
  if (assumption.shifted) point.columns.emplace_back(to_scores.asDiagonal() * ordered(slope));
  for (Eigen::MatrixXd& column : point.columns)
    column = (values_.array() == values_.array()).select(column, 0.0);
}

/// The factor that is best at these parameters.
void WhatIfFits::set_best_factor(const WhatIf& assumption, Point& point) const {
  if (assumption.scaled.size() == 0) return;
  const Eigen::VectorXd row = assumption.scaled.cwiseProduct(tests_.inverse_std());
  Eigen::MatrixXd y = row.asDiagonal() * predicted(point.p), d = row.asDiagonal() * values_;
  const auto there = values_.array() == values_.array();
  y = there.select(y, 0.0);
  d = there.select(d, 0.0);
  const double square = y.squaredNorm();
  if (square > 0) point.factor = y.cwiseProduct(d).sum() / square;
}

WhatIfAnswer WhatIfFits::fit(const WhatIf& assumption) const {
  const Index d = starts_.cols();
  const Eigen::VectorXd lower = model_.functions->lower(), upper = model_.functions->upper();
  const double steps = model_.core.size();
  std::vector<double> shifts = {0.0};
  if (assumption.shifted)
    for (const double share : {0.02, 0.05, 0.1, 0.15})
      for (const double sign : {-1.0, 1.0}) shifts.push_back(sign * share * steps);
  std::vector<Point> points;
  for (Index k = 0; k < starts_.rows(); ++k) {
    for (const double shift : shifts) {
      Point point;
      point.p = starts_.row(k).transpose();
      point.shift = shift;
      set_best_factor(assumption, point);
      evaluate(assumption, point, false);
      points.push_back(std::move(point));
    }
  }
  std::sort(points.begin(), points.end(), [](const Point& a, const Point& b) { return a.misfit < b.misfit; });
  if (std::ssize(points) > k_descents) points.resize(k_descents);
  for (Point& point : points) {
    double damping = 1e-3;
    evaluate(assumption, point, true);
    for (int iteration = 0; iteration < k_iterations; ++iteration) {
      const auto size = std::ssize(point.columns);
      Eigen::MatrixXd normal(size, size);
      Eigen::VectorXd gradient(size);
      Eigen::MatrixXd weight = Eigen::MatrixXd::Ones(values_.rows(), values_.cols());
      if (assumption.robust)
        weight = (1 + point.scores.array().square() / (k_cauchy * k_cauchy)).inverse().matrix();
      for (Index a = 0; a < size; ++a) {
        const Eigen::MatrixXd weighted = weight.cwiseProduct(point.columns[a]);
        gradient[a] = weighted.cwiseProduct(point.scores).sum();
        for (Index b = 0; b <= a; ++b)
          normal(a, b) = normal(b, a) = weighted.cwiseProduct(point.columns[b]).sum();
      }
      normal.diagonal().array() *= 1 + damping;
      normal.diagonal().array() += 1e-12 * normal.trace();
      const Eigen::VectorXd move = normal.ldlt().solve(gradient);
      if (!move.allFinite()) break;
      Point next;
      next.p = (point.p + move.head(d)).cwiseMax(lower).cwiseMin(upper);
      Index free = d;
      next.factor = point.factor + (assumption.scaled.size() > 0 ? move[free++] : 0.0);
      next.shift =
          std::clamp(point.shift + (assumption.shifted ? move[free] : 0.0), -0.25 * steps, 0.25 * steps);
      evaluate(assumption, next, true);
      if (next.misfit < point.misfit) {
        const bool settled = point.misfit - next.misfit < 1e-4 * point.misfit;
        point = std::move(next);
        damping = std::max(1e-9, 0.1 * damping);
        if (settled) break;
      } else {
        damping *= 10;
        if (damping > 1e8) break;
      }
    }
  }
  const auto best = std::min_element(points.begin(), points.end(),
                                     [](const Point& a, const Point& b) { return a.misfit < b.misfit; });
  return {best->p, best->factor, best->shift, best->misfit, best->scores};
}

}  // namespace knothe::assimilation
