#include "knothe/offline/latin/latin_local_stage.hpp"

#include <Eigen/Core>

namespace knothe::offline {
namespace {

using Lanes = Eigen::Array<double, static_cast<int>(k_lanes), 1>;
using Input = Eigen::Map<const Lanes>;
using Output = Eigen::Map<Lanes>;

/// Eigenvalues of the strain tensor, largest first.
struct Eigenvalues {
  Lanes first, second, third;
};

/// cos(acos(h) / 3) for 0 ≤ h ≤ 1: the root of 4c³ - 3c = h in [0.866, 1]. Three Newton steps from a
/// parabola.
Lanes cosine_of_third(const Lanes& h) {
  Lanes c = 0.86602540378443865 + h * (0.16666666666666667 - 0.03269207045110532 * h);
  for (int i = 0; i < 3; ++i) {
    const Lanes square = c * c;
    c -= (c * (4.0 * square - 3.0) - h) / (12.0 * square - 3.0);
  }
  return c.min(1.0);
}

/// The best separated eigenvalue is mean ± 2 p c, the others follow from their sum and product.
Eigenvalues eigenvalues(const Lanes* e) {
  const Lanes mean = (e[0] + e[1] + e[2]) * (1.0 / 3.0);
  const Lanes a = e[0] - mean, b = e[1] - mean, c = e[2] - mean;
  const Lanes d = 0.5 * e[3], f = 0.5 * e[4], g = 0.5 * e[5];  // xy, yz, zx
  const Lanes p = ((a * a + b * b + c * c + 2.0 * (d * d + f * f + g * g)) * (1.0 / 6.0)).sqrt();
  const Lanes determinant = a * (b * c - f * f) - d * (d * c - f * g) + g * (d * f - b * g);
  const Lanes safe = p.max(1e-100);
  const Lanes h = (0.5 * determinant / (safe * safe * safe)).max(-1.0).min(1.0);
  const Lanes cosine = cosine_of_third(h.abs());
  const Lanes near = p * cosine;
  const Lanes half_gap = p * (3.0 * (1.0 - cosine * cosine)).max(0.0).sqrt();
  Eigenvalues result;
  result.first = mean + (h >= 0.0).select(2.0 * near, near + half_gap);
  result.second = mean + (h >= 0.0).select(half_gap - near, near - half_gap);
  result.third = mean - (h >= 0.0).select(near + half_gap, 2.0 * near);
  return result;
}

/// ∂Y/∂ε = λ tr(ε⁺) P⁺ + 2 μ ε⁺ = α I + β ε + γ N. With one positive eigenvalue N is its projection, with two
/// that of the negative one, N = (ε - x)(ε - y) / ((v - x)(v - y)) with v its and x, y the other eigenvalues.
void release_rate_derivative(const Lanes* e, const Eigenvalues& v, const Lanes& trace, double lambda,
                             double mu, double* out, std::size_t stride) {
  const auto one = v.second <= 0.0;
  const auto three = v.third > 0.0;
  const Lanes zero = Lanes::Zero();
  const Lanes own = one.select(v.first, v.third);
  const Lanes x = one.select(v.third, v.first), y = v.second;
  const Lanes scale = (e[0].abs() + e[1].abs() + e[2].abs() + v.first.abs()).max(1e-100);
  const Lanes product = (own - x) * (own - y);
  const Lanes denominator = product.max(1e-14 * scale * scale);
  const Lanes none = v.first.max(0.0);  // no positive eigenvalue: everything is zero
  const Lanes alpha = (none > 0.0).select(one.select(zero, lambda * trace), zero);
  const Lanes beta = (none > 0.0).select(one.select(zero, Lanes::Constant(2.0 * mu)), zero);
  Lanes gamma = lambda * trace + 2.0 * mu * own;
  gamma = one.select(gamma, three.select(zero, -gamma));
  gamma = (none > 0.0).select(gamma, zero) / denominator;

  const Lanes d = 0.5 * e[3], f = 0.5 * e[4], g = 0.5 * e[5];
  const Lanes sum = x + y, constant = alpha + gamma * x * y, linear = beta - gamma * sum;
  const auto store = [&](int i, const Lanes& value) { Output(out + i * stride) = value; };
  store(0, constant + linear * e[0] + gamma * (e[0] * e[0] + d * d + g * g));
  store(1, constant + linear * e[1] + gamma * (e[1] * e[1] + d * d + f * f));
  store(2, constant + linear * e[2] + gamma * (e[2] * e[2] + f * f + g * g));
  store(3, linear * d + gamma * (d * (e[0] + e[1]) + f * g));
  store(4, linear * f + gamma * (f * (e[1] + e[2]) + d * g));
  store(5, linear * g + gamma * (g * (e[0] + e[2]) + d * f));
}

/// a of `band_damage`, for all lanes: its bracketed Newton iteration until every lane stands still.
/// `threshold` and `rate` times A_d.
Lanes band_excess(const Lanes& threshold, const Lanes& rate, double r) {
  const Lanes first = (rate - threshold).max(0.0), last = (rate / (r * r) - threshold).max(0.0);
  Lanes low = first.min(last), high = (first > 0.0).select(first.max(last), Lanes::Zero());
  Lanes a = r > 1 ? low : high;
  for (int i = 0; i < 100; ++i) {
    const Lanes scale = 1.0 / (1.0 + r * a), s = (1.0 + a) * scale;
    const Lanes f = a + threshold - rate * s * s;
    low = (f < 0.0).select(a, low);
    high = (f < 0.0).select(high, a);
    Lanes next = a - f / (1.0 + (2.0 * (r - 1.0)) * rate * s * scale * scale);
    next = (next >= low && next <= high).select(next, 0.5 * (low + high));
    next = (first > 0.0).select(next, Lanes::Zero());
    const bool still = ((next - a).abs() <= 4e-16 * (1.0 + a)).all();
    a = next;
    if (still) break;
  }
  return a;
}

}  // namespace

void evaluate_local_stage(const LocalStage& stage, const ElasticConstants& elastic) {
  const double lambda = elastic.lambda(), mu = elastic.mu();
  for (std::size_t lane = 0; lane < stage.lanes; lane += k_lanes) {
    Lanes e[6];
    for (std::size_t i = 0; i < 6; ++i) e[i] = Input(stage.strain + i * stage.lanes + lane);
    const Eigenvalues v = eigenvalues(e);
    const Lanes first = v.first.max(0.0), second = v.second.max(0.0), third = v.third.max(0.0);
    const Lanes trace = first + second + third;
    const Lanes rate = 0.5 * lambda * trace * trace + mu * (first * first + second * second + third * third);
    const Input brittleness(stage.brittleness + lane), history(stage.history + lane);
    const Lanes excess = (brittleness * (rate - Input(stage.threshold + lane))).max(0.0);
    Lanes intact, damage, slope;
    if (stage.band_ratio == 1) {
      intact = 1.0 / (1.0 + excess);
      damage = excess * intact;
      slope = brittleness * intact * intact;
    } else {
      const double r = stage.band_ratio;
      const Lanes threshold = brittleness * Input(stage.threshold + lane), scaled = brittleness * rate;
      const Lanes a = band_excess(threshold, scaled, r);
      intact = 1.0 / (1.0 + r * a);
      damage = r * a * intact;
      const Lanes s = (1.0 + a) * intact, square = intact * intact;
      slope = r * square * brittleness * s * s / (1.0 + (2.0 * (r - 1.0)) * scaled * s * square);
    }
    Output(stage.damage + lane) = damage.max(history);
    if (stage.slope == nullptr) continue;
    Output(stage.slope + lane) = (damage > history).select(slope, Lanes::Zero());
    release_rate_derivative(e, v, trace, lambda, mu, stage.derivative + lane, stage.lanes);
  }
}

}  // namespace knothe::offline
