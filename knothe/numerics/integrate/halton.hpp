#pragma once
/// @file Scrambled Halton points: low discrepancy in any number of dimensions and for any number of points.
#include <Eigen/Core>
#include <cstdint>

namespace knothe::numerics {

/// Points `first` … first + n − 1 of the Halton sequence, n × d, in (0, 1)^d; coordinate k is the radical
/// inverse of the index in the k-th prime. Seed 0 gives the plain sequence, useless beyond some ten
/// dimensions; any other permutes every digit of every coordinate at random, leading zeros too, so that each
/// point is uniform and averages are unbiased over the seeds. Points do not depend on n or d. Source: A.
/// Owen, "A randomized Halton algorithm in R", arXiv 1706.02808 (2017). Errors: UsageError for d outside 1 …
/// 1000.
[[nodiscard]] Eigen::MatrixXd halton_points(Eigen::Index n, Eigen::Index d, std::uint64_t seed,
                                            std::uint64_t first = 0);

/// The same, each coordinate through Φ⁻¹: points distributed like N(0, I).
[[nodiscard]] Eigen::MatrixXd halton_normal_points(Eigen::Index n, Eigen::Index d, std::uint64_t seed,
                                                   std::uint64_t first = 0);

}  // namespace knothe::numerics
