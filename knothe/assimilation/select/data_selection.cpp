#include "knothe/assimilation/select/data_selection.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/numerics/integrate/sobol.hpp"
#include "knothe/numerics/linear/selected_inverse.hpp"
#include "knothe/numerics/linear/symmetric_eigen.hpp"
#include "knothe/posterior/prior/prior_transform.hpp"

namespace knothe::assimilation {
namespace {

/// log det of a symmetric positive definite matrix of a few rows.
double log_det(Eigen::MatrixXd m) {
  double sum = 0;
  for (Eigen::Index j = 0; j < m.rows(); ++j) {
    const double pivot = m(j, j);
    sum += std::log(pivot);
    for (Eigen::Index i = j + 1; i < m.rows(); ++i) {
      const double factor = m(i, j) / pivot;
      m.row(i).tail(m.cols() - j) -= factor * m.row(j).tail(m.cols() - j);
    }
  }
  return sum;
}

}  // namespace

/// R = M⁻¹ column by column and its diagonal, from one factor of M.
struct SensorDesign::Covariance : numerics::SelectedInverse {
  using SelectedInverse::SelectedInverse;
};

/// The dofs chosen so far: conditional rows and variances of all others.
class SensorDesign::Progress {
 public:
  explicit Progress(const SensorDesign& design)
      : design_(design),
        variance_(design.noise_std_.cwiseAbs2()),
        d_(design.dimension_),
        pairs_(d_ * (d_ + 1) / 2),
        products_(design.rows_.rows(), pairs_ * std::ssize(design.width_)) {
    information_.assign(design.width_.size(), Eigen::MatrixXd::Identity(d_, d_));
    log_det_.assign(information_.size(), 0.0);
    if (design.covariance_) rows_ = design.rows_;
    for_blocks([&](Eigen::Index first, Eigen::Index count) { multiply(first, count); });
  }

  /// Mean over the points of ½ log det(I + F + Σ_t a aᵀ) − ½ log det(I + F), for every dof.
  [[nodiscard]] Eigen::VectorXd gains() const {
    Eigen::VectorXd gain(products_.rows());
    const double scale = 0.5 / information_.size();
    for_blocks([&](Eigen::Index first, Eigen::Index count) {
      Eigen::ArrayXd sum = Eigen::ArrayXd::Zero(count);
      for (std::size_t point = 0; point < information_.size(); ++point) add_log_det(point, first, sum);
      gain.segment(first, count) = scale * sum;
    });
    return gain;
  }

  /// Adds dof k to the selection; returns the information at the first point, without the prior's.
  Eigen::MatrixXd add_dof(Eigen::Index k) {
    const Eigen::MatrixXd& rows = design_.covariance_ ? rows_ : design_.rows_;
    const Eigen::RowVectorXd row = rows.row(k);
    const double variance = variance_[k];
    Eigen::Index first = 0;
    for (std::size_t point = 0; point < information_.size(); ++point) {
      const Eigen::Index q = design_.width_[point];
      const Eigen::Map<const Eigen::MatrixXd> a(row.data() + first, q, d_);
      information_[point].noalias() += a.transpose() * a / variance;
      log_det_[point] = log_det(information_[point]);
      first += d_ * q;
    }
    if (design_.covariance_) condition_on(k, row / std::sqrt(variance), variance);
    return information_[0] - Eigen::MatrixXd::Identity(d_, d_);
  }

 private:
  /// Blocks of dofs whose rows stay in the cache.
  template <class Action>
  void for_blocks(const Action& action) const {
    constexpr Eigen::Index k_block = 256;
    for (Eigen::Index first = 0; first < products_.rows(); first += k_block)
      action(first, std::min(k_block, products_.rows() - first));
  }

  /// Σ_t a aᵀ of the dofs of a block, packed, point by point.
  void multiply(Eigen::Index first, Eigen::Index count) {
    const Eigen::MatrixXd& rows = design_.covariance_ ? rows_ : design_.rows_;
    Eigen::Index column = 0;
    for (std::size_t point = 0; point < information_.size(); ++point) {
      const Eigen::Index q = design_.width_[point];
      for (Eigen::Index a = 0; a < d_; ++a) {
        for (Eigen::Index b = 0; b <= a; ++b) {
          auto entry = products_.col(point * pairs_ + a * (a + 1) / 2 + b).segment(first, count);
          entry = (rows.block(first, column + a * q, count, q).array() *
                   rows.block(first, column + b * q, count, q).array())
                      .rowwise()
                      .sum() /
                  variance_.segment(first, count).array();
        }
      }
      column += d_ * q;
    }
  }

  void add_log_det(std::size_t point, Eigen::Index first, Eigen::ArrayXd& sum) const {
    const auto packed = products_.middleCols(point * pairs_, pairs_).middleRows(first, sum.size());
    const Eigen::MatrixXd& f = information_[point];
    if (d_ == 1) {
      sum += (1 + packed.col(0) / f(0, 0)).log();
    } else if (d_ == 2) {
      sum +=
          ((f(0, 0) + packed.col(0)) * (f(1, 1) + packed.col(2)) - (f(1, 0) + packed.col(1)).square()).log() -
          log_det_[point];
    } else {
      for (Eigen::Index k = 0; k < sum.size(); ++k) {
        Eigen::MatrixXd with = f;
        for (Eigen::Index a = 0; a < d_; ++a) {
          for (Eigen::Index b = 0; b <= a; ++b) {
            with(a, b) += packed(k, a * (a + 1) / 2 + b);
            with(b, a) = with(a, b);
          }
        }
        sum[k] += log_det(std::move(with)) - log_det_[point];
      }
    }
  }

  /// The next column l of the pivoted Cholesky factor of R; rows and variances given dof k.
  void condition_on(Eigen::Index k, const Eigen::RowVectorXd& scaled_row, double variance) {
    Eigen::VectorXd l = design_.covariance_->column(k);
    for (const Eigen::VectorXd& past : factor_) l -= past[k] * past;
    l /= std::sqrt(variance);
    // What rounding leaves of the variance of a dof that is determined by those chosen counts as noise.
    variance_ = (variance_ - l.cwiseAbs2()).cwiseMax(1e-12 * design_.noise_std_.cwiseAbs2());
    for_blocks([&](Eigen::Index first, Eigen::Index count) {
      rows_.middleRows(first, count).noalias() -= l.segment(first, count) * scaled_row;
      multiply(first, count);
    });
    factor_.push_back(std::move(l));
  }

  const SensorDesign& design_;
  Eigen::MatrixXd rows_;  ///< conditional rows, for correlated noise
  Eigen::VectorXd variance_;
  Eigen::Index d_, pairs_;
  Eigen::ArrayXXd products_;                  ///< Σ_t a aᵀ, n × points · pairs
  std::vector<Eigen::MatrixXd> information_;  ///< I + F of each point
  std::vector<double> log_det_;
  std::vector<Eigen::VectorXd> factor_;  ///< columns of the Cholesky factor
};

SensorDesign::SensorDesign(const model::ObservedModel& model, const likelihood::NoiseModel& noise,
                           const Eigen::VectorXd& prior_std, const Eigen::MatrixXd& points,
                           Eigen::Matrix<double, Eigen::Dynamic, 3> positions)
    : dimension_(prior_std.size()), positions_(std::move(positions)) {
  assert(points.rows() >= 1 && points.cols() == dimension_ && positions_.rows() == model.observations());
  if (!noise.measurement().is_complete())
    throw UsageError("data selection: dofs that are not measured at all must be left out beforehand");
  if (!noise.measurement().is_independent())
    covariance_ = std::make_unique<const Covariance>(noise.measurement().precision());
  noise_std_ = covariance_ ? Eigen::VectorXd(covariance_->diagonal().cwiseSqrt())
                           : noise.measurement().standard_deviations();
  for (Eigen::Index i = 0; i < points.rows(); ++i) add_point(model, noise, prior_std, points.row(i));
}

SensorDesign::~SensorDesign() = default;

void SensorDesign::add_point(const model::ObservedModel& model, const likelihood::NoiseModel& noise,
                             const Eigen::VectorXd& prior_std, const Eigen::VectorXd& p) {
  const auto& functions = *model.functions;
  const Eigen::Index d = dimension_, l = model.space.cols(), n_t = std::ssize(model.core);
  model::FunctionBatch batch;
  batch.resize(1, d, functions.count(), 1);
  functions.evaluate(p.transpose(), 1, batch);
  Eigen::MatrixXd stack(l * d, n_t);  // C_t ∂w/∂p_a · std_a, all a below each other
  for (Eigen::Index t = 0; t < n_t; ++t) {
    for (Eigen::Index a = 0; a < d; ++a)
      stack.col(t).segment(a * l, l) = prior_std[a] * (model.core[t] * batch.first[a].row(0).transpose());
  }
  if (noise.shared_reference() > 0) {
    // T^{-1/2} = √((k + 1)/k) (I − c 1 1ᵀ), (1 − c n)² = k/(n + k).
    const double k = noise.shared_reference(), n = n_t;
    const double c = (1 - std::sqrt(k / (n + k))) / n;
    stack =
        std::sqrt((k + 1) / k) * (stack - (c * stack.rowwise().sum()) * Eigen::RowVectorXd::Ones(n_t)).eval();
  }
  if (width_.empty()) {
    const Eigen::MatrixXd gram = model.space.transpose() * noise.measurement().apply(model.space);
    all_.resize(d, d);
    for (Eigen::Index a = 0; a < d; ++a) {
      for (Eigen::Index b = 0; b < d; ++b)
        all_(a, b) = (stack.middleRows(a * l, l).transpose() * gram)
                         .cwiseProduct(stack.middleRows(b * l, l).transpose())
                         .sum();
    }
  }
  // Directions of time in which the rows of dofs can differ, down to 1e-7 of the largest.
  Eigen::VectorXd scale = model.space.colwise().norm().transpose().replicate(d, 1);
  const Eigen::MatrixXd scaled = scale.asDiagonal() * stack;
  const numerics::SymmetricEigen eigen(scaled.transpose() * scaled);
  Eigen::Index q = 1;
  while (q < n_t && eigen.eigenvalues()[n_t - 1 - q] > 1e-14 * eigen.eigenvalues()[n_t - 1]) ++q;
  const Eigen::MatrixXd reduced = stack * eigen.eigenvectors().rightCols(q);
  const Eigen::Index first = rows_.cols();
  rows_.conservativeResize(model.observations(), first + d * q);
  for (Eigen::Index a = 0; a < d; ++a)
    rows_.middleCols(first + a * q, q).noalias() = model.space * reduced.middleRows(a * l, l);
  width_.push_back(q);
}

Selection SensorDesign::choose(std::size_t count, double min_distance) const {
  Selection selection;
  Progress progress(*this);
  std::vector<bool> free(rows_.rows(), true);
  while (selection.dofs.size() < count) {
    const Eigen::VectorXd gain = progress.gains();
    Eigen::Index best = -1;
    for (Eigen::Index k = 0; k < gain.size(); ++k) {
      if (free[k] && (best < 0 || gain[k] > gain[best])) best = k;
    }
    if (best < 0) break;
    free[best] = false;
    if (min_distance > 0) {
      for (Eigen::Index k = 0; k < gain.size(); ++k) {
        if ((positions_.row(k) - positions_.row(best)).norm() < min_distance * (1 - 1e-9)) free[k] = false;
      }
    }
    selection.dofs.push_back(best);
    selection.gain.push_back(gain[best]);
    selection.information.push_back(progress.add_dof(best));
  }
  return selection;
}

Selection SensorDesign::along(const std::vector<Eigen::Index>& order) const {
  Selection selection;
  selection.dofs = order;
  Progress progress(*this);
  Eigen::MatrixXd before = Eigen::MatrixXd::Identity(dimension_, dimension_);
  for (const Eigen::Index k : order) {
    selection.information.push_back(progress.add_dof(k));
    const Eigen::MatrixXd after =
        selection.information.back() + Eigen::MatrixXd::Identity(dimension_, dimension_);
    selection.gain.push_back(0.5 * (log_det(after) - log_det(before)));
    before = after;
  }
  return selection;
}

Eigen::MatrixXd prior_points(const std::vector<posterior::Prior>& priors, Eigen::Index count) {
  const auto d = std::ssize(priors);
  Eigen::MatrixXd z = Eigen::MatrixXd::Zero(count, d);
  if (count > 1) z.bottomRows(count - 1) = numerics::sobol_normal_points(count - 1, d, 1);
  return posterior::PriorTransform(priors).points(z);
}

}  // namespace knothe::assimilation
