#pragma once
/// @file The model at the observed dofs: y_t(p) = lift_t + (O U) C_t w(p).
#include <Eigen/Core>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "knothe/base/index.hpp"
#include "knothe/model/reduced/parameter_functions.hpp"
#include "knothe/model/reduced/separated_model.hpp"

namespace knothe::model {

/// All that assimilation needs of a model: y_t(p) = lift.col(t) + space · core[t] · w(p).
struct ObservedModel {
  std::shared_ptr<const ParameterFunctions> functions;  ///< w: d → r
  std::vector<std::string> parameters;                  ///< names, in the order of w's arguments
  std::vector<double> time;                             ///< n_t model times
  Eigen::MatrixXd space;                                ///< O U, n_obs × l
  std::vector<Eigen::MatrixXd> core;                    ///< n_t matrices C_t, l × r
  Eigen::MatrixXd lift;                                 ///< O u_lift, n_obs × n_t

  [[nodiscard]] Index observations() const { return space.rows(); }
  /// y at time step `step` and parameters `p`.
  [[nodiscard]] Eigen::VectorXd predict(const Eigen::Ref<const Eigen::VectorXd>& p, std::size_t step) const;
};

/// Observation of the displacements at `places`, which need not be dofs of the model: a dof of the
/// same component within 1e-6 m, else the shape functions of the hexahedron that holds the point. Outside the
/// mesh, or without a match in a model that has no mesh: DataError that names the observation, its point and
/// the nearest dof.
[[nodiscard]] ObservedModel observe(const SeparatedModel& model, const Dofs& places);

/// Observation of the dofs with these indices.
[[nodiscard]] ObservedModel observe_dofs(const SeparatedModel& model, std::span<const std::size_t> dofs);

/// The uncompressed model: w are the Π nᵢ cardinal splines of the grid, C_t the snapshots at the observed
/// dofs (l = n_obs, space is the identity). The judge of what compression does to a posterior; not for speed.
[[nodiscard]] ObservedModel observe_snapshots(const Snapshots& snapshots, const Dofs& places);
/// The same at all dofs, in their order.
[[nodiscard]] ObservedModel observe_snapshots(const Snapshots& snapshots);

/// The part of a model at these time steps.
[[nodiscard]] ObservedModel at_steps(const ObservedModel& model, std::span<const std::size_t> steps);

}  // namespace knothe::model
