#pragma once
/// @file What a triangular map is made of: rectifier, bases, index sets (docs/explanation/transport.md).
///
/// Component k is  M^k(x) = Φ_c(x_1 … x_{k−1}) a_c + ∫₀^{x_k} r(Φ_e(x_1 … x_{k−1}, θ) a_e) dθ,  r > 0.
#include <Eigen/Core>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "knothe/transport/map/multi_index.hpp"
#include "knothe/transport/map/tailed_hermite.hpp"

namespace knothe::transport {

/// r, which makes the integrand positive.
enum class Rectifier {
  square,      ///< h²: Rubio et al. 2019, Eq. 7. Integrated exactly; log h² is singular at h = 0
  softplus,    ///< log(1 + eʰ)/log 2, so that r(0) = 1: no singularity, linear growth
  exponential  ///< eʰ: no singularity; log r is linear in the coefficients
};

/// The one-variable functions, of which products make Φ_c and Φ_e.
enum class BasisFamily {
  hermite,           ///< orthonormal probabilists' Hermite polynomials
  hermite_functions  ///< 1, x, then polynomial × exp(−x²/4): products decay, the map is affine far out
};

/// How the functions go on where hardly a point of N(0, 1) falls (TailedHermite).
enum class Tails {
  bent,       ///< Φ_c by tangents, Φ_e by constants: the default, see docs/explanation/transport.md
  tangent,    ///< both by tangents ("tail-linearised")
  polynomial  ///< not at all: plain polynomials, which break at order 6 in the tails
};

/// The choice of functions, the same for all components of a map.
struct Parametrisation {
  Rectifier rectifier = Rectifier::square;
  BasisFamily basis = BasisFamily::hermite;
  Tails tails = Tails::bent;
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
  [[nodiscard]] Eigen::Index dimension() const { return static_cast<Eigen::Index>(components.size()); }
  [[nodiscard]] Eigen::Index coefficient_count() const;
  /// Highest degree in any index of Φ_c, and one more than that in Φ_e: what "order" means for total order.
  [[nodiscard]] int order() const;
  /// Adds to each component what the other has and it has not. Same parametrisation and dimension.
  void unite(const MapSpecification& other);
};

/// Φ_c of total order p, Φ_e of total order p − 1. Order 1 with the square: an affine map. Errors (all of
/// these): UsageError for d < 1 or orders outside 1 … k_max_order.
[[nodiscard]] MapSpecification total_order_map(Eigen::Index d, int order,
                                               Parametrisation parametrisation = {});
/// The same with hyperbolic crosses.
[[nodiscard]] MapSpecification hyperbolic_cross_map(Eigen::Index d, int order,
                                                    Parametrisation parametrisation = {});
/// One order for each variable (anisotropic_indices).
[[nodiscard]] MapSpecification per_variable_map(std::span<const int> orders,
                                                Parametrisation parametrisation = {});
/// M^k depends on x_k alone.
[[nodiscard]] MapSpecification diagonal_map(Eigen::Index d, int order, Parametrisation parametrisation = {});

/// The variables before k on which component k may depend, one list per component.
using Parents = std::vector<std::vector<int>>;
/// Leaves in component k only indices in `parents[k]` and k itself.
[[nodiscard]] MapSpecification sparse_map(MapSpecification full, const Parents& parents);
/// From a graph of conditional dependence (pairs of variables that occur together in a factor of the density)
/// to the parents of the components of the *inverse* map S = T⁻¹, target to reference, hence of a map made
/// from samples: variables are eliminated from the last one, whose neighbours become neighbours of each other
/// (Spantini, Bigoni, Marzouk 2018, section 5). The direct map T of such a density is in general not sparse
/// but decomposes into a composition; behind a dense Laplace pre-map the same sets are a good choice for its
/// nonlinear part, and the diagnostic tells how good.
[[nodiscard]] Parents parents_by_elimination(Eigen::Index d, const std::vector<std::pair<int, int>>& edges);

/// One map per order: how an adaptive solve goes on from one order to the next.
using MapFamily = std::function<MapSpecification(Eigen::Index dimension, int order)>;

/// "square", "softplus", "exponential", and back (UsageError, with the choices).
[[nodiscard]] std::string to_string(Rectifier rectifier);
[[nodiscard]] Rectifier rectifier_from(const std::string& name);
[[nodiscard]] std::string to_string(BasisFamily family);
[[nodiscard]] BasisFamily basis_family_from(const std::string& name);
[[nodiscard]] std::string to_string(Tails tails);
[[nodiscard]] Tails tails_from(const std::string& name);

}  // namespace knothe::transport
