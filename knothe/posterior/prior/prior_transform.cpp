#include "knothe/posterior/prior/prior_transform.hpp"

#include <cmath>
#include <cstddef>

namespace knothe::posterior {

PriorTransform::PriorTransform(std::vector<Prior> priors)
    : priors_(std::move(priors)), table_(priors_.size()) {
  for (std::size_t k = 0; k < priors_.size(); ++k) {
    if (!priors_[k].is_affine()) tabulate(k);
  }
}

void PriorTransform::tabulate(std::size_t k) {
  constexpr double h = 1.0 / k_per_unit;
  table_[k].resize(k_intervals);
  Prior::Transformed left = priors_[k].from_standard_normal(-k_range);
  for (int i = 0; i < k_intervals; ++i) {
    const Prior::Transformed right = priors_[k].from_standard_normal(-k_range + (i + 1) * h);
    const double d0 = h * left.first, d1 = h * right.first;
    const double s0 = h * h * left.second, s1 = h * h * right.second;
    const double rise = right.value - left.value;
    table_[k][i] = {{left.value, d0, 0.5 * s0, 10 * rise - 6 * d0 - 4 * d1 - 1.5 * s0 + 0.5 * s1,
                     -15 * rise + 8 * d0 + 7 * d1 + 1.5 * s0 - s1,
                     6 * rise - 3 * (d0 + d1) - 0.5 * (s0 - s1)}};
    left = right;
  }
}

void PriorTransform::evaluate(const Eigen::Ref<const Eigen::MatrixXd>& z, int derivatives,
                              Eigen::Ref<Eigen::MatrixXd> p, Eigen::Ref<Eigen::MatrixXd> first,
                              Eigen::Ref<Eigen::MatrixXd> second) const {
  const Eigen::Index n = z.rows();
  for (Eigen::Index k = 0; k < dimension(); ++k) {
    const Prior& prior = priors_[k];
    if (prior.is_affine()) {
      const auto [location, scale, zero] = prior.from_standard_normal(0.0);
      p.col(k) = (location + scale * z.col(k).array()).matrix();
      if (derivatives >= 1) first.col(k).setConstant(scale);
      if (derivatives >= 2) second.col(k).setConstant(zero);
      continue;
    }
    const Quintic* table = table_[k].data();
    const double least = prior.lower(), most = prior.upper();
    for (Eigen::Index i = 0; i < n; ++i) {
      const double place = (z(i, k) + k_range) * k_per_unit;
      if (!(place >= 0 && place < k_intervals)) {
        const Prior::Transformed exact = prior.from_standard_normal(z(i, k));
        p(i, k) = exact.value;
        if (derivatives >= 1) first(i, k) = exact.first;
        if (derivatives >= 2) second(i, k) = exact.second;
        continue;
      }
      const int interval = static_cast<int>(place);
      const double t = place - interval;
      const double* c = table[interval].c;
      const double value = c[0] + t * (c[1] + t * (c[2] + t * (c[3] + t * (c[4] + t * c[5]))));
      p(i, k) = value < least ? least : value > most ? most : value;
      if (derivatives >= 1) {
        first(i, k) = k_per_unit * (c[1] + t * (2 * c[2] + t * (3 * c[3] + t * (4 * c[4] + t * 5 * c[5]))));
      }
      if (derivatives >= 2) {
        second(i, k) =
            k_per_unit * k_per_unit * (2 * c[2] + t * (6 * c[3] + t * (12 * c[4] + t * 20 * c[5])));
      }
    }
  }
}

Eigen::MatrixXd PriorTransform::carry(const Eigen::Ref<const Eigen::MatrixXd>& z_quantiles) const {
  return Eigen::MatrixXd::NullaryExpr(z_quantiles.rows(), z_quantiles.cols(),
                                      [&](Eigen::Index k, Eigen::Index level) {
                                        return priors_[k].from_standard_normal(z_quantiles(k, level)).value;
                                      });
}

}  // namespace knothe::posterior
