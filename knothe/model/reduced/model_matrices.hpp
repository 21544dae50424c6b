#pragma once
/// @file A model's arrays as matrices: u(t) = lift.col(t) + space · core(t) · w.
#include <Eigen/Core>
#include <span>

#include "knothe/model/reduced/model_file.hpp"
#include "knothe/model/reduced/parameter_functions.hpp"

namespace knothe::model {

/// U, n_dof × l.
[[nodiscard]] Eigen::Map<const Eigen::MatrixXd> space_of(const ModelContents& contents);
/// u_lift, n_dof × n_t.
[[nodiscard]] Eigen::Map<const Eigen::MatrixXd> lift_of(const ModelContents& contents);
/// C_t, l × r: diag(λ(t)) in the canonical form.
[[nodiscard]] Eigen::MatrixXd core_of(const ModelContents& contents, std::size_t step);

/// w at the nodes of the grid, [r, Π nᵢ].
[[nodiscard]] RowMatrix functions_on_grid(const ModelContents& contents);

class SeparatedModel;
/// C_t w at all times: l × n_t.
[[nodiscard]] Eigen::MatrixXd coefficients_of(const ModelContents& contents, const Eigen::VectorXd& w);
/// w at grid point `index` (C order), which is in the file and takes no spline.
[[nodiscard]] Eigen::VectorXd functions_at_node(const ModelContents& contents, std::size_t index);
/// lift + U C_t w at all times: n_dof × n_t.
[[nodiscard]] Eigen::MatrixXd field_of(const ModelContents& contents, const Eigen::VectorXd& w);
/// The model's field at one point: n_dof × n_t.
[[nodiscard]] Eigen::MatrixXd field_at(const SeparatedModel& model, std::span<const double> p);

}  // namespace knothe::model
