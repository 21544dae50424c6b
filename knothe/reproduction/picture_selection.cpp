#include "knothe/reproduction/picture_selection.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>

#include "knothe/assimilation/select/data_selection.hpp"
#include "knothe/assimilation/select/selection_study.hpp"
#include "knothe/assimilation/select/sensitivity.hpp"
#include "knothe/assimilation/update/prior_of_model.hpp"
#include "knothe/imaging/correlation/image_correlation.hpp"
#include "knothe/imaging/mesh/registration.hpp"
#include "knothe/imaging/series/speckle.hpp"
#include "knothe/numerics/statistics/order_statistics.hpp"
#include "knothe/numerics/statistics/random.hpp"
#include "knothe/reproduction/published.hpp"

namespace knothe::reproduction {
namespace {

using Eigen::Index;

constexpr double k_scale = 0.25e-3;    // m per px
constexpr double k_half_width = 0.12;  // m, of the part that is looked at
constexpr double k_border = 2e-3;      // m, left out along the beam's outline
constexpr double k_element = 24;       // px
constexpr double k_margin = 20;        // px around the beam
constexpr std::size_t k_chosen = 30;

}  // namespace

Surface surface_of(const BeamCase& chosen, std::uint64_t seed) {
  const mechanics::BeamOptions& beam = chosen.problem.beam;
  const mechanics::BeamGrid grid = mechanics::beam_grid(beam);
  const auto px = [](double metres) { return metres / k_scale; };
  imaging::SpeckleOptions speckle;
  speckle.width = static_cast<int>(std::lround(px(2 * k_half_width) + 2 * k_margin));
  speckle.height = static_cast<int>(std::lround(px(beam.height) + 2 * k_margin));
  speckle.seed = seed;
  const files::Picture reference = imaging::SpecklePattern(speckle).render();
  imaging::PictureFrame frame =
      imaging::picture_frame(k_scale, {k_margin + px(k_half_width), k_margin + px(beam.height)});
  frame.plane = beam.half_thickness;

  files::Picture mask = reference;
  for (int j = 0; j < mask.height; ++j)
    for (int i = 0; i < mask.width; ++i) {
      const auto point = frame.model_point(i, j);
      // One pixel more on each side: nodes must lie in the beam's own mesh.
      const bool notch =
          std::abs(point[0]) < grid.notch_half_width + k_scale && point[1] < grid.notch_depth + k_scale;
      mask.at(i, j) = notch ? 0.0F : 1.0F;
    }
  const auto upper_left = frame.picture_point({-k_half_width, beam.height - k_border, 0});
  const auto lower_right = frame.picture_point({k_half_width, k_border, 0});
  const imaging::Region region{upper_left[0], upper_left[1], lower_right[0], lower_right[1]};
  Surface surface;
  surface.quadrilaterals = imaging::masked(imaging::structured_mesh(region, k_element), mask, 0.999);
  const imaging::ImageCorrelation correlation(reference, imaging::triangulated(surface.quadrilaterals));
  surface.matrix = frame.to_model(correlation.matrix());
  for (std::size_t a = 0; a < surface.quadrilaterals.x.size(); ++a) {
    const auto point = frame.model_point(surface.quadrilaterals.x[a], surface.quadrilaterals.y[a]);
    surface.x.push_back(point[0]);
    surface.y.push_back(point[1]);
    for (const int component : frame.components()) {
      surface.sensors.add(point, component);
    }
  }
  return surface;
}

PublishedSelection select_as_published(const reduction::SeparatedModel& model, const Surface& surface,
                                       const Eigen::VectorXd& p, std::size_t step) {
  PublishedSelection selection;
  selection.sensitivity =
      assimilation::sensitivity_fields(*observed(model, surface.sensors), p, step).cwiseAbs();
  selection.product = selection.sensitivity.col(0).cwiseProduct(selection.sensitivity.col(1));
  selection.weighted = surface.matrix * selection.product;
  const Eigen::Map<const Eigen::Matrix<double, 3, Eigen::Dynamic>> points(
      surface.sensors.points.data(), 3, static_cast<Index>(surface.sensors.size()));
  selection.dofs = assimilation::highest(selection.weighted.cwiseAbs(), k_chosen, points.transpose(), 0);
  return selection;
}

assimilation::NoiseModel white_noise(const Surface& surface) {
  return assimilation::NoiseModel::independent(
      Eigen::VectorXd::Constant(static_cast<Index>(surface.sensors.size()), published::k_noise_std));
}

assimilation::NoiseModel correlation_noise(const Surface& surface) {
  // In units of the largest entry, so that no threshold of a factorisation is met.
  const Eigen::SparseMatrix<double> matrix = surface.matrix / surface.matrix.diagonal().maxCoeff();
  const double std =
      numerics::upper_median(assimilation::NoiseModel::correlated(matrix).standard_deviations());
  return assimilation::NoiseModel::correlated(matrix * std::pow(std / published::k_noise_std, 2));
}

std::vector<Index> select_d_optimal(const reduction::SeparatedModel& model, const Surface& surface,
                                    const Eigen::VectorXd& p, const assimilation::NoiseModel& noise) {
  const auto seen = observed(model, surface.sensors);
  const auto n = static_cast<Index>(surface.sensors.size());
  Eigen::VectorXd prior_std(p.size());
  const auto priors = assimilation::truncated_to_box(*seen, paper_priors());
  for (Index k = 0; k < p.size(); ++k) prior_std[k] = assimilation::standard_deviation(priors->prior(k));
  const Eigen::Map<const Eigen::Matrix<double, 3, Eigen::Dynamic>> points(surface.sensors.points.data(), 3,
                                                                          n);
  const assimilation::SensorDesign design(*seen, noise, prior_std, p.transpose(), points.transpose());
  return design.choose(k_chosen).dofs;
}

std::vector<Index> select_at_random(const Surface& surface, std::uint64_t seed) {
  std::vector<Index> all(surface.sensors.size());
  std::iota(all.begin(), all.end(), Index{0});
  std::mt19937_64 random(seed);
  // Fisher-Yates with remainders: the same on every standard library.
  for (std::size_t i = 0; i < k_chosen; ++i) std::swap(all[i], all[i + random() % (all.size() - i)]);
  all.resize(k_chosen);
  return all;
}

WhereChosen where_chosen(const Surface& surface, const std::vector<Index>& dofs) {
  WhereChosen where;
  for (const Index dof : dofs) {
    const auto i = static_cast<std::size_t>(dof);
    where.right += surface.sensors.points[3 * i] > 0 ? 1 : 0;
    where.horizontal += surface.sensors.components[i] == 0 ? 1 : 0;
  }
  where.right /= static_cast<double>(dofs.size());
  where.horizontal /= static_cast<double>(dofs.size());
  return where;
}

Run assimilate_chosen(const reduction::SeparatedModel& model, const Sensors& chosen,
                      const Eigen::VectorXd& truth, std::uint64_t seed, bool marginals) {
  const auto seen = observed(model, chosen);
  RunOptions options;
  options.update = default_options(seed);
  options.marginals = marginals;
  return assimilate(seen, measure(predicted(*seen, truth), chosen, seen->time, seed), options);
}

Run assimilate_chosen(const reduction::SeparatedModel& model, const Surface& surface, std::vector<Index> dofs,
                      const Eigen::VectorXd& truth, const assimilation::NoiseModel& noise,
                      std::uint64_t seed) {
  std::sort(dofs.begin(), dofs.end());
  const Sensors chosen = part_of(surface.sensors, dofs);
  const auto seen = observed(model, chosen);
  assimilation::Measurements data = measure(predicted(*seen, truth), chosen, seen->time, seed);
  data.noise = noise.restricted(dofs);
  // R⁻¹ = L Lᵀ: L⁻ᵀ z has the covariance R.
  const Index n = seen->observations();
  const Eigen::LLT<Eigen::MatrixXd> precision(data.noise.apply(Eigen::MatrixXd::Identity(n, n)));
  data.values =
      predicted(*seen, truth) + precision.matrixU().solve(numerics::monte_carlo_normal_points(
                                    n, static_cast<Index>(seen->time.size()), static_cast<unsigned>(seed)));
  RunOptions options;
  options.update = default_options(seed);
  return assimilate(seen, data, options);
}

}  // namespace knothe::reproduction
