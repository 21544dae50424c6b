#pragma once
/// @file Random numbers that are the same on every machine: the standard fixes the engine but not the
/// distributions.
#include <Eigen/Core>
#include <cmath>
#include <cstdint>
#include <random>

namespace knothe::posterior {

/// Mersenne Twister with our own distributions. One object serves one thread.
class RandomNumbers {
 public:
  explicit RandomNumbers(std::uint64_t seed) : engine_(seed) {}

  /// In (0, 1), never 0 or 1.
  [[nodiscard]] double uniform() { return ((engine_() >> 11) + 0.5) * 0x1p-53; }
  /// In 0 … n − 1.
  [[nodiscard]] Eigen::Index index(Eigen::Index n) {
    return std::min(n - 1, static_cast<Eigen::Index>(uniform() * n));
  }
  /// N(0, 1), by the polar method of Marsaglia.
  [[nodiscard]] double normal() {
    if (has_spare_) {
      has_spare_ = false;
      return spare_;
    }
    double u = 0, v = 0, s = 0;
    do {
      u = 2 * uniform() - 1;
      v = 2 * uniform() - 1;
      s = u * u + v * v;
    } while (s >= 1 || s == 0);
    const double factor = std::sqrt(-2 * std::log(s) / s);
    spare_ = v * factor;
    has_spare_ = true;
    return u * factor;
  }
  /// Independent N(0, 1) numbers, n × d.
  [[nodiscard]] Eigen::MatrixXd normals(Eigen::Index n, Eigen::Index d) {
    return Eigen::MatrixXd::NullaryExpr(n, d, [this](Eigen::Index, Eigen::Index) { return normal(); });
  }

 private:
  std::mt19937_64 engine_;
  double spare_ = 0;
  bool has_spare_ = false;
};

}  // namespace knothe::posterior
