#include "knothe/assimilation/inference/derivative_check.hpp"

#include <fmt/format.h>

#include <cmath>

namespace knothe::assimilation {
namespace {

constexpr Eigen::Index k_points = 3;
/// Standardised coordinates of the points: inside every prior, at none of its special places.
constexpr double k_places[k_points] = {0.31, -0.62, 1.07};
constexpr double k_wrong = 0.02, k_of_steepest = 1e-3, k_own_errors = 10;
constexpr double k_step = 1e-3;  ///< in standardised coordinates
constexpr double k_zero_density = -1e300;

/// One parameter's derivative (in units of one standardised coordinate) by the model and by differences.
struct Pair {
  double model = 0, difference = 0;
  double error = 0;  ///< of the difference
  double terms = 0;  ///< sum of the sizes of its terms
};

class Check {
 public:
  Check(ModelEvaluator& evaluator, const std::vector<posterior::Prior>& priors)
      : evaluator_(evaluator), d_(std::ssize(priors)), points_(d_, k_points) {
    scale_.resize(d_, k_points);
    for (Eigen::Index i = 0; i < k_points; ++i)
      for (Eigen::Index k = 0; k < d_; ++k) {
        // Another place for each parameter: a wrong sign may hide where all are alike.
        const double z = k_places[(i + k) % k_points] * (k / k_points % 2 == 0 ? 1 : -1);
        const auto p = priors[k].from_standard_normal(z);
        points_(k, i) = p.value, scale_(k, i) = p.first;
      }
  }

  /// Differences of the values with steps of `step` standardised units: (m·d) × n, in units of one of them.
  [[nodiscard]] Eigen::MatrixXd slopes(double step) {
    const Eigen::Index m = evaluator_.model().output_count();
    Eigen::MatrixXd shifted = both_sides(step), values, out(m * d_, k_points);
    evaluator_.evaluate(shifted, values);
    for (Eigen::Index c = 0; c < k_points * d_; ++c) {
      const auto up = values.col(2 * c), down = values.col(2 * c + 1);
      if (up.minCoeff() <= k_zero_density || down.minCoeff() <= k_zero_density) usable_[c / d_] = false;
      out.col(c / d_).segment(c % d_ * m, m) = (up - down) / (2 * step);
    }
    return out;
  }
  /// Column 2 (i d + k) and the next: point i moved along parameter k, up and down.
  [[nodiscard]] Eigen::MatrixXd both_sides(double step) const {
    Eigen::MatrixXd shifted(d_, 2 * d_ * k_points);
    for (Eigen::Index i = 0; i < k_points; ++i)
      for (Eigen::Index k = 0; k < d_; ++k)
        for (const int side : {0, 1}) {
          auto point = shifted.col(2 * (i * d_ + k) + side);
          point = points_.col(i);
          point[k] += (side == 0 ? step : -step) * scale_(k, i);
        }
    return shifted;
  }

  /// The worst of d pairs at one point, as a clause; empty if none is wrong.
  [[nodiscard]] std::string worst_mismatch(const std::vector<Pair>& pairs, Eigen::Index point,
                                           const char* what, const std::vector<std::string>& names) const {
    double steepest = 0;
    for (const Pair& pair : pairs) steepest = std::max(steepest, pair.terms);
    std::string clause;
    double worst = 1;
    for (std::size_t k = 0; k < pairs.size(); ++k) {
      const Pair& pair = pairs[k];
      const double allowed =
          k_wrong * pair.terms + k_own_errors * pair.error + k_of_steepest * steepest + 1e-280;
      const double ratio = std::abs(pair.model - pair.difference) / allowed;
      if (!(ratio > worst)) continue;
      worst = ratio;
      const double unit = scale_(k, point);
      std::string place;
      for (Eigen::Index j = 0; j < d_; ++j)
        place += fmt::format("{}{} = {:.4g}", j > 0 ? ", " : "", name(names, j), points_(j, point));
      clause = fmt::format("at {} it says {:.6g} along {} where differences say {:.6g}", place,
                           pair.model / unit, name(names, k), pair.difference / unit);
    }
    if (clause.empty()) return "";
    return fmt::format("{}: {} is wrong: {}; it is not used, differences take its place",
                       evaluator_.model().where(), what, clause);
  }

  [[nodiscard]] std::string gradient(const Eigen::MatrixXd& near, const Eigen::MatrixXd& far,
                                     const std::vector<std::string>& names) {
    const Eigen::Index m = evaluator_.model().output_count();
    const Eigen::MatrixXd sensitivities = weights(near);
    Eigen::MatrixXd gradients;
    evaluator_.gradient(points_, sensitivities, gradients);
    for (Eigen::Index i = 0; i < k_points; ++i) {
      if (!usable_[i]) continue;
      std::vector<Pair> pairs(d_);
      for (Eigen::Index k = 0; k < d_; ++k) {
        const auto slope = near.col(i).segment(k * m, m), rough = far.col(i).segment(k * m, m);
        const auto s = sensitivities.col(i);
        pairs[k] = {gradients(k, i) * scale_(k, i), s.dot(slope),
                    s.cwiseAbs().dot((rough - slope).cwiseAbs()), s.cwiseAbs().dot(slope.cwiseAbs())};
      }
      if (std::string text = worst_mismatch(pairs, i, "Gradient", names); !text.empty()) return text;
    }
    return "";
  }

  [[nodiscard]] std::string jacobian(const Eigen::MatrixXd& near, const Eigen::MatrixXd& far,
                                     const std::vector<std::string>& names) {
    const Eigen::Index m = evaluator_.model().output_count();
    Eigen::MatrixXd jacobians;
    evaluator_.jacobian(points_, jacobians);
    for (Eigen::Index i = 0; i < k_points; ++i) {
      if (!usable_[i]) continue;
      for (Eigen::Index r = 0; r < m; ++r) {
        std::vector<Pair> pairs(d_);
        for (Eigen::Index k = 0; k < d_; ++k) {
          const double slope = near(k * m + r, i);
          pairs[k] = {jacobians(k * m + r, i) * scale_(k, i), slope, std::abs(far(k * m + r, i) - slope),
                      std::abs(slope)};
        }
        if (std::string text = worst_mismatch(pairs, i, "ApplyJacobian", names); !text.empty()) return text;
      }
    }
    return "";
  }

  /// ∂(Jᵀ s)/∂p along each parameter against the row of the Hessian, judged by its own d entries.
  [[nodiscard]] std::string hessian(const Eigen::MatrixXd& near, const std::vector<std::string>& names) {
    const Eigen::MatrixXd sensitivities = weights(near);
    Eigen::MatrixXd hessians;
    evaluator_.hessian(points_, sensitivities, hessians);
    const Eigen::MatrixXd fine = curvatures(sensitivities, k_step),
                          rough = curvatures(sensitivities, 4 * k_step);
    for (Eigen::Index i = 0; i < k_points; ++i) {
      if (!usable_[i]) continue;
      for (Eigen::Index a = 0; a < d_; ++a) {
        std::vector<Pair> pairs(d_);
        for (Eigen::Index k = 0; k < d_; ++k) {
          const double slope = fine(k * d_ + a, i);
          pairs[k] = {hessians(k * d_ + a, i) * scale_(k, i), slope, std::abs(rough(k * d_ + a, i) - slope),
                      std::abs(slope)};
        }
        if (std::string text = worst_mismatch(pairs, i, "ApplyHessian", names); !text.empty()) return text;
      }
    }
    return "";
  }

  [[nodiscard]] bool anything_usable() const { return usable_[0] || usable_[1] || usable_[2]; }

 private:
  [[nodiscard]] static std::string name(const std::vector<std::string>& names, Eigen::Index k) {
    const std::size_t i = k;
    return i < names.size() ? names[i] : fmt::format("p[{}]", k);
  }
  /// One weight per output, of both signs, under which all outputs are of the same steepness.
  [[nodiscard]] Eigen::MatrixXd weights(const Eigen::MatrixXd& slopes) const {
    const Eigen::Index m = evaluator_.model().output_count();
    Eigen::MatrixXd s(m, k_points);
    for (Eigen::Index i = 0; i < k_points; ++i)
      for (Eigen::Index r = 0; r < m; ++r) {
        double steepest = 0;
        for (Eigen::Index k = 0; k < d_; ++k) steepest = std::max(steepest, std::abs(slopes(k * m + r, i)));
        s(r, i) = m == 1 || !(steepest > 0) ? 1 : (r % 3 == 1 ? -1 : 1) / steepest;
      }
    return s;
  }
  [[nodiscard]] Eigen::MatrixXd curvatures(const Eigen::MatrixXd& sensitivities, double step) {
    const Eigen::MatrixXd shifted = both_sides(step);
    Eigen::MatrixXd repeated(sensitivities.rows(), shifted.cols()), g, out(d_ * d_, k_points);
    for (Eigen::Index c = 0; c < shifted.cols(); ++c) repeated.col(c) = sensitivities.col(c / (2 * d_));
    if (evaluator_.has_gradient()) {
      evaluator_.gradient(shifted, repeated, g);
    } else {
      Eigen::MatrixXd jacobians;
      evaluator_.jacobian(shifted, jacobians);
      g.resize(d_, shifted.cols());
      for (Eigen::Index c = 0; c < shifted.cols(); ++c)
        g.col(c) = jacobians.col(c).reshaped(repeated.rows(), d_).transpose() * repeated.col(c);
    }
    for (Eigen::Index c = 0; c < k_points * d_; ++c)
      out.col(c / d_).segment(c % d_ * d_, d_) = (g.col(2 * c) - g.col(2 * c + 1)) / (2 * step);
    return out;
  }

  ModelEvaluator& evaluator_;
  Eigen::Index d_;
  Eigen::MatrixXd points_, scale_;  ///< d × n: p, and dp/dz
  bool usable_[k_points] = {true, true, true};
};

}  // namespace

std::vector<std::string> check_derivatives(ModelEvaluator& evaluator,
                                           const std::vector<posterior::Prior>& priors,
                                           const std::vector<std::string>& names) {
  std::vector<std::string> complaints;
  if (!evaluator.has_gradient() && !evaluator.has_jacobian() && !evaluator.has_hessian()) return complaints;
  Check check(evaluator, priors);
  const Eigen::MatrixXd near = check.slopes(k_step), far = check.slopes(4 * k_step);
  if (!check.anything_usable()) return complaints;
  OwnDerivatives use;
  const auto note = [&](std::string text, bool& flag) {
    if (text.empty()) return;
    flag = false;
    evaluator.use(use);
    complaints.push_back(std::move(text));
  };
  if (evaluator.has_gradient()) note(check.gradient(near, far, names), use.gradient);
  if (evaluator.has_jacobian()) note(check.jacobian(near, far, names), use.jacobian);
  // A Hessian is compared with differences of first derivatives; of wrong ones it proves nothing.
  if (evaluator.has_hessian() && (evaluator.has_gradient() || evaluator.has_jacobian()))
    note(check.hessian(near, names), use.hessian);
  return complaints;
}

}  // namespace knothe::assimilation
