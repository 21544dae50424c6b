#pragma once
/// @file Sums over a local tensor-product spline basis, eight functions at a time. Internal to this room.
#include <array>
#include <cstddef>
#include <cstring>

#include "knothe/base/index.hpp"
#include "knothe/model/reduced/spline_functions.hpp"
#include "knothe/numerics/functions/cubic_spline.hpp"

namespace knothe::model {

/// Eight doubles; the compiler maps them to one AVX-512 register, or to several narrower ones.
typedef double Lanes __attribute__((vector_size(k_lane_count * sizeof(double))));

[[gnu::always_inline]] inline Lanes load(const double* from) {
  Lanes lanes;
  std::memcpy(&lanes, from, sizeof lanes);
  return lanes;
}

/// Writes the first `n` (at most 8) lanes.
[[gnu::always_inline]] inline void store(double* to, const Lanes& lanes, Index n) {
  if (n >= k_lane_count) {
    std::memcpy(to, &lanes, sizeof lanes);
  } else {
    for (Index i = 0; i < n; ++i) to[i] = lanes[i];
  }
}

/// n rounded up to full lanes.
[[nodiscard]] constexpr Index round_up_to_lanes(Index n) {
  return (n + k_lane_count - 1) / k_lane_count * k_lane_count;
}

/// Index of entry (a, b), a ≥ b, of a packed symmetric matrix.
[[nodiscard]] constexpr std::size_t packed(std::size_t a, std::size_t b) {
  return a * (a + 1) / 2 + b;
}

/// Value, gradient and packed Hessian in D variables, of eight functions.
template <std::size_t D, int Derivatives>
struct Jet {
  Lanes value{};
  std::array<Lanes, Derivatives >= 1 ? D : 0> first{};
  std::array<Lanes, Derivatives >= 2 ? D*(D + 1) / 2 : 0> second{};
};

/// Σ over the local basis of the D last axes of coefficient × product of basis functions, and its
/// derivatives. `local` points to the outermost of them; derivatives are numbered from it.
template <std::size_t D, int Derivatives>
[[gnu::always_inline]] inline Jet<D, Derivatives> contract(const double* coefficients,
                                                           const numerics::CubicSplineBasis::Local* local,
                                                           const std::ptrdiff_t* stride, const int* active) {
  Jet<D, Derivatives> jet;
  for (int i = 0; i < *active; ++i) {
    const double* part = coefficients + i * *stride;
    const double a = local->value[i];
    if constexpr (D == 1) {
      const Lanes c = load(part);
      jet.value += a * c;
      if constexpr (Derivatives >= 1) jet.first[0] += local->first_derivative[i] * c;
      if constexpr (Derivatives >= 2) jet.second[0] += local->second_derivative[i] * c;
    } else {
      const auto inner = contract<D - 1, Derivatives>(part, local + 1, stride + 1, active + 1);
      jet.value += a * inner.value;
      if constexpr (Derivatives >= 1) {
        const double slope = local->first_derivative[i];
        jet.first[0] += slope * inner.value;
        for (std::size_t k = 1; k < D; ++k) jet.first[k] += a * inner.first[k - 1];
        if constexpr (Derivatives >= 2) {
          jet.second[0] += local->second_derivative[i] * inner.value;
          for (std::size_t k = 1; k < D; ++k) {
            jet.second[packed(k, 0)] += slope * inner.first[k - 1];
            for (std::size_t m = 1; m <= k; ++m)
              jet.second[packed(k, m)] += a * inner.second[packed(k - 1, m - 1)];
          }
        }
      }
    }
  }
  return jet;
}

}  // namespace knothe::model
