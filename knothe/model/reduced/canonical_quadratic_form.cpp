#include "knothe/model/reduced/canonical_quadratic_form.hpp"

#include <cassert>

#include "knothe/base/index.hpp"
#include "knothe/model/reduced/spline_contraction.hpp"

namespace knothe::model {

void CanonicalQuadraticForm::set(const Eigen::Ref<const Eigen::MatrixXd>& a,
                                 const Eigen::Ref<const Eigen::VectorXd>& b,
                                 const Eigen::Ref<const Eigen::VectorXd>& c, double constant) {
  generic_->set(a, b, c, constant);
  a_.resize(a.rows() + 1, a.cols());
  a_.topRows(a.rows()) = a;
  a_.bottomRows(1) = c.transpose();
  b_ = b;
  constant_ = constant;
}

void CanonicalQuadraticForm::set_grid(const Eigen::Ref<const Eigen::MatrixXd>& axes) {
  assert(has_grid() && axes.cols() == dimension_);
  count_ = axes.rows();
  outer_.clear();
  for (Index i = 0; i + 1 < dimension_; ++i) outer_.push_back(axis_values_(i, axes.col(i)));
  const RowMatrix last = axis_values_(dimension_ - 1, axes.col(dimension_ - 1));
  last_.setZero(last.cols(), count_ + k_lane_count);
  last_.leftCols(count_) = last.transpose();
}

void CanonicalQuadraticForm::set_row(Index row) {
  product_.setOnes(a_.cols());
  for (std::size_t i = outer_.size(); i-- > 0; row /= count_)
    product_.array() *= outer_[i].row(row % count_).transpose().array();
  of_row_ = a_ * product_.asDiagonal();
}

void CanonicalQuadraticForm::evaluate_runs(std::span<const numerics::GridRun> runs,
                                           Eigen::Ref<Eigen::VectorXd> value) {
  const Index k = b_.size(), r = a_.cols(), stride = last_.cols();
  Index row = -1;
  for (const numerics::GridRun& run : runs) {
    if (run.row != row) set_row(row = run.row);
    for (Index i = run.begin; i < run.end; i += k_lane_count) {
      const auto sum = [&](Index m) {
        Lanes s{};
        const double* factor = of_row_.data() + m * r;
        const double* alpha = last_.data() + i;
        for (Index f = 0; f < r; ++f) s += factor[f] * load(alpha + f * stride);
        return s;
      };
      Lanes squares{};
      for (Index m = 0; m < k; ++m) {
        const Lanes s = b_[m] + sum(m);
        squares += s * s;
      }
      store(value.data() + run.at + (i - run.begin), constant_ + sum(k) - 0.5 * squares, run.end - i);
    }
  }
}

}  // namespace knothe::model
