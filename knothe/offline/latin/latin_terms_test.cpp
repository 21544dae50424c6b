#include "knothe/offline/latin/latin_terms.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "knothe/model/compress/low_rank.hpp"
#include "knothe/offline/latin/latin_separation.hpp"

namespace knothe::offline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr Index k_modes = 4, k_times = 5;

LatinGrid small_grid() {
  LatinGrid grid{{3, 2}, {VectorXd(3), VectorXd(2)}};
  grid.weights[0] << 0.25, 0.5, 0.25;
  grid.weights[1] << 0.5, 0.5;
  return grid;
}

/// Σ_t Σ_p w_p (½ cᵀ K c − fᵀ c): what every update and every new term lowers.
double projected_energy(const LatinProjection& projection, const LatinTerms& terms) {
  const Index r = terms.space.rows();
  double energy = 0;
  for (int step = 0; step < projection.steps(); ++step) {
    const auto t = static_cast<std::size_t>(step);
    const MatrixXd c = terms.coordinates(step);
    for (Index p = 0; p < c.cols(); ++p) {
      const Eigen::Map<const MatrixXd> stiffness(projection.stiffness[t].col(p).data(), r, r);
      energy += projection.weights[p] *
                (0.5 * c.col(p).dot(stiffness * c.col(p)) - projection.load[t].col(p).dot(c.col(p)));
    }
  }
  return energy;
}

/// Projected equations of a body that is softer in another way at each (t, p): K is I less a random part.
LatinProjection softened_body(const LatinGrid& grid) {
  LatinProjection projection;
  projection.weights = grid.point_weights();
  for (Index t = 0; t < k_times; ++t) {
    projection.stiffness.emplace_back(k_modes * k_modes, grid.points());
    projection.load.push_back(
        model::normal_matrix(k_modes, grid.points(), 100 + static_cast<std::uint64_t>(t)));
    for (Index p = 0; p < grid.points(); ++p) {
      const MatrixXd a = model::normal_matrix(k_modes, k_modes, static_cast<std::uint64_t>(10 * t + p) + 1);
      const MatrixXd stiffness = 0.2 * MatrixXd::Identity(k_modes, k_modes) + 0.1 * a * a.transpose();
      projection.stiffness.back().col(p) = stiffness.reshaped();
    }
  }
  return projection;
}

/// −½ Σ w fᵀ K⁻¹ f: the least energy of all, found for each (t, p) alone.
double least_energy(const LatinProjection& projection) {
  double energy = 0;
  for (std::size_t t = 0; t < projection.stiffness.size(); ++t)
    for (Index p = 0; p < projection.weights.size(); ++p) {
      const MatrixXd stiffness = projection.stiffness[t].col(p).reshaped(k_modes, k_modes);
      const VectorXd f = projection.load[t].col(p);
      VectorXd x = VectorXd::Zero(k_modes);
      for (int i = 0; i < 4000; ++i)
        x += 0.3 * (f - stiffness * x);  // Richardson: shares nothing with the updates
      energy -= 0.5 * projection.weights[p] * f.dot(x);
    }
  return energy;
}

/// Rank-one functions of a projected direction at the terms' state, as the fixed point has them.
RankOne functions_of(const LatinProjection& projection, const LatinTerms& terms, const VectorXd& mode,
                     const LatinGrid& grid) {
  MatrixXd a(k_times, grid.points()), b(k_times, grid.points());
  for (Index t = 0; t < k_times; ++t) {
    const MatrixXd c =
        terms.count() > 0 ? terms.coordinates(t) : MatrixXd(MatrixXd::Zero(k_modes, grid.points()));
    for (Index p = 0; p < grid.points(); ++p) {
      const MatrixXd stiffness =
          projection.stiffness[static_cast<std::size_t>(t)].col(p).reshaped(k_modes, k_modes);
      a(t, p) = mode.dot(stiffness * mode);
      b(t, p) = mode.dot(projection.load[static_cast<std::size_t>(t)].col(p) - stiffness * c.col(p));
    }
  }
  return rank_one_functions(a, b, grid);
}

TEST(LatinTerms, EveryTermAndEveryUpdateLowersTheEnergyDownToTheSolutionAtEachPoint) {
  // Linear equations: damage stays as it is. 30 terms have room for any c(t, p).
  const LatinGrid grid = small_grid();
  const LatinProjection projection = softened_body(grid);
  const double least = least_energy(projection);
  LatinTerms terms;
  terms.parameters = {MatrixXd(3, 0), MatrixXd(2, 0)};
  double before = 0;
  for (int m = 1; m <= 30; ++m) {
    const VectorXd mode = VectorXd::Unit(k_modes, m % k_modes);
    const RankOne functions = functions_of(projection, terms, mode, grid);
    terms.append(mode, functions.time, functions.parameters);
    terms.normalise();
    const double with_term = projected_energy(projection, terms);
    EXPECT_LT(with_term, before - 1e-12 * std::abs(least)) << m;
    update_functions(projection, terms, 2, 1, 1);
    const double updated = projected_energy(projection, terms);
    EXPECT_LE(updated, with_term + 1e-9 * std::abs(least)) << m;
    update_space(projection, terms, 1, 1);
    before = projected_energy(projection, terms);
    EXPECT_LE(before, updated + 1e-9 * std::abs(least)) << m;
    EXPECT_GE(before, least * (1 + 1e-12)) << m;
    if (before - least < 1e-6 * std::abs(least)) break;
  }
  EXPECT_LT(before - least, 1e-4 * std::abs(least));
}

TEST(LatinTerms, AProductIsFoundAsOneTerm) {
  const LatinGrid grid = small_grid();
  LatinTerms exact;
  exact.time = VectorXd::LinSpaced(k_times, 1, -2);
  exact.parameters = {VectorXd::LinSpaced(3, 0.5, 1.5), VectorXd::LinSpaced(2, -1, 3)};
  const MatrixXd c = exact.time * exact.on_grid().transpose();
  const MatrixXd a = model::normal_matrix(k_times, grid.points(), 5).cwiseAbs().array() + 0.1;
  const RankOne found = rank_one_functions(a, a.cwiseProduct(c), grid);
  EXPECT_LT((found.values() - c).norm(), 1e-3 * c.norm());
}

TEST(LatinTerms, TermsThatAreNotNeededGo) {
  const LatinGrid grid = small_grid();
  LatinTerms terms{model::normal_matrix(k_modes, 3, 1),
                   model::normal_matrix(k_times, 3, 2),
                   {model::normal_matrix(3, 3, 3), model::normal_matrix(2, 3, 4)}};
  terms.space.col(2) = terms.space.col(1);  // terms 1 and 2 are one
  terms.parameters[0].col(2) = terms.parameters[0].col(1);
  terms.parameters[1].col(2) = terms.parameters[1].col(1);
  const LatinTerms fewer = with_fewer_terms(terms, grid, 10, 1e-6);
  ASSERT_EQ(fewer.count(), 2);
  for (Index t = 0; t < k_times; ++t)
    EXPECT_LT((fewer.coordinates(t) - terms.coordinates(t)).norm(), 1e-5 * terms.coordinates(t).norm());
  std::vector<MatrixXd> coordinates;
  for (Index t = 0; t < k_times; ++t) coordinates.push_back(terms.coordinates(t));
  EXPECT_EQ(separate(coordinates, grid, 10, 1e-4).count(), 2);
  EXPECT_EQ(with_fewer_terms(terms, grid, 1, 0).count(), 1);
}

}  // namespace
}  // namespace knothe::offline
