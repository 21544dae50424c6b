#include "knothe/model/reduced/spline_functions.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/model/reduced/canonical_quadratic_form.hpp"
#include "knothe/model/reduced/joint_quadratic_form.hpp"
#include "knothe/model/reduced/spline_contraction.hpp"
#include "knothe/model/reduced/tensor_product.hpp"

namespace knothe::model {

namespace {

using Local = numerics::CubicSplineBasis::Local;

/// What the contraction of one point needs.
struct PointTask {
  const double* coefficients;
  const Local* local;
  const std::ptrdiff_t* strides;
  const int* active;
  Index row;
  Index count;
};

template <std::size_t D, int Derivatives>
void evaluate_point(const PointTask& task, FunctionBatch& out) {
  for (Index k = 0; k < task.count; k += k_lane_count) {
    const auto jet = contract<D, Derivatives>(task.coefficients + k, task.local, task.strides, task.active);
    const Index n = task.count - k;
    store(&out.value(task.row, k), jet.value, n);
    if constexpr (Derivatives >= 1) {
      for (std::size_t a = 0; a < D; ++a) store(&out.first[a](task.row, k), jet.first[a], n);
    }
    if constexpr (Derivatives >= 2) {
      for (Index ab = 0; ab < std::ssize(jet.second); ++ab)
        store(&out.second[ab](task.row, k), jet.second[ab], n);
    }
  }
}

using PointEvaluator = void (*)(const PointTask&, FunctionBatch&);

template <int Derivatives>
constexpr std::array<PointEvaluator, JointFunctions::k_max_parameters> k_evaluators = {
    evaluate_point<1, Derivatives>, evaluate_point<2, Derivatives>, evaluate_point<3, Derivatives>,
    evaluate_point<4, Derivatives>, evaluate_point<5, Derivatives>, evaluate_point<6, Derivatives>,
    evaluate_point<7, Derivatives>, evaluate_point<8, Derivatives>};

/// Room for one entry per axis; on the stack for up to eight axes.
template <class T>
class Workspace {
 public:
  std::span<T> first(std::size_t n) {
    if (n <= few_.size()) return std::span<T>(few_).first(n);
    many_.resize(n);
    return many_;
  }

 private:
  std::array<T, 8> few_;
  std::vector<T> many_;
};

}  // namespace

SplineFunctions::SplineFunctions(std::span<const std::vector<double>> nodes, Index count)
    : count_(count), padded_(round_up_to_lanes(count)) {
  for (const auto& axis : nodes) axes_.emplace_back(bases_.emplace_back(axis));
}

Eigen::VectorXd SplineFunctions::lower() const {
  Eigen::VectorXd corner(dimension());
  for (Index i = 0; i < dimension(); ++i) corner[i] = bases_[i].nodes().front();
  return corner;
}

Eigen::VectorXd SplineFunctions::upper() const {
  Eigen::VectorXd corner(dimension());
  for (Index i = 0; i < dimension(); ++i) corner[i] = bases_[i].nodes().back();
  return corner;
}

template <int Derivatives>
void SplineFunctions::localise(const Eigen::Ref<const Eigen::MatrixXd>& points, Index row,
                               std::span<Local> local) const {
  for (Index i = 0; i < std::ssize(axes_); ++i)
    axes_[i].evaluate<Derivatives>(axes_[i].locate(points(row, i)), local[i]);
}

CanonicalFunctions::CanonicalFunctions(std::span<const std::vector<double>> nodes,
                                       std::span<const std::vector<double>> values, Index count)
    : SplineFunctions(nodes, count) {
  assert(values.size() == bases_.size());
  for (Index i = 0; i < std::ssize(bases_); ++i) {
    const Index n = bases_[i].size();
    const Eigen::Map<const RowMatrix> at_nodes(values[i].data(), count, n);
    const RowMatrix fitted = bases_[i].coefficients_from_values() * at_nodes.transpose();
    auto& stored = coefficients_.emplace_back((n + 3) * padded_, 0.0);
    Eigen::Map<RowMatrix>(stored.data(), n + 3, padded_).topLeftCorner(n, count) = fitted;
  }
}

void CanonicalFunctions::evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives,
                                  FunctionBatch& out) const {
  if (derivatives == 0) return evaluate_all<0>(points, out);
  if (derivatives == 1) return evaluate_all<1>(points, out);
  evaluate_all<2>(points, out);
}

template <int Derivatives>
void CanonicalFunctions::evaluate_all(const Eigen::Ref<const Eigen::MatrixXd>& points,
                                      FunctionBatch& out) const {
  const std::size_t d = bases_.size();
  Workspace<Local> local_space;
  Workspace<std::array<Lanes, Derivatives + 1>> factor_space;
  const auto local = local_space.first(d);
  const auto factor = factor_space.first(d);  // α, α', α'' of every axis
  for (Index row = 0; row < points.rows(); ++row) {
    localise<Derivatives>(points, row, local);
    for (Index k = 0; k < count_; k += k_lane_count) {
      const Index n = count_ - k;
      if constexpr (Derivatives == 0) {
        Lanes product = Lanes{} + 1.0;
        for (std::size_t i = 0; i < d; ++i) {
          const double* c = coefficients_[i].data() + local[i].first * padded_ + k;
          product *= (local[i].value[0] * load(c) + local[i].value[1] * load(c + padded_)) +
                     (local[i].value[2] * load(c + 2 * padded_) + local[i].value[3] * load(c + 3 * padded_));
        }
        store(&out.value(row, k), product, n);
        continue;
      }
      for (std::size_t i = 0; i < d; ++i) {
        const double* c = coefficients_[i].data() + local[i].first * padded_ + k;
        factor[i] = {};
        for (std::size_t f = 0; f < 4; ++f) {
          const Lanes lanes = load(c + f * padded_);
          factor[i][0] += local[i].value[f] * lanes;
          if constexpr (Derivatives >= 1) factor[i][1] += local[i].first_derivative[f] * lanes;
          if constexpr (Derivatives >= 2) factor[i][2] += local[i].second_derivative[f] * lanes;
        }
      }
      // Π_i of the axes' derivatives of orders (1 if i = a) + (1 if i = b).
      const auto product = [&](std::size_t a, std::size_t b) {
        Lanes result = factor[0][(a == 0) + (b == 0)];
        for (std::size_t i = 1; i < d; ++i) result *= factor[i][(a == i) + (b == i)];
        return result;
      };
      store(&out.value(row, k), product(d, d), n);
      for (std::size_t a = 0; Derivatives >= 1 && a < d; ++a) {
        store(&out.first[a](row, k), product(a, d), n);
        for (std::size_t b = 0; Derivatives >= 2 && b <= a; ++b) {
          store(&out.second[packed(a, b)](row, k), product(a, b), n);
        }
      }
    }
  }
}

RowMatrix CanonicalFunctions::axis_values(std::size_t axis,
                                          const Eigen::Ref<const Eigen::VectorXd>& nodes) const {
  RowMatrix values = RowMatrix::Zero(nodes.size(), count_);
  const auto ends = bases_[axis].nodes();
  for (Index j = 0; j < nodes.size(); ++j) {
    const Local local = bases_[axis].evaluate(std::clamp(nodes[j], ends.front(), ends.back()));
    for (Index f = 0; f < bases_[axis].active(); ++f)
      values.row(j) += local.value[f] * Eigen::Map<const Eigen::RowVectorXd>(
                                            coefficients_[axis].data() + (local.first + f) * padded_, count_);
  }
  return values;
}

std::unique_ptr<QuadraticForm> CanonicalFunctions::make_quadratic_form() const {
  if (dimension() > 3) return ParameterFunctions::make_quadratic_form();
  return std::make_unique<CanonicalQuadraticForm>(
      ParameterFunctions::make_quadratic_form(), dimension(),
      [this](Index axis, const Eigen::Ref<const Eigen::VectorXd>& nodes) {
        return axis_values(axis, nodes);
      });
}

JointFunctions::JointFunctions(std::span<const std::vector<double>> nodes, std::span<const double> values,
                               Index count)
    : SplineFunctions(nodes, count) {
  const std::size_t d = bases_.size();
  if (d == 0 || d > k_max_parameters) {
    throw DataError(
        fmt::format("a joint tensor grid of {} parameters: 1 to {} are possible; use the canonical form", d,
                    k_max_parameters));
  }
  // B-spline coefficients: along every axis in turn.
  std::vector<double> fitted(values.begin(), values.end());
  multiply_along_axes(fitted, d, [&](std::size_t i) -> const Eigen::MatrixXd& {
    return bases_[i].coefficients_from_values();
  });
  Index grid = 1;
  for (const numerics::CubicSplineBasis& basis : bases_) grid *= basis.size();
  assert(std::ssize(values) == grid * count);
  coefficients_.assign(grid * padded_, 0.0);
  Eigen::Map<RowMatrix>(coefficients_.data(), grid, padded_).leftCols(count) =
      Eigen::Map<const RowMatrix>(fitted.data(), count, grid).transpose();
  strides_.resize(d);
  std::ptrdiff_t stride = padded_;
  for (std::size_t i = d; i-- > 0;) {
    strides_[i] = stride;
    stride *= bases_[i].size();
  }
}

void JointFunctions::evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives,
                              FunctionBatch& out) const {
  const std::size_t d = bases_.size();
  const PointEvaluator evaluator = derivatives == 0   ? k_evaluators<0>[d - 1]
                                   : derivatives == 1 ? k_evaluators<1>[d - 1]
                                                      : k_evaluators<2>[d - 1];
  Workspace<Local> local_space;
  const auto local = local_space.first(d);
  std::array<int, k_max_parameters> active{};
  for (std::size_t i = 0; i < d; ++i) active[i] = bases_[i].active();
  for (Index row = 0; row < points.rows(); ++row) {
    derivatives == 0 ? localise<0>(points, row, local) : localise<2>(points, row, local);
    const double* start = coefficients_.data();
    for (std::size_t i = 0; i < d; ++i) start += local[i].first * strides_[i];
    evaluator({start, local.data(), strides_.data(), active.data(), row, count_}, out);
  }
}

Eigen::VectorXd JointFunctions::magnitude(const Eigen::VectorXd& centre) const {
  // The B-splines are non-negative and sum to one: w(p) is a mean of coefficients.
  const Eigen::Map<const RowMatrix> table(coefficients_.data(),
                                          std::ssize(coefficients_) / std::max<Index>(padded_, 1), padded_);
  return (table.leftCols(count_).rowwise() - centre.transpose()).cwiseAbs().colwise().maxCoeff().transpose();
}

std::unique_ptr<QuadraticForm> JointFunctions::make_quadratic_form() const {
  if (bases_.size() > JointQuadraticForm::k_max_parameters) return ParameterFunctions::make_quadratic_form();
  return std::make_unique<JointQuadraticForm>(bases_, coefficients_, strides_, count_);
}

}  // namespace knothe::model
