#include "knothe/model/reduced/joint_quadratic_form.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>

#include "knothe/base/index.hpp"
#include "knothe/model/reduced/spline_contraction.hpp"

namespace knothe::model {

namespace {

using Local = numerics::CubicSplineBasis::Local;
constexpr std::size_t k_lanes = k_lane_count;
constexpr std::size_t k_powers = 7;  ///< of the square of a cubic

/// Below this sum of the absolute coefficients a cell's polynomial is good to 1e-9 or so: 2e6 · 2⁻⁵² · 2.
constexpr double k_largest_polynomial = 2e6;
/// Above it, it will do where ℓ is, everywhere in the cell, below minus this fraction of that sum: 1e-10
/// relative.
constexpr double k_min_fraction = 1e-5;
/// A grid of three parameters with so many nodes in a cell is worth its polynomial, which costs as much as
/// some 30 rows of squares.
constexpr double k_min_nodes = 400;

double sum(const Lanes& v) {
  typedef double Four __attribute__((vector_size(4 * sizeof(double))));
  typedef double Two __attribute__((vector_size(2 * sizeof(double))));
  const Four four = __builtin_shufflevector(v, v, 0, 1, 2, 3) + __builtin_shufflevector(v, v, 4, 5, 6, 7);
  const Two two = __builtin_shufflevector(four, four, 0, 1) + __builtin_shufflevector(four, four, 2, 3);
  return two[0] + two[1];
}

/// 1, t, t², … t⁷, and their first and second derivatives.
template <int Derivatives>
struct Powers {
  Lanes value, first, second;

  explicit Powers(double t) {
    const double t2 = t * t, t4 = t2 * t2;
    value =
        Lanes{1, t, 1, t, 1, t, 1, t} * Lanes{1, 1, t2, t2, 1, 1, t2, t2} * Lanes{1, 1, 1, 1, t4, t4, t4, t4};
    if constexpr (Derivatives >= 1)
      first = Lanes{0, 1, 2, 3, 4, 5, 6, 7} * __builtin_shufflevector(value, value, 0, 0, 1, 2, 3, 4, 5, 6);
    if constexpr (Derivatives >= 2)
      second =
          Lanes{0, 0, 2, 6, 12, 20, 30, 42} * __builtin_shufflevector(value, value, 0, 0, 0, 1, 2, 3, 4, 5);
  }
};

/// How many polynomials in the last variable make one in D.
template <std::size_t D>
constexpr Index k_rows = Index{k_powers} * k_rows<D - 1>;
template <>
constexpr Index k_rows<1> = 1;

/// Horner's rule over the N outer variables of a cell's polynomial; the inner one lies along the lanes.
template <std::size_t N, int Derivatives>
[[gnu::always_inline]] inline Jet<N, Derivatives> horner(const double* c, const SplineAxis::Place* place) {
  Jet<N, Derivatives> jet;
  if constexpr (N == 0) {
    jet.value = load(c);
  } else {
    const double t = place->t;
    for (std::size_t p = k_powers; p-- > 0;) {
      const auto inner = horner<N - 1, Derivatives>(c + p * k_rows<N> * k_lane_count, place + 1);
      if constexpr (Derivatives >= 2) {
        jet.second[0] = jet.second[0] * t + jet.first[0];
        for (std::size_t k = 1; k < N; ++k) {
          jet.second[packed(k, 0)] = jet.second[packed(k, 0)] * t + jet.first[k];
          for (std::size_t m = 1; m <= k; ++m)
            jet.second[packed(k, m)] = jet.second[packed(k, m)] * t + inner.second[packed(k - 1, m - 1)];
        }
      }
      if constexpr (Derivatives >= 1) {
        jet.first[0] = jet.first[0] * t + jet.value;
        for (std::size_t k = 1; k < N; ++k) jet.first[k] = jet.first[k] * t + inner.first[k - 1];
      }
      jet.value = jet.value * t + inner.value;
    }
    if constexpr (Derivatives >= 2) jet.second[0] *= 2;
  }
  return jet;
}

/// Coefficients of t₁^p … t_D^q, [4, …, 4], of a tensor spline in one cell.
template <std::size_t D>
void to_powers(const double* coefficients, const SplineAxis::Piece* const* piece, const int* active,
               const std::ptrdiff_t* stride, Lanes* out) {
  constexpr std::size_t inner_count = std::size_t{1} << (2 * (D - 1));
  std::fill_n(out, 4 * inner_count, Lanes{});
  for (int f = 0; f < *active; ++f) {
    std::array<Lanes, inner_count> inner;
    if constexpr (D == 1) {
      inner[0] = load(coefficients + f * *stride);
    } else {
      to_powers<D - 1>(coefficients + f * *stride, piece + 1, active + 1, stride + 1, inner.data());
    }
    for (std::size_t p = 0; p < 4; ++p)
      for (std::size_t i = 0; i < inner_count; ++i) out[p * inner_count + i] += (**piece)[p][f] * inner[i];
  }
}

/// Of powers up to 3 of the outer variables, [4, …], the place among those up to 6, [7, …].
constexpr std::size_t row_of(std::size_t outer) {
  return outer / 4 * k_powers + outer % 4;
}

}  // namespace

JointQuadraticForm::JointQuadraticForm(std::span<const numerics::CubicSplineBasis> bases,
                                       std::span<const double> coefficients,
                                       std::span<const std::ptrdiff_t> strides, Index count)
    : coefficients_(coefficients), grid_(1), count_(count), source_stride_(round_up_to_lanes(count)) {
  assert(!bases.empty() && bases.size() <= k_max_parameters && strides.size() == bases.size());
  std::size_t cells = 1;
  for (Index i = 0; i < std::ssize(bases); ++i) {
    axes_.emplace_back(bases[i]);
    grid_ *= bases[i].size();
    cells *= axes_[i].size();
    grid_strides_[i] = source_stride_ > 0 ? strides[i] / source_stride_ : 0;
  }
  if (axes_.size() <= 3) cell_.resize(cells);
}

void JointQuadraticForm::set(const Eigen::Ref<const Eigen::MatrixXd>& a,
                             const Eigen::Ref<const Eigen::VectorXd>& b,
                             const Eigen::Ref<const Eigen::VectorXd>& c, double constant) {
  const Index k = a.rows();
  assert(a.cols() == count_ && b.size() == k && c.size() == count_);
  const bool has_linear = (c.array() != 0).any();
  const Index used = k + (has_linear ? 1 : 0);
  padded_ = round_up_to_lanes(used);
  constant_ = constant;
  table_.assign(grid_ * padded_, 0.0);
  square_.assign(padded_, 0.0);
  linear_.assign(padded_, 0.0);
  std::fill_n(square_.begin(), k, -0.5);
  if (has_linear) linear_[k] = 1;
  for (Index i = 0; i < std::ssize(axes_); ++i) strides_[i] = grid_strides_[i] * padded_;
  std::fill(cell_.begin(), cell_.end(), k_unknown);
  polynomial_.clear();
  if (used == 0) return;
  combination_.resize(count_, used);
  combination_.leftCols(k) = a.transpose();
  if (has_linear) combination_.col(k) = c;
  const Eigen::Map<const RowMatrix> source(coefficients_.data(), grid_, source_stride_);
  Eigen::Map<RowMatrix> table(table_.data(), grid_, padded_);
  table.leftCols(used).noalias() = source.leftCols(count_) * combination_;
  // The B-splines sum to one.
  table.leftCols(k).rowwise() += b.transpose();
}

template <std::size_t D, int Derivatives>
void JointQuadraticForm::sum_squares(const std::array<SplineAxis::Place, D>& place, Result<D>& result) const {
  std::array<Local, D> local;
  std::array<int, D> active;
  const double* start = table_.data();
  for (std::size_t i = 0; i < D; ++i) {
    axes_[i].evaluate<Derivatives>(place[i], local[i]);
    active[i] = axes_[i].active();
    start += local[i].first * strides_[i];
  }
  Jet<D, Derivatives> total;
  for (Index k = 0; k < padded_; k += k_lane_count) {
    const auto jet = contract<D, Derivatives>(start + k, local.data(), strides_.data(), active.data());
    const Lanes square = load(square_.data() + k), one = load(linear_.data() + k);
    const Lanes half_slope = square * jet.value;
    total.value += jet.value * (half_slope + one);
    const Lanes slope = 2 * half_slope + one;
    if constexpr (Derivatives >= 1) {
      for (std::size_t i = 0; i < D; ++i) {
        total.first[i] += slope * jet.first[i];
        if constexpr (Derivatives >= 2) {
          const Lanes bend = 2 * square * jet.first[i];
          for (std::size_t m = 0; m <= i; ++m)
            total.second[packed(i, m)] += bend * jet.first[m] + slope * jet.second[packed(i, m)];
        }
      }
    }
  }
  result.value = sum(total.value);
  for (Index i = 0; i < std::ssize(total.first); ++i) result.gradient[i] = sum(total.first[i]);
  for (Index i = 0; i < std::ssize(total.second); ++i) result.hessian[i] = sum(total.second[i]);
}

template <std::size_t D>
const double* JointQuadraticForm::polynomial_at(const std::array<SplineAxis::Place, D>& place) {
  std::size_t at = place[0].piece;
  for (std::size_t i = 1; i < D; ++i) at = at * axes_[i].size() + place[i].piece;
  Index& cell = cell_[at];
  if (cell == k_unknown) cell = multiply_out(place);
  return cell == k_squares ? nullptr : polynomial_.data() + cell;
}

template <std::size_t D>
Index JointQuadraticForm::multiply_out(const std::array<SplineAxis::Place, D>& place) {
  constexpr std::size_t outer_count = std::size_t{1} << (2 * (D - 1));
  constexpr Index rows = k_rows<D>;
  std::array<std::array<Lanes, k_powers>, rows> total{};
  std::array<std::array<Lanes, 4>, outer_count> s;  // [powers of the outer variables][of the last one]
  std::array<const SplineAxis::Piece*, D> piece;
  std::array<int, D> active;
  const double* start = table_.data();
  for (std::size_t i = 0; i < D; ++i) {
    piece[i] = &axes_[i].piece(place[i].piece);
    active[i] = axes_[i].active();
    start += place[i].piece * strides_[i];
  }
  for (Index k = 0; k < padded_; k += k_lane_count) {
    to_powers<D>(start + k, piece.data(), active.data(), strides_.data(), s[0].data());
    const Lanes square = load(square_.data() + k), one = load(linear_.data() + k);
    for (std::size_t a = 0; a < outer_count; ++a) {
      auto& of_a = total[row_of(a)];
      for (std::size_t q = 0; q < 4; ++q) of_a[q] += one * s[a][q];
      for (std::size_t b = 0; b <= a; ++b) {
        auto& out = total[row_of(a) + row_of(b)];
        const Lanes twice = (a == b ? 1 : 2) * square;
        for (std::size_t q = 0; q < 4; ++q) {
          const Lanes factor = twice * s[a][q];
          for (std::size_t n = 0; n < 4; ++n) out[q + n] += factor * s[b][n];
        }
      }
    }
  }
  const Index at = std::ssize(polynomial_);
  polynomial_.resize(at + rows * k_lane_count);
  double* out = polynomial_.data() + at;
  double absolute = 0;
  for (const auto& row : total) {
    for (std::size_t q = 0; q < k_powers; ++q) absolute += std::abs(out[q] = sum(row[q]));
    out += k_lanes;
  }
  const double first = polynomial_[at], highest = first + absolute - std::abs(first);
  if (absolute <= k_largest_polynomial || highest < -k_min_fraction * absolute) return at;
  polynomial_.resize(at);
  return k_squares;
}

template <std::size_t D, int Derivatives>
void JointQuadraticForm::evaluate_polynomial(const double* c, const std::array<SplineAxis::Place, D>& place,
                                             Result<D>& result) const {
  constexpr std::size_t last = D - 1;
  const auto jet = horner<last, Derivatives>(c, place.data());
  const Powers<Derivatives> powers(place[last].t);
  std::array<double, D> scale;
  for (std::size_t i = 0; i < D; ++i) scale[i] = axes_[i].scale(place[i].piece);
  result.value = sum(jet.value * powers.value);
  if constexpr (Derivatives >= 1) {
    for (std::size_t i = 0; i < last; ++i) result.gradient[i] = scale[i] * sum(jet.first[i] * powers.value);
    result.gradient[last] = scale[last] * sum(jet.value * powers.first);
  }
  if constexpr (Derivatives >= 2) {
    for (std::size_t i = 0; i < last; ++i) {
      for (std::size_t m = 0; m <= i; ++m)
        result.hessian[packed(i, m)] = scale[i] * scale[m] * sum(jet.second[packed(i, m)] * powers.value);
      result.hessian[packed(last, i)] = scale[last] * scale[i] * sum(jet.first[i] * powers.first);
    }
    result.hessian.back() = scale[last] * scale[last] * sum(jet.value * powers.second);
  }
}

template <std::size_t D, int Derivatives>
void JointQuadraticForm::evaluate_all(const Eigen::Ref<const Eigen::MatrixXd>& points, const Output& out) {
  std::array<SplineAxis::Place, D> place;
  Result<D> result;
  for (Index row = 0; row < points.rows(); ++row) {
    for (std::size_t i = 0; i < D; ++i) place[i] = axes_[i].locate(points(row, i));
    const double* polynomial = nullptr;
    // Of three parameters it costs as much as thirty values: points without derivatives are spread too
    // thinly.
    if constexpr (D <= 2 || (D == 3 && Derivatives > 0)) polynomial = polynomial_at(place);
    if (polynomial == nullptr) {
      sum_squares<D, Derivatives>(place, result);
    } else {
      evaluate_polynomial<D, Derivatives>(polynomial, place, result);
    }
    out.value[row] = constant_ + result.value;
    if constexpr (Derivatives >= 1)
      for (std::size_t i = 0; i < D; ++i) out.gradient[row + i * out.gradient_stride] = result.gradient[i];
    if constexpr (Derivatives >= 2)
      for (Index i = 0; i < std::ssize(result.hessian); ++i)
        out.hessian[row + i * out.hessian_stride] = result.hessian[i];
  }
}

template <std::size_t D>
void JointQuadraticForm::evaluate_in(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives,
                                     const Output& out) {
  if (derivatives == 0) {
    evaluate_all<D, 0>(points, out);
  } else if (derivatives == 1) {
    evaluate_all<D, 1>(points, out);
  } else {
    evaluate_all<D, 2>(points, out);
  }
}

void JointQuadraticForm::evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, int derivatives,
                                  Eigen::Ref<Eigen::VectorXd> value, Eigen::Ref<Eigen::MatrixXd> gradient,
                                  Eigen::Ref<Eigen::MatrixXd> hessian) {
  const Output out{value.data(), gradient.data(), gradient.outerStride(), hessian.data(),
                   hessian.outerStride()};
  if (axes_.size() == 1) return evaluate_in<1>(points, derivatives, out);
  if (axes_.size() == 2) return evaluate_in<2>(points, derivatives, out);
  if (axes_.size() == 3) return evaluate_in<3>(points, derivatives, out);
  evaluate_in<4>(points, derivatives, out);
}

/// Where there is no polynomial of a cell, or its terms are too large: s as cubics in t along the row,
/// squared and summed.
template <std::size_t D>
void JointQuadraticForm::sum_squares_in_line(const std::array<SplineAxis::Place, D>& place, const double* t,
                                             Index n, double* value) {
  std::array<Local, D - 1> outer;
  std::array<int, D - 1> active;
  const double* start = table_.data() + place[D - 1].piece * strides_[D - 1];
  for (std::size_t i = 0; i + 1 < D; ++i) {
    axes_[i].template evaluate<0>(place[i], outer[i]);
    active[i] = axes_[i].active();
    start += outer[i].first * strides_[i];
  }
  const auto& inner = axes_[D - 1].piece(place[D - 1].piece);
  line_.resize(4 * padded_);
  for (Index k = 0; k < padded_; k += k_lane_count) {
    std::array<Lanes, 4> power{};
    for (int g = 0; g < axes_[D - 1].active(); ++g) {
      const Lanes c =
          contract<D - 1, 0>(start + k + g * strides_[D - 1], outer.data(), strides_.data(), active.data())
              .value;
      for (std::size_t q = 0; q < 4; ++q) power[q] += inner[q][g] * c;
    }
    for (std::size_t q = 0; q < 4; ++q) store(line_.data() + q * padded_ + k, power[q], k_lane_count);
  }
  for (Index i = 0; i < n; i += k_lane_count) {
    const Lanes x = load(t + i);
    Lanes total = Lanes{} + constant_;
    for (Index k = 0; k < padded_; ++k) {
      const double square = square_[k], one = linear_[k];
      if (square == 0 && one == 0) continue;
      const Lanes s =
          line_[k] + x * (line_[padded_ + k] + x * (line_[2 * padded_ + k] + x * line_[3 * padded_ + k]));
      total += s * (square * s + one);
    }
    store(value + i, total, n - i);
  }
}

void JointQuadraticForm::set_grid(const Eigen::Ref<const Eigen::MatrixXd>& axes) {
  const std::size_t last = axes_.size() - 1;
  assert(has_grid() && axes.cols() == std::ssize(axes_) && axes.rows() > 0);
  double nodes_per_cell = 1;
  for (std::size_t i = 0; i <= last; ++i) {
    const Index from = axes_[i].locate(axes(0, i)).piece,
                to = axes_[i].locate(axes(axes.rows() - 1, i)).piece;
    nodes_per_cell *= 1.0 * axes.rows() / (std::abs(to - from) + 1);
  }
  multiplies_out_ = last == 1 || nodes_per_cell > k_min_nodes;
  places_.resize(last);
  for (std::size_t i = 0; i < last; ++i) {
    places_[i].resize(axes.rows());
    for (Index j = 0; j < std::ssize(places_[i]); ++j) places_[i][j] = axes_[i].locate(axes(j, i));
  }
  piece_.resize(axes.rows());
  along_.assign(piece_.size() + k_lanes, 0.0);  // the last lanes may be loaded beyond the axis
  for (Index j = 0; j < std::ssize(piece_); ++j) {
    const SplineAxis::Place place = axes_[last].locate(axes(j, last));
    along_[j] = place.t;
    piece_[j] = place.piece;
  }
}

template <std::size_t D>
void JointQuadraticForm::evaluate_run(const numerics::GridRun& run, double* value) {
  const std::size_t row = run.row, count = piece_.size();
  std::array<SplineAxis::Place, D> place{};
  for (std::size_t i = D - 1, rest = row; i-- > 0; rest /= count) place[i] = places_[i][rest % count];
  const std::size_t last = run.end;
  for (std::size_t begin = run.begin, end = begin; begin < last; begin = end) {
    while (end < last && piece_[end] == piece_[begin]) ++end;
    place[D - 1].piece = piece_[begin];
    const Index n = end - begin;
    const double* t = along_.data() + begin;
    double* out = value + run.at + (begin - run.begin);
    const double* const polynomial = multiplies_out_ ? polynomial_at(place) : nullptr;
    if (polynomial != nullptr) {
      const Lanes line = horner<D - 1, 0>(polynomial, place.data()).value;
      const double c0 = line[0] + constant_, c1 = line[1], c2 = line[2], c3 = line[3], c4 = line[4],
                   c5 = line[5], c6 = line[6];
      for (Index i = 0; i < n; i += k_lane_count) {
        const Lanes x = load(t + i);
        store(out + i, c0 + x * (c1 + x * (c2 + x * (c3 + x * (c4 + x * (c5 + x * c6))))), n - i);
      }
      continue;
    }
    sum_squares_in_line<D>(place, t, n, out);
  }
}

void JointQuadraticForm::evaluate_runs(std::span<const numerics::GridRun> runs,
                                       Eigen::Ref<Eigen::VectorXd> value) {
  for (const numerics::GridRun& run : runs) {
    if (axes_.size() == 2) {
      evaluate_run<2>(run, value.data());
    } else {
      evaluate_run<3>(run, value.data());
    }
  }
}

}  // namespace knothe::model
