#pragma once
/// @file Random numbers that are a function of a seed and a counter: the same on every machine, for any
/// number of threads, in any order.
#include <Eigen/Core>
#include <array>
#include <cstdint>

#include "knothe/base/index.hpp"

namespace knothe::numerics {

/// Next number of the sequence that begins at `state`. Source: G. Steele, D. Lea, C. Flood, OOPSLA 2014.
[[nodiscard]] constexpr std::uint64_t split_mix(std::uint64_t& state) {
  std::uint64_t z = (state += 0x9e3779b97f4a7c15ULL);
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
  return z ^ (z >> 31);
}

/// 128 random bits for a counter and a key, ten rounds of Philox-4x32. Source: J. Salmon, M. Moraes, R. Dror,
/// D. Shaw, "Parallel random numbers: as easy as 1, 2, 3", SC 2011.
[[nodiscard]] constexpr std::array<std::uint32_t, 4> philox(std::array<std::uint32_t, 4> counter,
                                                            std::array<std::uint32_t, 2> key) {
  for (int round = 0; round < 10; ++round) {
    const std::uint64_t first = std::uint64_t{0xd2511f53u} * counter[0],
                        second = std::uint64_t{0xcd9e8d57u} * counter[2];
    counter = {
        static_cast<std::uint32_t>(second >> 32) ^ counter[1] ^ key[0], static_cast<std::uint32_t>(second),
        static_cast<std::uint32_t>(first >> 32) ^ counter[3] ^ key[1], static_cast<std::uint32_t>(first)};
    key[0] += 0x9e3779b9u;
    key[1] += 0xbb67ae85u;
  }
  return counter;
}

/// The middle of the interval of [0, 1) that the leading 52 bits name: never 0 or 1, both tails alike.
[[nodiscard]] constexpr double unit_interval(std::uint64_t bits) {
  return ((bits >> 12) + 0.5) * 0x1p-52;
}

/// Independent uniform points, n × d, in (0, 1)^d. Entry (i, k) depends on the seed, i + first and k alone,
/// so that points may be made piece by piece.
[[nodiscard]] Eigen::MatrixXd monte_carlo_points(Index n, Index d, std::uint64_t seed,
                                                 std::uint64_t first = 0);

/// The same, each coordinate through Φ⁻¹: independent draws from N(0, I).
[[nodiscard]] Eigen::MatrixXd monte_carlo_normal_points(Index n, Index d, std::uint64_t seed,
                                                        std::uint64_t first = 0);

}  // namespace knothe::numerics
