#pragma once
/// @file Cumulative sums: when a small drift is no longer chance.

namespace knothe::assimilation {

/// Threshold h of the one-sided cumulative sum S ← max(0, S + z − `reference`), z independent and standard
/// normal, such that S > h happens on average once in `run_length` steps. The average run length solves
///   L(s) = 1 + Φ(k − s) L(0) + ∫₀ʰ L(y) φ(y − s + k) dy
/// (E. S. Page, Biometrika 41 (1954)); here by Gauss-Legendre quadrature. `run_length` ≥ 2, `reference` > 0.
[[nodiscard]] double cusum_threshold(double reference, double run_length);

/// The sum itself.
class Cusum {
 public:
  Cusum(double reference, double threshold) : reference_(reference), threshold_(threshold) {}

  /// Takes the next value in; whether the sum is above the threshold now.
  bool add(double z) {
    value_ += z - reference_;
    steps_ = value_ > 0 ? steps_ + 1 : 0;
    if (value_ < 0) value_ = 0;
    return value_ > threshold_;
  }
  void restart() { value_ = 0, steps_ = 0; }
  [[nodiscard]] double value() const { return value_; }
  [[nodiscard]] double threshold() const { return threshold_; }
  /// Steps since the sum was last zero: the estimate of how long the drift lasts.
  [[nodiscard]] int steps() const { return steps_; }

 private:
  double reference_, threshold_, value_ = 0;
  int steps_ = 0;
};

}  // namespace knothe::assimilation
