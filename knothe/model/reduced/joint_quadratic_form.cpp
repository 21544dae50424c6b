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
  if (axes_.size() <= 2) {
    cell_.resize(cells);
    polynomial_.resize(cells * k_lanes * (axes_.size() == 2 ? k_powers : 1));
  }
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
  std::fill(cell_.begin(), cell_.end(), Cell::unknown);
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
void JointQuadraticForm::multiply_out(std::size_t cell, const std::array<SplineAxis::Place, D>& place) {
  constexpr std::size_t outer_powers = D == 2 ? 4 : 1, rows = D == 2 ? k_powers : 1;
  std::array<std::array<Lanes, k_powers>, rows> total{};
  const auto& inner_axis = axes_[D - 1];
  const auto& inner_piece = inner_axis.piece(place[D - 1].piece);
  const double* start = table_.data();
  for (std::size_t i = 0; i < D; ++i) start += place[i].piece * strides_[i];
  for (Index k = 0; k < padded_; k += k_lane_count) {
    // s as a polynomial: Σ s_pq t₁^p t₂^q.
    std::array<std::array<Lanes, 4>, outer_powers> s{};
    const int outer_active = D == 2 ? axes_[0].active() : 1;
    for (int f = 0; f < outer_active; ++f) {
      std::array<Lanes, 4> inner{};
      for (int g = 0; g < inner_axis.active(); ++g) {
        const Lanes c = load(start + k + (D == 2 ? f * strides_[0] : 0) + g * strides_[D - 1]);
        for (std::size_t q = 0; q < 4; ++q) inner[q] += inner_piece[q][g] * c;
      }
      for (std::size_t p = 0; p < outer_powers; ++p) {
        const double weight = D == 2 ? axes_[0].piece(place[0].piece)[p][f] : 1.0;
        for (std::size_t q = 0; q < 4; ++q) s[p][q] += weight * inner[q];
      }
    }
    const Lanes square = load(square_.data() + k), one = load(linear_.data() + k);
    for (std::size_t p = 0; p < outer_powers; ++p) {
      for (std::size_t q = 0; q < 4; ++q) {
        Lanes factor = square * s[p][q];
        if (p == 0 && q == 0) factor += one;
        for (std::size_t m = 0; m < outer_powers; ++m)
          for (std::size_t n = 0; n < 4; ++n) total[p + m][q + n] += factor * s[m][n];
      }
    }
  }
  double* out = polynomial_.data() + cell * rows * k_lanes;
  double absolute = 0;
  for (std::size_t p = 0; p < rows; ++p) {
    for (std::size_t q = 0; q < k_powers; ++q) {
      out[p * k_lanes + q] = sum(total[p][q]);
      absolute += std::abs(out[p * k_lanes + q]);
    }
    out[p * k_lanes + k_powers] = 0;
  }
  const double highest = out[0] + absolute - std::abs(out[0]);
  const bool good = absolute <= k_largest_polynomial || highest < -k_min_fraction * absolute;
  cell_[cell] = good ? Cell::polynomial : Cell::squares;
}

template <std::size_t D, int Derivatives>
void JointQuadraticForm::evaluate_all(const Eigen::Ref<const Eigen::MatrixXd>& points, const Output& out) {
  std::array<SplineAxis::Place, D> place;
  Result<D> result;
  for (Index row = 0; row < points.rows(); ++row) {
    for (std::size_t i = 0; i < D; ++i) place[i] = axes_[i].locate(points(row, i));
    bool done = false;
    if constexpr (D <= 2) {
      const std::size_t cell = D == 2 ? place[0].piece * axes_[1].size() + place[1].piece : place[0].piece;
      if (cell_[cell] == Cell::unknown) multiply_out<D>(cell, place);
      if (cell_[cell] == Cell::polynomial) {
        done = true;
        constexpr std::size_t rows = D == 2 ? k_powers : 1;
        const double* c = polynomial_.data() + cell * rows * k_lanes;
        // Horner's rule over the outer variable, with derivatives; the inner one lies along the lanes.
        Lanes value = load(c + (rows - 1) * k_lanes), slope{}, bend{};
        const double t = place[0].t;
        for (std::size_t p = rows - 1; p-- > 0;) {
          if constexpr (Derivatives >= 2) bend = bend * t + slope;
          if constexpr (Derivatives >= 1) slope = slope * t + value;
          value = value * t + load(c + p * k_lanes);
        }
        const Powers<Derivatives> powers(place[D - 1].t);
        const double inner = axes_[D - 1].scale(place[D - 1].piece);
        result.value = sum(value * powers.value);
        if constexpr (Derivatives >= 1) result.gradient[D - 1] = inner * sum(value * powers.first);
        if constexpr (Derivatives >= 2) result.hessian.back() = inner * inner * sum(value * powers.second);
        if constexpr (D == 2) {
          const double outer = axes_[0].scale(place[0].piece);
          if constexpr (Derivatives >= 1) result.gradient[0] = outer * sum(slope * powers.value);
          if constexpr (Derivatives >= 2) {
            result.hessian[0] = 2 * outer * outer * sum(bend * powers.value);
            result.hessian[1] = outer * inner * sum(slope * powers.first);
          }
        }
      }
    }
    if (!done) sum_squares<D, Derivatives>(place, result);
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
  assert(has_grid() && axes.cols() == std::ssize(axes_));
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
    if constexpr (D == 2) {
      const std::size_t cell = place[0].piece * axes_[1].size() + place[1].piece;
      if (cell_[cell] == Cell::unknown) multiply_out<2>(cell, place);
      if (cell_[cell] == Cell::polynomial) {
        const double* c = polynomial_.data() + cell * k_powers * k_lanes;
        Lanes line = load(c + (k_powers - 1) * k_lanes);
        for (std::size_t p = k_powers - 1; p-- > 0;) line = line * place[0].t + load(c + p * k_lanes);
        const double c0 = line[0] + constant_, c1 = line[1], c2 = line[2], c3 = line[3], c4 = line[4],
                     c5 = line[5], c6 = line[6];
        for (Index i = 0; i < n; i += k_lane_count) {
          const Lanes x = load(t + i);
          store(out + i, c0 + x * (c1 + x * (c2 + x * (c3 + x * (c4 + x * (c5 + x * c6))))), n - i);
        }
        continue;
      }
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
