#include "knothe/posterior/prior/prior_transform.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

#include "knothe/posterior/prior/joint_prior.hpp"

namespace knothe::posterior {

PriorTransform::PriorTransform(std::vector<Prior> priors)
    : priors_(std::move(priors)), table_(priors_.size()) {
  for (std::size_t k = 0; k < priors_.size(); ++k) {
    if (!priors_[k].is_affine()) tabulate(k);
  }
  find_groups();
}

void PriorTransform::find_groups() {
  std::vector<bool> found(priors_.size(), false);
  for (Eigen::Index first = 0; first < dimension(); ++first) {
    const auto& joint = priors_[first].joint();
    if (!joint || found[first]) continue;
    std::vector<Eigen::Index> parameters, columns;
    for (Eigen::Index k = first; k < dimension(); ++k) {
      if (priors_[k].joint() != joint) continue;
      found[k] = true;
      parameters.push_back(k), columns.push_back(priors_[k].column());
    }
    groups_.push_back({std::move(parameters), joint->marginal(columns)});
    groups_.back().log_mass = log_mass_inside(groups_.back());
  }
}

/// By draws. That some of it is inside `Prior::truncated` sees to, parameter by parameter.
double PriorTransform::log_mass_inside(const Group& group) const {
  constexpr Eigen::Index k_draws = 20'000;
  RandomNumbers random(1);
  const Eigen::MatrixXd draws = group.mixture.sample(k_draws, random);
  double inside = 0;
  for (Eigen::Index i = 0; i < k_draws; ++i) inside += is_inside(group, draws.row(i).transpose()) ? 1 : 0;
  return std::log(std::max(inside, 1.0) / k_draws);
}

bool PriorTransform::is_inside(const Group& group, const Eigen::Ref<const Eigen::VectorXd>& p) const {
  for (Eigen::Index j = 0; j < p.size(); ++j) {
    const Prior& prior = priors_[group.parameters[j]];
    if (!(p[j] >= prior.lower() && p[j] <= prior.upper())) return false;
  }
  return true;
}

void PriorTransform::add_dependence(const Eigen::Ref<const Eigen::MatrixXd>& p, int derivatives,
                                    LogDensityBatch& out) const {
  LogDensityBatch joint;
  for (const Group& group : groups_) {
    group.mixture.evaluate(p(Eigen::all, group.parameters), derivatives, joint);
    out.value.array() += joint.value.array() - group.log_mass;
    for (Eigen::Index j = 0; j < std::ssize(group.parameters); ++j) {
      const Eigen::Index k = group.parameters[j];
      const Prior& prior = priors_[k];
      for (Eigen::Index i = 0; i < p.rows(); ++i) {
        // p(z) may be outside by its rounding, where the density is zero.
        out.value[i] -= prior.log_density(std::clamp(p(i, k), prior.lower(), prior.upper()));
        if (derivatives >= 1) out.gradient(i, k) += joint.gradient(i, j) - prior.log_density_slope(p(i, k));
        if (derivatives >= 2) out.hessian(i, packed_index(k, k)) -= prior.log_density_curvature(p(i, k));
      }
      if (derivatives < 2) continue;
      for (Eigen::Index l = 0; l <= j; ++l)
        out.hessian.col(packed_index(k, group.parameters[l])) += joint.hessian.col(packed_index(j, l));
    }
  }
}

void PriorTransform::add_log_density(const Eigen::Ref<const Eigen::MatrixXd>& p, int derivatives,
                                     LogDensityBatch& out) const {
  for (Eigen::Index k = 0; k < dimension(); ++k)
    for (Eigen::Index i = 0; i < p.rows(); ++i) {
      out.value[i] += priors_[k].log_density(p(i, k));
      if (derivatives >= 1) out.gradient(i, k) += priors_[k].log_density_slope(p(i, k));
      if (derivatives >= 2) out.hessian(i, packed_index(k, k)) += priors_[k].log_density_curvature(p(i, k));
    }
  add_dependence(p, derivatives, out);
}

Eigen::MatrixXd PriorTransform::covariance() const {
  Eigen::MatrixXd z = Eigen::MatrixXd::Identity(dimension(), dimension());
  for (const Group& group : groups_)
    for (const Eigen::Index a : group.parameters)
      for (const Eigen::Index b : group.parameters) {
        const Eigen::MatrixXd& c = priors_[a].joint()->covariance();
        const Eigen::Index i = priors_[a].column(), j = priors_[b].column();
        z(a, b) = c(i, j) / std::sqrt(c(i, i) * c(j, j));
      }
  return z;
}

Eigen::MatrixXd PriorTransform::points(const Eigen::Ref<const Eigen::MatrixXd>& normal) const {
  Eigen::MatrixXd p(normal.rows(), normal.cols()), none;
  evaluate(normal, 0, p, none, none);
  for (const Group& group : groups_) {
    RandomNumbers random(1);  // for what lies outside the support
    Eigen::MatrixXd drawn = group.mixture.points(normal(Eigen::all, group.parameters));
    for (Eigen::Index i = 0; i < drawn.rows(); ++i)
      for (int tries = 0; tries < 1000 && !is_inside(group, drawn.row(i).transpose()); ++tries)
        drawn.row(i) = group.mixture.sample(1, random);
    p(Eigen::all, group.parameters) = drawn;
  }
  return p;
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
