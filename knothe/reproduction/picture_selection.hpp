#pragma once
/// @file §6.5: which of the displacements that a camera measures are worth assimilating.
#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <cstdint>
#include <vector>

#include "knothe/imaging/mesh/image_mesh.hpp"
#include "knothe/reproduction/beam_case.hpp"
#include "knothe/reproduction/experiment.hpp"

namespace knothe::reproduction {

/// The central part of the beam (|x| ≤ 120 mm) as image correlation sees it: a speckle picture of 0.25 mm a
/// pixel and a mesh of linear triangles of 6 mm on it, without those that touch the notch.
struct Surface {
  imaging::ImageMesh quadrilaterals;   ///< pairs of triangles, for drawing; nodes as below
  std::vector<double> x, y;            ///< of the nodes, m
  Sensors sensors;                     ///< x and y displacement of each node, in turn
  Eigen::SparseMatrix<double> matrix;  ///< M_DIC in the model's directions, 2 n × 2 n
};
[[nodiscard]] Surface surface_of(const BeamCase& chosen, std::uint64_t seed);

/// The sensitivities of Eq. 34 at the dofs of the surface, and what is chosen by them.
struct PublishedSelection {
  Eigen::MatrixXd sensitivity;     ///< n × 2: |S_1|, |S_2|, m
  Eigen::VectorXd product;         ///< S_12 = S_1 S_2, m²
  Eigen::VectorXd weighted;        ///< M_DIC S_12
  std::vector<Eigen::Index> dofs;  ///< the 30 of the largest |M_DIC S_12|
};
[[nodiscard]] PublishedSelection select_as_published(const reduction::SeparatedModel& model,
                                                     const Surface& surface, const Eigen::VectorXd& p,
                                                     std::size_t step);
/// Noise of the surface's dofs: white, 1 µm.
[[nodiscard]] assimilation::NoiseModel white_noise(const Surface& surface);
/// That of image correlation, N(0, 2γ² M_DIC⁻¹), with the γ for which the median std is 1 µm.
[[nodiscard]] assimilation::NoiseModel correlation_noise(const Surface& surface);
/// 30 dofs chosen greedily by the information of all steps about the parameters, with this noise.
[[nodiscard]] std::vector<Eigen::Index> select_d_optimal(const reduction::SeparatedModel& model,
                                                         const Surface& surface, const Eigen::VectorXd& p,
                                                         const assimilation::NoiseModel& noise);
/// 30 dofs at random, each at most once.
[[nodiscard]] std::vector<Eigen::Index> select_at_random(const Surface& surface, std::uint64_t seed);

/// Share of the chosen dofs that lie right of mid-span, and that are horizontal.
struct WhereChosen {
  double right = 0, horizontal = 0;
};
[[nodiscard]] WhereChosen where_chosen(const Surface& surface, const std::vector<Eigen::Index>& dofs);

/// Assimilates what `model` predicts at `truth` at the chosen dofs, with noise of 1 µm.
[[nodiscard]] Run assimilate_chosen(const reduction::SeparatedModel& model, const Sensors& chosen,
                                    const Eigen::VectorXd& truth, std::uint64_t seed, bool marginals);
/// The same at these dofs of the surface, with the correlated `noise` of all of them in the data and in the
/// likelihood.
[[nodiscard]] Run assimilate_chosen(const reduction::SeparatedModel& model, const Surface& surface,
                                    std::vector<Eigen::Index> dofs, const Eigen::VectorXd& truth,
                                    const assimilation::NoiseModel& noise, std::uint64_t seed);

}  // namespace knothe::reproduction
