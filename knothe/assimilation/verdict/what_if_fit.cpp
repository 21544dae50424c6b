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
  double factor = 1, misfit = 0;
  Eigen::VectorXd shifts;
  Eigen::MatrixXd scores;                // n × m
  std::vector<Eigen::MatrixXd> columns;  // of the prediction, in standard deviations: by p, factor, shifts
  Eigen::VectorXd factors, response;
};

WhatIfFits::WhatIfFits(const model::ObservedModel& model, const ResidualTests& tests,
                       std::span<const likelihood::DatumPointer> data, Eigen::MatrixXd starts)
    : model_(&model), tests_(&tests), starts_(std::move(starts)) {
  Eigen::MatrixXd values(tests.noise().size(), std::ssize(data));
  for (std::size_t k = 0; k < data.size(); ++k) {
    values.col(k) = data[k]->values;
    time_indices_.push_back(data[k]->time_index);
  }
  set_values(std::move(values));
}

void WhatIfFits::set_values(Eigen::MatrixXd values) {
  values_ = std::move(values);
  const auto is_there = values_.array() == values_.array();
  there_ = is_there.select(tests_->inverse_std().replicate(1, values_.cols()), 0.0);
  scaled_ = is_there.select(values_, 0.0).cwiseProduct(there_);
  present_ = is_there.count();
}

WhatIfFits WhatIfFits::with(const Eigen::MatrixXd& values) const {
  WhatIfFits others = *this;
  others.set_values(values);
  return others;
}

/// U C_t w (+ lift) at the data's times + `shift` steps (m, or empty: none), linear between two times;
/// outside, the first or last.
Eigen::MatrixXd WhatIfFits::at_shifted(const Eigen::VectorXd& w, const Eigen::VectorXd& shift, bool with_lift,
                                       Eigen::MatrixXd* slope) const {
  const Index m = values_.cols(), last = std::ssize(model_->core) - 1;
  Eigen::MatrixXd low(model_->space.cols(), m), step = Eigen::MatrixXd::Zero(model_->space.cols(), m);
  Eigen::MatrixXd lift_low(values_.rows(), m), lift_step = Eigen::MatrixXd::Zero(values_.rows(), m);
  Eigen::RowVectorXd share = Eigen::RowVectorXd::Zero(m);
  for (Index k = 0; k < m; ++k) {
    const double moved = shift.size() > 0 ? shift[k] : 0.0;
    const double at = std::clamp<double>(time_indices_[k] + moved, 0, last);
    const Index below = std::min<Index>(at, std::max<Index>(0, last - 1));
    low.col(k) = model_->core[below] * w;
    lift_low.col(k) = model_->lift.col(below);
    if (moved == 0 && slope == nullptr && below == at) continue;
    const Index above = std::min(below + 1, last);
    share[k] = at - below;
    step.col(k) = model_->core[above] * w - low.col(k);
    lift_step.col(k) = model_->lift.col(above) - lift_low.col(k);
  }
  Eigen::MatrixXd result = model_->space * (low + step * share.asDiagonal());
  if (with_lift) result += lift_low + lift_step * share.asDiagonal();
  if (slope != nullptr) *slope = model_->space * step + lift_step;
  return result;
}

Eigen::MatrixXd WhatIfFits::predicted(const Eigen::VectorXd& p) const {
  model::FunctionBatch batch;
  batch.resize(1, p.size(), model_->functions->count(), 0);
  model_->functions->evaluate(p.transpose(), 0, batch);
  return at_shifted(batch.value.row(0).transpose(), {}, true, nullptr);
}

void WhatIfFits::evaluate(const WhatIf& assumption, Point& point, bool derivatives) const {
  const Index d = point.p.size(), q = assumption.delays.cols();
  model::FunctionBatch batch;
  batch.resize(1, d, model_->functions->count(), derivatives ? 1 : 0);
  model_->functions->evaluate(point.p.transpose(), derivatives ? 1 : 0, batch);
  const Eigen::VectorXd shift = q > 0 ? Eigen::VectorXd(assumption.delays * point.shifts) : Eigen::VectorXd();
  // In standard deviations, of the sensors in their order; 0 where nothing is measured.
  const auto scores_of = [&](Eigen::MatrixXd y) -> Eigen::MatrixXd {
    if (assumption.smoothing.size() > 0) y *= assumption.smoothing;
    if (assumption.order.empty()) return there_.cwiseProduct(y);
    return there_.cwiseProduct(Eigen::MatrixXd(y(assumption.order, Eigen::all)));
  };
  const Eigen::VectorXd factors = assumption.scaled.size() == 0
                                      ? Eigen::VectorXd::Ones(values_.rows())
                                      : Eigen::VectorXd(assumption.scaled.array() * (point.factor - 1) + 1);
  Eigen::MatrixXd slope;
  const Eigen::MatrixXd y = scores_of(
      at_shifted(batch.value.row(0).transpose(), shift, true, derivatives && q > 0 ? &slope : nullptr));
  point.scores = scaled_ - factors.asDiagonal() * y;
  point.columns.clear();
  if (derivatives) {
    for (Index a = 0; a < d; ++a)
      point.columns.emplace_back(
          factors.asDiagonal() *
          scores_of(at_shifted(batch.first[a].row(0).transpose(), shift, false, nullptr)));
    if (assumption.scaled.size() > 0) point.columns.emplace_back(assumption.scaled.asDiagonal() * y);
    if (q > 0) slope = factors.asDiagonal() * scores_of(slope);
    for (Index j = 0; j < q; ++j) point.columns.emplace_back(slope * assumption.delays.col(j).asDiagonal());
  }
  if (assumption.offsets || assumption.own_factors) eliminate(assumption, y, point);
  point.misfit = 0;
  for (const double z : point.scores.reshaped()) point.misfit += loss(z * z, assumption.robust);
}

/// The factor and the constant of each sensor that are best here, and what is left: they are linear, so their
/// directions are projected out of scores and columns (variable projection; Kaufman, BIT 15, 1975).
void WhatIfFits::eliminate(const WhatIf& assumption, const Eigen::MatrixXd& y, Point& point) const {
  Eigen::MatrixXd direction = y;
  point.factors = Eigen::VectorXd::Ones(y.rows());
  if (assumption.offsets) {
    const Eigen::VectorXd squares = there_.rowwise().squaredNorm().cwiseMax(1e-300);
    const auto centre = [&](Eigen::MatrixXd& rows) {
      const Eigen::VectorXd mean = rows.cwiseProduct(there_).rowwise().sum().cwiseQuotient(squares);
      rows -= mean.asDiagonal() * there_;
    };
    centre(point.scores);
    centre(direction);
    for (Eigen::MatrixXd& column : point.columns) centre(column);
  }
  point.response = direction.rowwise().squaredNorm();
  if (!assumption.own_factors) return;
  const Eigen::VectorXd squares = point.response.cwiseMax(1e-300);
  const auto along = [&](const Eigen::MatrixXd& rows) -> Eigen::VectorXd {
    return rows.cwiseProduct(direction).rowwise().sum().cwiseQuotient(squares);
  };
  const Eigen::VectorXd more = along(point.scores);
  point.factors += more;
  point.scores -= more.asDiagonal() * direction;
  for (Eigen::MatrixXd& column : point.columns) {
    column = point.factors.asDiagonal() * column;
    column -= along(column).asDiagonal() * direction;
  }
}

/// The factor that is best at these parameters.
void WhatIfFits::set_best_factor(const WhatIf& assumption, Point& point) const {
  if (assumption.scaled.size() == 0) return;
  const Eigen::MatrixXd y = assumption.scaled.asDiagonal() * there_.cwiseProduct(predicted(point.p));
  const double square = y.squaredNorm();
  if (square > 0) point.factor = y.cwiseProduct(scaled_).sum() / square;
}

/// Levenberg and Marquardt's steps to a minimum.
void WhatIfFits::descend(const WhatIf& assumption, Point& point) const {
  const Index d = point.p.size(), q = assumption.delays.cols();
  const Eigen::VectorXd lower = model_->functions->lower(), upper = model_->functions->upper();
  const double farthest = 0.25 * model_->core.size();
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
    next.factor = point.factor + (assumption.scaled.size() > 0 ? move[d] : 0.0);
    next.shifts = (point.shifts + move.tail(q)).cwiseMax(-farthest).cwiseMin(farthest);
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

WhatIfAnswer WhatIfFits::fit(const WhatIf& assumption) const {
  const Index q = assumption.delays.cols();
  const double steps = model_->core.size();
  std::vector<double> shifts = {0.0};
  if (q == 1)
    for (const double share : {0.02, 0.05, 0.1, 0.15})
      for (const double sign : {-1.0, 1.0}) shifts.push_back(sign * share * steps);
  std::vector<Point> points;
  for (Index k = 0; k < starts_.rows(); ++k) {
    for (const double shift : shifts) {
      Point point;
      point.p = starts_.row(k).transpose();
      point.shifts = Eigen::VectorXd::Constant(q, shift);
      set_best_factor(assumption, point);
      evaluate(assumption, point, false);
      points.push_back(std::move(point));
    }
  }
  std::sort(points.begin(), points.end(), [](const Point& a, const Point& b) { return a.misfit < b.misfit; });
  if (std::ssize(points) > k_descents) points.resize(k_descents);
  for (Point& point : points) descend(assumption, point);
  const auto best = std::min_element(points.begin(), points.end(),
                                     [](const Point& a, const Point& b) { return a.misfit < b.misfit; });
  return {best->p, best->factor, best->shifts, best->misfit, best->scores, best->factors, best->response};
}

WhatIfAnswer WhatIfFits::fit_from(const WhatIf& assumption, const Eigen::VectorXd& p,
                                  const Eigen::VectorXd& shifts) const {
  Point point;
  point.p = p;
  point.shifts = shifts;
  set_best_factor(assumption, point);
  descend(assumption, point);
  return {point.p, point.factor, point.shifts, point.misfit, point.scores, point.factors, point.response};
}

Eigen::MatrixXd WhatIfFits::scores_at(const WhatIf& assumption, const Eigen::VectorXd& p,
                                      const Eigen::VectorXd& shifts) const {
  Point point;
  point.p = p;
  point.shifts = shifts;
  evaluate(assumption, point, false);
  return point.scores;
}

}  // namespace knothe::assimilation
