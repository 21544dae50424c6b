#pragma once
/// @file Figures of a reduced model: its modes (Fig. 6 and 7), a displacement field, crack solutions (Fig.
/// 10).
#include <span>
#include <vector>

#include "knothe/model/reduced/separated_model.hpp"
#include "knothe/report/figures/svg_figure.hpp"

namespace knothe::report {

/// Whether the model has a mesh of hexahedra and dofs to draw on it.
[[nodiscard]] bool can_be_drawn(const model::SeparatedModel& model);

/// The first `count` space modes on the outer face, x component scaled to a largest value of 1, deformed
/// shape exaggerated. Needs `can_be_drawn`.
[[nodiscard]] std::vector<Figure> space_mode_figures(const model::SeparatedModel& model,
                                                     std::size_t count = 6);

/// How far (µm) each of the first `count` space modes moves the dof that it moves most, over time, at
/// parameters `p` (d, inside the box).
[[nodiscard]] Plot time_functions_plot(const model::SeparatedModel& model, std::span<const double> p,
                                       std::size_t count = 6);

/// The first `count` parameter functions along parameter `axis`; in the tree form along the line through `p`.
[[nodiscard]] Plot parameter_functions_plot(const model::SeparatedModel& model, std::size_t axis,
                                            std::span<const double> p, std::size_t count = 6);

/// Horizontal displacement (µm) on the deformed outer face at parameters `p` and time step `step`. Needs
/// `can_be_drawn`.
[[nodiscard]] Figure displacement_figure(const model::SeparatedModel& model, std::span<const double> p,
                                         std::size_t step);

/// Horizontal displacement of the elastic solutions nearest to the given crack lengths (m); empty without
/// crack solutions.
[[nodiscard]] std::vector<Figure> crack_figures(const model::SeparatedModel& model,
                                                std::span<const double> lengths);

}  // namespace knothe::report
