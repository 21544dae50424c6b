#pragma once
/// @file Scrambled Sobol points: a low-discrepancy sequence, the same for the same seed on every machine.
#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "knothe/base/index.hpp"

namespace knothe::numerics {

/// Largest number of dimensions.
inline constexpr Index k_sobol_max_dimension = 200;

/// The first n points, n × d, in (0, 1)^d, by the direction numbers of S. Joe and F. Kuo (SIAM J. Sci.
/// Comput. 30, 2008, 2635–2654) that Boost.Random holds. Seed 0 gives the plain sequence (shifted by half a
/// unit of the last place off the border); any other a random linear matrix scramble with digital shift (J.
/// Matoušek 1998), which keeps the net property and makes averages unbiased over the seeds. Use n = 2^m.
/// Errors: UsageError for d outside 1 … 200.
[[nodiscard]] Eigen::MatrixXd sobol_points(Index n, Index d, std::uint64_t seed);

/// The same, each coordinate through Φ⁻¹: points distributed like N(0, I).
[[nodiscard]] Eigen::MatrixXd sobol_normal_points(Index n, Index d, std::uint64_t seed);

/// 0 … n − 1 in the order of their bits read backwards, for whoever takes a part of the points. Every fourth
/// point of a Sobol sequence lies in one quarter of the first coordinate's range; every fourth in this order
/// are points that follow each other in the sequence, and those are spread evenly.
[[nodiscard]] std::vector<Index> reversed_bits(Index n);

/// Shifts and shears points (n × d, n > d) by a lower triangular matrix such that their mean is 0 and their
/// covariance the identity, to rounding: sums over them are then exact for polynomials of degree 2, hence the
/// moments of every Gaussian.
void match_standard_moments(Eigen::MatrixXd& points);

}  // namespace knothe::numerics
