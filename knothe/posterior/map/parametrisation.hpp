#pragma once
/// @file What a triangular map is made of: rectifier, radii of the tails, index sets
/// (docs/explanation/transport.md).
///
/// Component k is  M^k(x) = Φ_c(x_1 … x_{k−1}) a_c + ∫₀^{x_k} r(Φ_e(x_1 … x_{k−1}, θ) a_e) dθ,  r > 0.
#include <Eigen/Core>
#include <array>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "knothe/base/enum_names.hpp"
#include "knothe/base/index.hpp"
#include "knothe/posterior/map/multi_index.hpp"
#include "knothe/posterior/map/tailed_hermite.hpp"

namespace knothe::posterior {

/// r, which makes the integrand positive.
enum class Rectifier {
  square,      ///< h²: Rubio et al. 2019, Eq. 7. Integrated exactly; log h² is singular at h = 0
  softplus,    ///< log(1 + eʰ)/log 2, so that r(0) = 1: no singularity, linear growth
  exponential  ///< eʰ: no singularity; log r is linear in the coefficients
};

constexpr auto names_of(Rectifier /*rectifier*/) {
  return std::to_array<Named<Rectifier>>({{Rectifier::square, "square"},
                                          {Rectifier::softplus, "softplus"},
                                          {Rectifier::exponential, "exponential"}});
}

/// What the map integrates: "squared Hermite polynomials".
inline std::string in_words(Rectifier rectifier) {
  if (rectifier == Rectifier::square) return "squared Hermite polynomials";
  return std::string(to_text(rectifier)) + " of Hermite polynomials";
}

/// The choice of functions, the same for all components of a map: products of Hermite polynomials with tame
/// tails (TailedHermite).
struct Parametrisation {
  Rectifier rectifier = Rectifier::square;
  TailRadii radii{};
  friend bool operator==(const Parametrisation&, const Parametrisation&) = default;
};

/// The index sets of one component: `constant` in variables 0 … k−1 (counted from 0), `monotone` in 0 … k.
/// Both contain the empty index.
struct ComponentIndices {
  std::vector<MultiIndex> constant;
  std::vector<MultiIndex> monotone;
};

/// A triangular map but for its coefficients.
struct MapSpecification {
  Parametrisation parametrisation;
  std::vector<ComponentIndices> components;
  [[nodiscard]] Index dimension() const { return std::ssize(components); }
  [[nodiscard]] Index coefficient_count() const;
  /// Highest degree in any index of Φ_c, and one more than that in Φ_e: what "order" means for total order.
  [[nodiscard]] int order() const;
};

/// Φ_c of total order p, Φ_e of total order p − 1. Order 1 with the square: an affine map. Errors (all of
/// these): UsageError for d < 1 or orders outside 1 … k_max_order.
[[nodiscard]] MapSpecification total_order_map(Index d, int order, Parametrisation parametrisation = {});
/// One order for each variable (anisotropic_indices).
[[nodiscard]] MapSpecification per_variable_map(std::span<const int> orders,
                                                Parametrisation parametrisation = {});

/// The variables before k on which component k may depend, one list per component.
using Parents = std::vector<std::vector<int>>;
/// Leaves in component k only indices in `parents[k]` and k itself.
[[nodiscard]] MapSpecification sparse_map(MapSpecification full, const Parents& parents);

/// One map per order: how an adaptive solve goes on from one order to the next.
using MapFamily = std::function<MapSpecification(Index dimension, int order)>;

/// The rectifier of that name. Errors: UsageError, with the choices.
[[nodiscard]] Rectifier rectifier_from(const std::string& name);

}  // namespace knothe::posterior
